"""A frame of robots on creeping wheels by loops, for a compiler: what `cycle` does by numpy."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import by_robot, laws
from omni_mj.onboard.arrays import (
    BatteryArrays,
    ChargeArrays,
    FirmwareArrays,
    HeatArrays,
    MotorArrays,
    TractionArrays,
)
from omni_mj.onboard.traction import EVERY
from omni_mj.plants.planar import laws as planar
from omni_mj.plants.planar.arrays import Motion, Robots, Scratch
from omni_mj.plants.planar.cycle import PASSES
from omni_mj.worlds.build import CYCLE_S

TOGETHER = 512  # robots whose numbers stay in near memory


def frame(
    cycle: int,
    period: float,
    r: Robots,
    m: Motion,
    s: Scratch,
    f: FirmwareArrays,
    motors: MotorArrays,
    heat: HeatArrays,
    b: BatteryArrays,
    charge: ChargeArrays,
    t: TractionArrays,
    gyro: Array,
    push: Array,
    downhill: Array,
    held: Array,
    speeds: Array,
    voltages: Array,
    currents: Array,
    supplies: Array,
) -> None:
    """Move on by as many cycles as `speeds` has room for.

    Args:
        cycle: number of those before.
        period: what they last, s.
        r: robots.
        m: how they move; written.
        s: what is noted.
        f: their firmware.
        motors: their motors.
        heat: of these.
        b: their batteries.
        charge: of these.
        t: their wheels on the carpet.
        gyro: what gyros show too much, (n,) rad/s.
        push: on chassis, in the world's axes, (2, n) N.
        downhill: on all of a robot, in the world's axes, (2, n) N.
        held: currents that drivers hold, (W, n) A, or not a number; or empty.
        speeds: written: of hubs in each cycle, (cycles, W, n) rad/s.
        voltages: written: of motors, (cycles, W, n) V.
        currents: written: of motors, (cycles, W, n) A.
        supplies: written: of batteries, (cycles, n) V.
    """
    n = len(gyro)
    for begin in range(0, n, TOGETHER):
        first, last = laws.count(begin), laws.count(min(begin + TOGETHER, n))
        for k in range(speeds.shape[0]):
            speed, voltage, current = speeds[k], voltages[k], currents[k]
            for i in range(first, last):
                s.gyro[i], supplies[k, i] = m.seen_rate[i] + gyro[i], b.voltage[i]
            for w in range(speed.shape[0]):
                for i in range(first, last):
                    speed[w, i] = m.speed[w, i]
            by_robot.control(first, last, cycle + k, f, s.gyro, m.seen_angle)
            by_robot.supply(first, last, f, motors, b, held, speed, voltage)
            by_robot.drive(first, last, motors, speed, voltage, current)
            if k % EVERY == 0:
                _drag(first, last, r, m, s, t, push, downhill)
            _pull(first, last, r, m, s, t, current)
            _solve(first, last, r, m, s, t.rims.limit)
            _advance(first, last, r, m, s)
            by_robot.load(first, last, b, voltage, current, s.drawn)
    by_robot.warm(motors, heat, currents, speeds, s.heats)
    by_robot.discharge(b, charge, period)


def _drag(
    first: int, last: int, r: Robots, m: Motion, s: Scratch, t: TractionArrays, push: Array, downhill: Array
) -> None:
    """See `cycle.drag`."""
    for i in range(first, last):
        x, y, c, d = r.middle[0, i], r.middle[1, i], m.facing[0, i], m.facing[1, i]
        s.twist[0, i], s.twist[1, i] = m.twist[0, i] - m.twist[2, i] * y, m.twist[1, i] + m.twist[2, i] * x
        s.twist[2, i] = m.twist[2, i]
        s.momentum[0, i], s.momentum[1, i] = m.place[0, i] + c * x - d * y, m.place[1, i] + d * x + c * y
    by_robot.travel(first, last, t, s.momentum, m.facing, s.twist, m.load, m.angle)
    for i in range(first, last):
        c, d, x, y = m.facing[0, i], m.facing[1, i], t.wrench[0, i], t.wrench[1, i]
        s.sums[3, i], s.sums[4, i], m.force[2, i] = c * x + d * y, c * y - d * x, t.wrench[5, i]
        for each in range(3):
            s.sums[each, i] = 0.0
    for w in range(m.speed.shape[0]):
        outward = r.outward[w]
        for i in range(first, last):
            rim, x, y = m.rims[w, i], r.contacts[0, w, i], r.contacts[1, w, i]
            spin, axle = np.abs(rim), s.twist[0, i] * outward.real + s.twist[1, i] * outward.imag
            aside = planar.spinning(axle, spin, r.bearing[w, i], r.spin_up[w, i])
            along = planar.rolling(rim, spin, r.cost[w, i], r.cost_fades[w, i]) / r.lever[w, i]
            force = complex(aside, along) * outward
            s.sums[3, i] += force.real
            s.sums[4, i] += force.imag
            m.force[2, i] += x * force.imag - y * force.real
        for i in range(first, last):
            spin = np.abs(m.rims[w, i])
            m.ripple[w, i] = planar.rippling(spin, r.ripple[w, i], r.ripple_grows[w, i])
            raised = planar.lifting(spin, r.lift[w, i], r.lift_fades[w, i])
            m.standing[w, i] = r.weight[w, i] + raised
            s.sums[0, i] += raised
            s.sums[1, i] += r.contacts[0, w, i] * raised
            s.sums[2, i] += r.contacts[1, w, i] * raised
    for w in range(m.speed.shape[0]):
        for i in range(first, last):
            shared = r.even[w, i] * s.sums[0, i] + r.ahead[w, i] * s.sums[1, i] + r.aside[w, i] * s.sums[2, i]
            m.standing[w, i] -= shared
    for i in range(first, last):
        c, d, x, y = m.facing[0, i], m.facing[1, i], s.sums[3, i], s.sums[4, i]
        ahead, aside = c * push[0, i] + d * push[1, i], c * push[1, i] - d * push[0, i]
        m.force[0, i] = x + ahead + (c * downhill[0, i] + d * downhill[1, i])
        m.force[1, i] = y + aside + (c * downhill[1, i] - d * downhill[0, i])
        m.force[2, i] += r.pushed[0, i] * aside - r.pushed[1, i] * ahead
        m.tilting[0, i] = r.height[i] * x - r.pushed_height[i] * ahead
        m.tilting[1, i] = r.height[i] * y - r.pushed_height[i] * aside


def _pull(first: int, last: int, r: Robots, m: Motion, s: Scratch, t: TractionArrays, current: Array) -> None:
    """Find how hubs and rubber pull, and what friction allows."""
    for w in range(current.shape[0]):
        for i in range(first, last):
            pressed = laws.pressed(m.load[w, i])
            soft = planar.soft(t.rims.softness[w, i], pressed, r.contact[w, i])
            motor, hub = r.torque_constant[w, i] * current[w, i], (r.give[i], r.viscous[i], r.dry[w, i])
            end, give = planar.hub(m.speed[w, i], motor, m.torque[w, i], soft, *hub)
            t.rims.limit[w, i] = t.rims.rim_friction[w, i] * pressed
            s.end[w, i], s.give[w, i], s.pull[w, i], s.held[w, i] = end, give, 1 / (soft + give), 0.0


def _solve(first: int, last: int, r: Robots, m: Motion, s: Scratch, limit: Array) -> None:
    """Find the twists, and which wheels slide."""
    wheels = limit.shape[0]
    for each in range(3):
        row = r.rows[each]
        for i in range(first, last):
            twist = m.twist[0, i], m.twist[1, i], m.twist[2, i]
            s.momentum[each, i] = planar.momentum((row[0, i], row[1, i], row[2, i]), twist, m.force[each, i])
    for _ in range(1 + PASSES):
        for each in range(6):
            sums, own = s.sums[each], r.inertia[each]
            for i in range(first, last):
                sums[i] = own[i]
            for w in range(wheels):
                for i in range(first, last):
                    sums[i] += s.pull[w, i] * r.squares[w, each, i]
        for each in range(3):
            sums, momentum = s.sums[6 + each], s.momentum[each]
            for i in range(first, last):
                sums[i] = momentum[i]
            for w in range(wheels):
                for i in range(first, last):
                    sums[i] += (s.pull[w, i] * s.end[w, i] + s.held[w, i]) * r.rims[w, each, i]
        for i in range(first, last):
            a = s.sums[0, i], s.sums[1, i], s.sums[2, i], s.sums[3, i], s.sums[4, i], s.sums[5, i]
            b = s.sums[6, i], s.sums[7, i], s.sums[8, i]
            s.twist[0, i], s.twist[1, i], s.twist[2, i] = planar.solved(a, b)
        slide = 0
        for w in range(wheels):
            for i in range(first, last):
                most, pull, held = limit[w, i], s.pull[w, i], s.held[w, i]
                rim = (
                    r.rims[w, 0, i] * s.twist[0, i] + r.rims[w, 1, i] * s.twist[1, i] + r.rims[w, 2, i] * s.twist[2, i]
                )
                torque = laws.where(held == 0, pull * (s.end[w, i] - rim), held)
                over = (np.abs(torque) > most) & (held == 0)
                m.rims[w, i], m.torque[w, i] = rim, np.minimum(np.maximum(torque, -most), most)
                s.held[w, i], s.pull[w, i] = (
                    laws.where(over, np.copysign(most, torque), held),
                    laws.where(over, 0.0, pull),
                )
                slide += laws.where(over, 1, 0)
        if slide == 0:
            break


def _advance(first: int, last: int, r: Robots, m: Motion, s: Scratch) -> None:
    """Move hubs and bodies, and find what wheels carry then."""
    for i in range(first, last):
        s.sums[0, i] = s.sums[1, i] = 0.0
    for w in range(m.speed.shape[0]):
        for i in range(first, last):
            m.seen_angle[w, i] = m.angle[w, i]
            m.speed[w, i] = s.end[w, i] - s.give[w, i] * m.torque[w, i]
            m.angle[w, i] += CYCLE_S * m.speed[w, i]
        for i in range(first, last):
            s.sums[0, i] += m.torque[w, i] * r.rims[w, 0, i]
            s.sums[1, i] += m.torque[w, i] * r.rims[w, 1, i]
    for i in range(first, last):
        back = r.height[i] * s.sums[0, i] + m.tilting[0, i]
        aside = r.height[i] * s.sums[1, i] + m.tilting[1, i]
        m.tilt[0, i] += back
        m.tilt[1, i] += aside
        s.sums[0, i], s.sums[1, i] = back, aside
        s.sums[2, i] = s.sums[3, i] = s.sums[4, i] = 0.0
    for w in range(m.speed.shape[0]):
        for i in range(first, last):
            m.turns[w, i] += r.passing[i] * m.rims[w, i]
            ripple = m.ripple[w, i] * planar.passing(m.turns[w, i])
            m.load[w, i] = ripple
            s.sums[2, i] += ripple
            s.sums[3, i] += r.contacts[0, w, i] * ripple
            s.sums[4, i] += r.contacts[1, w, i] * ripple
    for each in range(3):
        for i in range(first, last):
            pressed = s.sums[2 + each, i]
            yields = planar.swaying(pressed, m.sway[each, i], m.sway_rate[each, i], r.spring[i], r.damper[i])
            m.sway_rate[each, i] += CYCLE_S * yields
            m.sway[each, i] += CYCLE_S * m.sway_rate[each, i]
            s.sums[2 + each, i] = pressed - r.carried[i] * yields
    for w in range(m.speed.shape[0]):
        for i in range(first, last):
            back, aside = s.sums[3, i] + s.sums[0, i], s.sums[4, i] + s.sums[1, i]
            shared = r.even[w, i] * s.sums[2, i] + r.ahead[w, i] * back + r.aside[w, i] * aside
            m.load[w, i] = np.maximum(m.standing[w, i] + m.load[w, i] - shared, 0.0)
    for i in range(first, last):
        x, y, rate, cosine, sine = s.twist[0, i], s.twist[1, i], s.twist[2, i], m.facing[0, i], m.facing[1, i]
        m.seen_rate[i] = m.twist[2, i]
        m.place[0, i] += CYCLE_S * (cosine * x - sine * y)
        m.place[1, i] += CYCLE_S * (sine * x + cosine * y)
        m.heading[i] += CYCLE_S * rate
        c, d = planar.small(CYCLE_S * rate)
        m.facing[0, i], m.facing[1, i] = cosine * c - sine * d, sine * c + cosine * d
        m.twist[0, i], m.twist[1, i], m.twist[2, i] = c * x + d * y, c * y - d * x, rate

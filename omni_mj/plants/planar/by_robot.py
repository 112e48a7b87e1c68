"""A frame of robots on creeping wheels, robot by robot, for a compiled loop: what `cycle` does for all at once."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import by_robot, laws
from omni_mj.onboard.arrays import BatteryArrays, FirmwareArrays, MotorArrays, TractionArrays
from omni_mj.onboard.traction import EVERY
from omni_mj.plants.planar import laws as planar
from omni_mj.plants.planar.arrays import Motion, Plane, Robots, Scratch
from omni_mj.plants.planar.cycle import PASSES
from omni_mj.worlds.build import CYCLE_S


def frame(
    cycle: int,
    r: Robots,
    m: Motion,
    s: Scratch,
    f: FirmwareArrays,
    motors: MotorArrays,
    b: BatteryArrays,
    t: TractionArrays,
    gyro: Array,
    push: Plane,
    downhill: Plane,
    held: Array,
    speeds: Array,
    voltages: Array,
    currents: Array,
    supplies: Array,
) -> None:
    """Move on by as many cycles as `speeds` has room for.

    Args:
        cycle: number of those before.
        r: robots.
        m: how they move; written.
        s: what is noted.
        f: their firmware.
        motors: their motors.
        b: their batteries.
        t: their wheels on the carpet.
        gyro: what gyros show too much, (n,) rad/s.
        push: on chassis, in the world's axes, (n,) N.
        downhill: on all of a robot, in the world's axes, (n,) N.
        held: currents that drivers hold, (n, W) A, or not a number.
        speeds: written: of hubs in each cycle, (cycles, n, W) rad/s.
        voltages: written: of motors, (cycles, n, W) V.
        currents: written: of motors, (cycles, n, W) A.
        supplies: written: of batteries, (cycles, n, 1) V.
    """
    wheels = held.shape[1]
    for i in range(held.shape[0]):
        for k in range(speeds.shape[0]):
            by_robot.control(i, cycle + k, f, m.seen_rate[i] + gyro[i], m.seen_angle)
            supply = b.voltage[i]
            supplies[k, i, 0] = supply
            for w in range(wheels):
                speeds[k, i, w] = m.speed[i, w]
                duty = f.held[i, w]
                if not np.isnan(held[i, w]):
                    motor = motors.speed_constant[i, w], motors.resistance[i, w], motors.commutation[i, w]
                    duty = laws.share(laws.voltage(held[i, w], m.speed[i, w], *motor), supply) if supply > 0 else 0.0
                voltages[k, i, w] = duty * supply
            by_robot.drive(i, motors, m.speed, voltages[k], currents[k])
            if k % EVERY == 0:
                _drag(i, r, m, t, push[i], downhill[i])
            by_robot.press(i, t.rims, m.load)
            _move(i, r, m, s, t, currents[k])
            by_robot.load(i, b, voltages[k], currents[k])


def _drag(i: int, r: Robots, m: Motion, t: TractionArrays, push: complex, downhill: complex) -> None:
    """See `cycle.drag`."""
    heading = complex(np.cos(m.heading[i]), np.sin(m.heading[i]))
    upright = heading.conjugate()
    body = m.velocity[i] * upright + 1j * m.rate[i] * r.middle[i]
    by_robot.travel(i, t, m.place[i] + r.middle[i] * heading, heading, body * heading, m.rate[i], m.load, m.angle)
    ground, moment = complex(t.wrench[i, 0], t.wrench[i, 1]) * upright, t.wrench[i, 5]
    total = x = y = 0.0
    for w in range(m.speed.shape[1]):
        rim, contact = m.speed[i, w] - m.slip[i, w], r.contacts[i, w]
        spin = np.abs(rim)
        axle = (body * r.outward[w].conjugate()).real
        aside = planar.spinning(axle, spin, r.bearing[i, w], r.spin_up[i, w])
        along = planar.rolling(rim, spin, r.cost[i, w], r.cost_fades[i, w]) / r.lever[i, w]
        force = complex(aside, along) * r.outward[w]
        ground += force
        moment += (contact.conjugate() * force).imag
        raised = planar.lifting(spin, r.lift[i, w], r.lift_fades[i, w])
        m.raised[i, w] = raised
        total += raised
        x += contact.real * raised
        y += contact.imag * raised
    for w in range(m.speed.shape[1]):
        m.raised[i, w] -= r.even[i, w] * total + r.ahead[i, w] * x + r.aside[i, w] * y
    m.push[i], m.ground[i] = push * upright, ground
    m.force[i] = ground + m.push[i] + downhill * upright
    m.moment[i] = moment + (r.pushed[i].conjugate() * m.push[i]).imag


def _move(i: int, r: Robots, m: Motion, s: Scratch, t: TractionArrays, current: Array) -> None:
    """See `cycle.move`."""
    wheels = m.speed.shape[1]
    for w in range(wheels):
        speed = m.speed[i, w]
        free = planar.free(speed, r.give[i, 0], r.torque_constant[i, w] * current[i, w], r.viscous[i, 0])
        soft = planar.soft(t.rims.impedance[i, w], r.contact[i, w])
        dry = planar.dry(free, speed, r.give[i, 0], m.torque[i, w], soft)
        if np.abs(dry) <= r.dry[i, w]:
            s.end[i, w], s.give[i, w] = planar.RESTING * speed, 0.0
        else:
            s.end[i, w], s.give[i, w] = free - r.give[i, 0] * np.copysign(r.dry[i, w], dry), r.give[i, 0]
        s.pull[i, w] = 1 / (soft + s.give[i, w])
        s.held[i, w] = 0.0

    heading = complex(np.cos(m.heading[i]), np.sin(m.heading[i]))
    body, turn = m.velocity[i] * heading.conjugate(), m.rate[i]
    xx, xy, xz = r.inertia[i, 0], r.inertia[i, 1], r.inertia[i, 2]
    yy, yz, zz = r.inertia[i, 3], r.inertia[i, 4], r.inertia[i, 5]
    p = xx * body.real + xy * body.imag + xz * turn + m.force[i].real
    q = xy * body.real + yy * body.imag + yz * turn + m.force[i].imag
    u = xz * body.real + yz * body.imag + zz * turn + m.moment[i]
    vx, vy = 0.0, 0.0
    for attempt in range(1 + PASSES):
        a0, a1, a2, a3, a4, a5 = xx, xy, xz, yy, yz, zz
        b0, b1, b2 = p, q, u
        for w in range(wheels):
            pull = s.pull[i, w]
            ends = pull * s.end[i, w] + s.held[i, w]
            a0 += pull * r.squares[i, w, 0]
            a1 += pull * r.squares[i, w, 1]
            a2 += pull * r.squares[i, w, 2]
            a3 += pull * r.squares[i, w, 3]
            a4 += pull * r.squares[i, w, 4]
            a5 += pull * r.squares[i, w, 5]
            b0 += ends * r.rims[i, w, 0]
            b1 += ends * r.rims[i, w, 1]
            b2 += ends * r.rims[i, w, 2]
        vx, vy, turn = planar.solved((a0, a1, a2, a3, a4, a5), (b0, b1, b2))
        slides = False
        for w in range(wheels):
            limit = t.rims.limit[i, w]
            s.rims[i, w] = r.rims[i, w, 0] * vx + r.rims[i, w, 1] * vy + r.rims[i, w, 2] * turn
            torque = s.held[i, w]
            if torque == 0:
                torque = s.pull[i, w] * (s.end[i, w] - s.rims[i, w])
                if np.abs(torque) > limit and attempt < PASSES:
                    s.held[i, w], s.pull[i, w], slides = np.copysign(limit, torque), 0.0, True
            m.torque[i, w] = min(max(torque, -limit), limit)
        if not slides:
            break

    ahead, aside = m.ground[i].real, m.ground[i].imag
    for w in range(wheels):
        m.seen_angle[i, w] = m.angle[i, w]
        m.speed[i, w] = s.end[i, w] - s.give[i, w] * m.torque[i, w]
        m.angle[i, w] += CYCLE_S * m.speed[i, w]
        m.slip[i, w] = m.speed[i, w] - s.rims[i, w]
        ahead += m.torque[i, w] * r.rims[i, w, 0]
        aside += m.torque[i, w] * r.rims[i, w, 1]
    m.seen_rate[i] = m.rate[i]
    m.velocity[i], m.rate[i] = complex(vx, vy) * heading, turn
    m.place[i] += CYCLE_S * m.velocity[i]
    m.heading[i] += CYCLE_S * turn
    tilt = r.height[i] * complex(ahead, aside) - r.pushed_height[i] * m.push[i]
    m.tilt[i] += tilt
    for w in range(wheels):
        shifted = r.ahead[i, w] * tilt.real + r.aside[i, w] * tilt.imag
        m.load[i, w] = max(r.weight[i, w] - shifted + m.raised[i, w], 0.0)

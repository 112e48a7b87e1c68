"""A frame of robots on creeping wheels by loops, for a compiler: what `cycle` does by numpy."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import by_frame, by_robot, laws
from omni_mj.onboard import table as onboard
from omni_mj.onboard.arrays import MotorArrays, TractionArrays
from omni_mj.onboard.laws import Some, each
from omni_mj.onboard.table import Table
from omni_mj.onboard.traction import EVERY
from omni_mj.plants.planar import laws as planar
from omni_mj.plants.planar import table
from omni_mj.plants.planar.arrays import Motion, Robots, Scratch
from omni_mj.plants.planar.cycle import PASSES
from omni_mj.worlds.build import CYCLE_S

TOGETHER = 512  # robots whose numbers stay in near memory


def obey(t: Table, some: Some, cycle: int) -> None:
    """Take over the commands that are noted, after so many cycles."""
    by_frame.obey(some, onboard.firmware(t), cycle)


def go(t: Table, some: Some, cycle: int, frame: int, period: float) -> bool:
    """Let a frame pass.

    Args:
        t: where all is.
        some: robots: all, or the only one.
        cycle: number of cycles before.
        frame: number of frames before.
        period: what a frame lasts, s.

    Returns:
        Whether all robots stand on their wheels at places that are numbers.
    """
    r, m = table.robots(t), table.motion(t)
    motors, heat, battery = onboard.motors(t), onboard.heat(t), onboard.battery(t)
    g, s = table.frame(t), table.scratch(t)
    by_frame.correct(some, onboard.firmware(t), heat, onboard.past(t), frame)
    for i in each(some):
        m.before[0, i], m.before[1, i] = m.place[0, i], m.place[1, i]
        m.tilt[0, i] = m.tilt[1, i] = 0.0
    if some is None:
        _cycles(t, some, cycle)
    else:
        for begin in range(some[0], some[1], TOGETHER):
            _cycles(t, (begin, min(begin + TOGETHER, some[1])), cycle)
    by_robot.warm(some, motors, heat, g.recorded[2], g.recorded[0], s.heats)
    by_robot.discharge(some, battery, onboard.charge(t), period)
    return _stand(some, r, m, g.supplies.shape[0])


def _cycles(t: Table, some: Some, cycle: int) -> None:
    """Let the cycles of a frame pass for some robots, after so many."""
    r, m, s, g = table.robots(t), table.motion(t), table.scratch(t), table.frame(t)
    f, motors, b, traction = onboard.firmware(t), onboard.motors(t), onboard.battery(t), onboard.traction(t)
    for k in range(g.supplies.shape[0]):
        speed, voltage, current = g.recorded[0, k], g.recorded[1, k], g.recorded[2, k]
        for i in each(some):
            s.gyro[i], g.supplies[k, i] = m.seen_rate[i] + g.gyro[i], b.voltage[i]
        for w in range(speed.shape[0]):
            for i in each(some):
                speed[w, i] = m.speed[w, i]
        by_robot.control(some, cycle + k, f, s.gyro, m.seen_angle)
        by_robot.supply(some, f, motors, b, g.held, speed, voltage)
        by_robot.drive(some, motors, speed, voltage, current)
        if k % EVERY == 0:
            _drag(some, r, m, s, traction, g.push, g.downhill)
        _pull(some, r, m, s, traction, motors, current)
        _solve(some, r, m, s, traction.rims.limit)
        _advance(some, r, m, s)
        by_robot.load(some, b, voltage, current, s.drawn)


def look(t: Table, some: Some) -> None:
    """Find the poses of robots."""
    r, m, g = table.robots(t), table.motion(t), table.frame(t)
    for i in each(some):
        x, y = planar.turned(m.facing[0, i], m.facing[1, i], r.middle[0, i], r.middle[1, i])
        g.pose[i, 0], g.pose[i, 1], g.pose[i, 2] = m.place[0, i] + x, m.place[1, i] + y, m.heading[i]


def tell(t: Table, some: Some) -> None:
    """Find the telemetry of robots."""
    r, m, g = table.robots(t), table.motion(t), table.frame(t)
    for w in range(g.slip.shape[0]):
        for i in each(some):
            g.slip[w, i] = np.abs(m.speed[w, i] - m.rims[w, i]) * r.radius[w, i]
    wheels, recorded = (m.angle, m.speed, g.slip), (g.recorded[1], g.recorded[2], g.supplies)
    by_frame.tell(some, g.telemetry, wheels, recorded, onboard.heat(t), onboard.battery(t))


def _drag(some: Some, r: Robots, m: Motion, s: Scratch, t: TractionArrays, push: Array, downhill: Array) -> None:
    """See `cycle.drag`."""
    for i in each(some):
        x, y, c, d = r.middle[0, i], r.middle[1, i], m.facing[0, i], m.facing[1, i]
        s.twist[0, i], s.twist[1, i] = m.twist[0, i] - m.twist[2, i] * y, m.twist[1, i] + m.twist[2, i] * x
        s.twist[2, i] = m.twist[2, i]
        s.momentum[0, i], s.momentum[1, i] = m.place[0, i] + c * x - d * y, m.place[1, i] + d * x + c * y
    by_robot.travel(some, t, s.momentum, m.facing, s.twist, m.load, m.angle)
    for i in each(some):
        c, d, x, y = m.facing[0, i], m.facing[1, i], t.wrench[0, i], t.wrench[1, i]
        s.sums[3, i], s.sums[4, i], m.force[2, i] = c * x + d * y, c * y - d * x, t.wrench[5, i]
        for row in range(3):
            s.sums[row, i] = 0.0
    for w in range(m.speed.shape[0]):
        outward = r.outward[w]
        for i in each(some):
            rim, x, y = m.rims[w, i], r.contacts[0, w, i], r.contacts[1, w, i]
            spin, axle = np.abs(rim), s.twist[0, i] * outward.real + s.twist[1, i] * outward.imag
            aside = planar.spinning(axle, spin, r.bearing[w, i], r.spin_up[w, i], r.spin_fades[w, i])
            m.drift[w, i] = planar.drifting(axle, s.twist[2, i], r.lever[w, i])
            along = planar.rolling(rim, spin, r.cost[w, i], r.cost_fades[w, i]) / r.lever[w, i]
            force = complex(aside, along) * outward
            s.sums[3, i] += force.real
            s.sums[4, i] += force.imag
            m.force[2, i] += x * force.imag - y * force.real
        for i in each(some):
            spin = np.abs(m.rims[w, i])
            m.ripple[w, i] = planar.rippling(spin, r.ripple[w, i], r.ripple_grows[w, i])
            raised = planar.lifting(spin, r.lift[w, i], r.lift_fades[w, i])
            m.standing[w, i] = r.weight[w, i] + raised
            s.sums[0, i] += raised
            s.sums[1, i] += r.contacts[0, w, i] * raised
            s.sums[2, i] += r.contacts[1, w, i] * raised
    for w in range(m.speed.shape[0]):
        for i in each(some):
            shared = r.even[w, i] * s.sums[0, i] + r.ahead[w, i] * s.sums[1, i] + r.aside[w, i] * s.sums[2, i]
            m.standing[w, i] -= shared
    for i in each(some):
        c, d, x, y = m.facing[0, i], m.facing[1, i], s.sums[3, i], s.sums[4, i]
        ahead, aside = c * push[0, i] + d * push[1, i], c * push[1, i] - d * push[0, i]
        m.force[0, i] = x + ahead + (c * downhill[0, i] + d * downhill[1, i])
        m.force[1, i] = y + aside + (c * downhill[1, i] - d * downhill[0, i])
        m.force[2, i] += r.pushed[0, i] * aside - r.pushed[1, i] * ahead
        m.tilting[0, i] = r.height[i] * x - r.pushed_height[i] * ahead
        m.tilting[1, i] = r.height[i] * y - r.pushed_height[i] * aside


def _pull(some: Some, r: Robots, m: Motion, s: Scratch, t: TractionArrays, motors: MotorArrays, current: Array) -> None:
    """Find how hubs and rubber pull, and what friction allows."""
    for w in range(current.shape[0]):
        for i in each(some):
            pressed = laws.pressed(m.load[w, i])
            soft = planar.soft(t.rims.softness[w, i], pressed, r.contact[w, i])
            motor, hub = motors.speed_constant[w, i] * current[w, i], (r.give[i], r.viscous[i], r.dry[w, i])
            end, give = planar.hub(m.speed[w, i], motor, m.torque[w, i], soft, *hub)
            t.rims.limit[w, i] = t.rims.rim_friction[w, i] * pressed
            s.end[w, i], s.give[w, i], s.pull[w, i], s.held[w, i] = end - m.drift[w, i], give, 1 / (soft + give), 0.0


def _solve(some: Some, r: Robots, m: Motion, s: Scratch, limit: Array) -> None:
    """Find the twists, and which wheels slide."""
    wheels = limit.shape[0]
    for row in range(3):
        rows, own_x, own_y = r.rows[row], r.wheeling[0, row], r.wheeling[1, row]
        for i in each(some):
            twist, own = (m.twist[0, i], m.twist[1, i], m.twist[2, i]), (own_x[i], own_y[i])
            s.momentum[row, i] = planar.momentum((rows[0, i], rows[1, i], rows[2, i]), own, twist) + m.force[row, i]
    for _ in range(1 + PASSES):
        for row in range(6):
            sums, own = s.sums[row], r.inertia[row]
            for i in each(some):
                sums[i] = own[i]
            for w in range(wheels):
                for i in each(some):
                    sums[i] += s.pull[w, i] * r.squares[w, row, i]
        for row in range(3):
            sums, momentum = s.sums[6 + row], s.momentum[row]
            for i in each(some):
                sums[i] = momentum[i]
            for w in range(wheels):
                for i in each(some):
                    sums[i] += (s.pull[w, i] * s.end[w, i] + s.held[w, i]) * r.rims[w, row, i]
        for i in each(some):
            a = s.sums[0, i], s.sums[1, i], s.sums[2, i], s.sums[3, i], s.sums[4, i], s.sums[5, i]
            b = s.sums[6, i], s.sums[7, i], s.sums[8, i]
            s.twist[0, i], s.twist[1, i], s.twist[2, i] = planar.solved(a, b)
        slide = 0
        for w in range(wheels):
            for i in each(some):
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


def _advance(some: Some, r: Robots, m: Motion, s: Scratch) -> None:
    """Move hubs and bodies, and find what wheels carry then."""
    for i in each(some):
        s.sums[0, i] = s.sums[1, i] = 0.0
    for w in range(m.speed.shape[0]):
        for i in each(some):
            m.seen_angle[w, i] = m.angle[w, i]
            m.speed[w, i] = s.end[w, i] + m.drift[w, i] - s.give[w, i] * m.torque[w, i]
            m.rims[w, i] += m.drift[w, i]
            m.angle[w, i] += CYCLE_S * m.speed[w, i]
        for i in each(some):
            s.sums[0, i] += m.torque[w, i] * r.rims[w, 0, i]
            s.sums[1, i] += m.torque[w, i] * r.rims[w, 1, i]
    for i in each(some):
        back = r.height[i] * s.sums[0, i] + m.tilting[0, i]
        aside = r.height[i] * s.sums[1, i] + m.tilting[1, i]
        m.tilt[0, i] += back
        m.tilt[1, i] += aside
        s.sums[2, i], s.sums[3, i], s.sums[4, i] = 0.0, back, aside
    for w in range(m.speed.shape[0]):
        for i in each(some):
            m.turns[w, i] += r.passing[i] * m.rims[w, i]
            s.held[w, i] = planar.passing(m.turns[w, i])
            m.load[w, i] = m.ripple[w, i] * s.held[w, i]
            s.sums[2, i] += m.load[w, i]
            s.sums[3, i] += r.contacts[0, w, i] * m.load[w, i]
            s.sums[4, i] += r.contacts[1, w, i] * m.load[w, i]
    for way in range(3):
        for i in each(some):
            pressed = s.sums[2 + way, i]
            yields = planar.swaying(pressed, m.sway[way, i], m.sway_rate[way, i], r.spring[i], r.damper[i])
            s.sums[5 + way, i] = pressed - r.carried[i] * yields
    for w in range(m.speed.shape[0]):
        for i in each(some):
            shared = r.even[w, i] * s.sums[5, i] + r.ahead[w, i] * s.sums[6, i] + r.aside[w, i] * s.sums[7, i]
            stiffer = r.stiffens[w, i] * s.held[w, i] * shared
            m.load[w, i] -= stiffer
            s.sums[2, i] -= stiffer
            s.sums[3, i] -= r.contacts[0, w, i] * stiffer
            s.sums[4, i] -= r.contacts[1, w, i] * stiffer
    for way in range(3):
        for i in each(some):
            pressed = s.sums[2 + way, i]
            yields = planar.swaying(pressed, m.sway[way, i], m.sway_rate[way, i], r.spring[i], r.damper[i])
            m.sway_rate[way, i] += CYCLE_S * yields
            m.sway[way, i] += CYCLE_S * m.sway_rate[way, i]
            s.sums[2 + way, i] = pressed - r.carried[i] * yields
    for w in range(m.speed.shape[0]):
        for i in each(some):
            shared = r.even[w, i] * s.sums[2, i] + r.ahead[w, i] * s.sums[3, i] + r.aside[w, i] * s.sums[4, i]
            m.load[w, i] = np.maximum(m.standing[w, i] + m.load[w, i] - shared, 0.0)
    for i in each(some):
        x, y, rate, cosine, sine = s.twist[0, i], s.twist[1, i], s.twist[2, i], m.facing[0, i], m.facing[1, i]
        m.seen_rate[i] = m.twist[2, i]
        ahead, aside = planar.turned(cosine, sine, x, y)
        m.place[0, i] += CYCLE_S * ahead
        m.place[1, i] += CYCLE_S * aside
        m.heading[i] += CYCLE_S * rate
        c, d = planar.small(CYCLE_S * rate)
        m.facing[0, i], m.facing[1, i] = cosine * c - sine * d, sine * c + cosine * d
        m.twist[0, i], m.twist[1, i], m.twist[2, i] = c * x + d * y, c * y - d * x, rate


def _stand(some: Some, r: Robots, m: Motion, cycles: int) -> bool:
    """Whether all robots stand, at places that are numbers, after so many cycles."""
    stand = True
    for i in each(some):
        weight = 0.0
        for w in range(r.weight.shape[0]):
            weight += r.weight[w, i]
        for w in range(r.weight.shape[0]):
            corner, edge = (r.corners[0, w, i], r.corners[1, w, i]), (r.edges[0, w, i], r.edges[1, w, i])
            stand = stand and not planar.falls(corner, edge, (m.tilt[0, i], m.tilt[1, i]), weight * cycles)
        stand = stand and np.isfinite(m.place[0, i] + m.place[1, i] + m.heading[i])
    return stand

"""A cycle of the wheel loops by loops over robots, for compilers: what the classes of this room do by numpy.

Each function does a part of the cycle for some robots, by the same `laws`. Innermost goes a loop over robots, without
a branch and over numbers that are side by side, so that a processor takes several at once. Nothing of one robot reaches
another's numbers, whichever are taken together. Uncompiled they give the same, slowly.
"""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.onboard import laws
from omni_mj.onboard.arrays import (
    BatteryArrays,
    ChargeArrays,
    FirmwareArrays,
    HeatArrays,
    MotorArrays,
    RimArrays,
    TractionArrays,
)
from omni_mj.onboard.laws import Some, each


def control(some: Some, cycle: int, f: FirmwareArrays, gyro: Array, angle: Array) -> None:
    """Run the loops of robots if they are due: their duties are then `f.held` (see `Firmware.duties`).

    Args:
        some: robots.
        cycle: number of cycles before this one.
        f: state.
        gyro: (n,) rad/s.
        angle: of the wheels, (W, n) rad.
    """
    integrate = 0
    for i in each(some):
        runs, stands = np.floor(cycle / f.every[i]) * f.every[i] == cycle, cycle >= f.stops[i]
        due, rate = runs & (f.off[i] == 0), f.gyro_scale[i] * gyro[i] - f.bias[i]
        f.due[i] = laws.where(due, 1.0, 0.0)
        f.heading[i] = laws.where(due, f.heading[i] + rate * f.timestep[i], f.heading[i])
        cosine, sine = laws.direction(laws.where(f.body[i] != 0, 0.0, f.heading[i]))
        f.cosine[i], f.sine[i] = laws.where(stands, 0.0, cosine), laws.where(stands, 0.0, sine)
        f.turning[i] = laws.where(stands, 0.0, f.turn_rate[i]) - f.turn_gain[i] * rate
        integrate += laws.where((f.ki[i] != 0) | (f.kd[i] != 0), 1, 0)
    for w in range(angle.shape[0]):
        if cycle == 0:  # wherever the wheels stand when the robot is switched on
            for i in each(some):
                f.last_count[w, i] = _count(i, w, f, angle)
        if integrate == 0:
            for i in each(some):
                voltage, error, count, speed = _wheel(i, w, cycle, f, angle)
                _set(i, w, f, voltage, count, speed)
        else:
            for i in each(some):
                voltage, error, count, speed = _wheel(i, w, cycle, f, angle)
                last_error, integral = f.last_error[w, i], f.integral[w, i]
                loop = f.ki[i], f.kd[i], f.timestep[i], f.nominal[i]
                voltage, more, windup = laws.integrated(voltage, error, last_error, integral, *loop)
                f.last_error[w, i] = laws.where(f.due[i] != 0, error, last_error)
                f.integral[w, i] = laws.where((f.due[i] != 0) & ~windup, more, integral)
                _set(i, w, f, voltage, count, speed)


def _wheel(i: int, w: int, cycle: int, f: FirmwareArrays, angle: Array) -> tuple[float, float, float, float]:
    """Voltage of the proportional part of a wheel's loop, the error, the encoder's count, and the speed by it."""
    turned = laws.wheel_speed(f.cosine[i], f.sine[i], f.along_x[w, i], f.along_y[w, i], f.turning[i] * f.turn[w, i])
    wanted = laws.where(np.isnan(f.rims[w, i]) | (cycle >= f.stops[i]), turned, f.rims[w, i])
    count = _count(i, w, f, angle)
    speed = (count - f.last_count[w, i]) * f.rate_per_count[i]
    voltage, error = laws.proportional(wanted, speed, f.kp[i], f.back_emf[i])
    return voltage, error, count, speed


def _count(i: int, w: int, f: FirmwareArrays, angle: Array) -> float:
    """The encoder's count."""
    return laws.counted(laws.shown(angle[w, i], f.count_scale[w, i], f.count_shift[w, i]), f.counts_per_rad[i])


def _set(i: int, w: int, f: FirmwareArrays, voltage: float, count: float, speed: float) -> None:
    """Hold a voltage from now on, and keep what was counted, if the loop is due."""
    duty = laws.share(laws.derated(voltage, f.speed_constant[i] * speed, f.swing[w, i]), f.nominal[i])
    f.last_count[w, i] = laws.where(f.due[i] != 0, count, f.last_count[w, i])
    f.held[w, i] = laws.where(f.due[i] != 0, duty, f.held[w, i])


def supply(
    some: Some,
    f: FirmwareArrays,
    m: MotorArrays,
    b: BatteryArrays,
    held: Array,
    speed: Array,
    voltage: Array,
) -> None:
    """Find what voltages the motors' terminals are to have.

    Args:
        some: robots.
        f: firmware, whose duties count,
        m: motors.
        b: batteries.
        held: but where drivers hold a current, (W, n) A (see `Motors.hold`); not a number elsewhere. Empty if nowhere.
        speed: of the wheels, (W, n) rad/s.
        voltage: written, (W, n) V.
    """
    for w in range(speed.shape[0]):
        for i in each(some):
            voltage[w, i] = f.held[w, i] * b.voltage[i]
        if not len(held):
            continue
        for i in each(some):
            motor = m.speed_constant[w, i], m.resistance[w, i], m.commutation[w, i]
            if not np.isnan(held[w, i]) and b.voltage[i] > 0:
                wanted = laws.share(laws.voltage(held[w, i], speed[w, i], *motor), b.voltage[i])
                voltage[w, i] = wanted * b.voltage[i]


def drive(some: Some, m: MotorArrays, speed: Array, voltage: Array, current: Array) -> None:
    """Find what motors do (see `Motors.drive`).

    Args:
        some: robots.
        m: state.
        speed: of the wheels, (W, n) rad/s.
        voltage: at the terminals, (W, n) V: as wanted; then as it is.
        current: written, (W, n) A.
    """
    for w in range(speed.shape[0]):
        for i in each(some):
            motor = m.speed_constant[w, i], m.resistance[w, i], m.commutation[w, i]
            wanted, back_emf, turning = laws.current(voltage[w, i], speed[w, i], *motor)
            volts, amperes = laws.held_back(wanted, m.limit[w, i], back_emf, turning)
            over = np.abs(wanted) > m.limit[w, i]
            voltage[w, i], current[w, i] = laws.where(over, volts, voltage[w, i]), laws.where(over, amperes, wanted)
            m.held_back[w, i] += laws.where(over, 1.0, 0.0)


def load(some: Some, b: BatteryArrays, voltage: Array, current: Array, drawn: Array) -> None:
    """Let batteries sag under motors' voltages and currents (W, n) (see `Battery.load`); `drawn` (n,) A is written."""
    for i in each(some):
        drawn[i] = 0.0
    for w in range(voltage.shape[0]):
        for i in each(some):
            drawn[i] += laws.share(voltage[w, i], b.voltage[i] + b.dead[i]) * current[w, i]
    for i in each(some):
        b.drawn[i] += drawn[i]
        b.loads[i] += 1.0
        b.voltage[i] = b.share[i] * laws.sagged(b.open[i], b.resistance[i], drawn[i])


def warm(some: Some, m: MotorArrays, h: HeatArrays, currents: Array, speeds: Array, heats: Array) -> None:
    """Warm motors (see `Motors.warm`) by currents and speeds (cycles, W, n), A and rad/s; `heats` (2, n) is written."""
    count = len(currents)
    for w in range(currents.shape[1]):
        for i in each(some):
            heats[0, i] = heats[1, i] = 0.0
        for k in range(count):
            for i in each(some):
                squared, speed = currents[k, w, i] * currents[k, w, i], np.abs(speeds[k, w, i])
                heats[0, i] += squared
                heats[1, i] += laws.in_the_housing(squared, speed, m.commutation[w, i], h.dry[i], h.viscous[i])
        for i in each(some):
            air, cold, copper = h.ambient[i], h.cold_resistance[i], h.copper[i]
            winding, housing, square, outer = h.winding[w, i] - air, h.housing[w, i] - air, heats[0, i], heats[1, i]
            square, outer = square / count, outer / count
            c, d = h.conduction[0], h.conduction[1]
            inside, outside = (c[0, i], c[1, i], c[2, i], c[3, i]), (d[0, i], d[1, i], d[2, i], d[3, i])
            after = air + laws.conducted(inside, winding, housing, square * m.resistance[w, i], outer)
            mean = (m.resistance[w, i] + laws.at_temperature(cold, copper, after)) / 2
            h.winding[w, i] = air + laws.conducted(inside, winding, housing, square * mean, outer)
            h.housing[w, i] = air + laws.conducted(outside, winding, housing, square * mean, outer)
            h.limited[w, i], m.held_back[w, i] = m.held_back[w, i] / count, 0.0
            m.resistance[w, i] = laws.at_temperature(cold, copper, h.winding[w, i])
            h.constant[w, i] = laws.at_temperature(h.cold_constant[w, i], h.magnet[i], h.housing[w, i])
            m.speed_constant[w, i] = h.constant[w, i] * h.gear[i]


def discharge(some: Some, b: BatteryArrays, c: ChargeArrays, period: float) -> None:
    """Take what was drawn in a period, s, from batteries (see `Battery.discharge`)."""
    for i in each(some):
        mean = b.drawn[i] / b.loads[i]
        b.drawn[i] = b.loads[i] = 0.0
        c.charge[i] = np.minimum(np.maximum(c.charge[i] - mean * period / c.capacity[i], 0.0), 1.0)
        b.open[i] = c.cells[i] * laws.open_circuit(c.charge[i])
        loaded = b.open[i] - b.resistance[i] * mean
        c.average[i] += (loaded - c.average[i]) * min(period / laws.CUT_OFF_S, 1.0)
        c.alive[i] = c.alive[i] and c.average[i] > c.cut_off[i]
        if not c.alive[i]:
            b.open[i] = b.resistance[i] = 0.0
            b.dead[i] = np.inf


def travel(some: Some, t: TractionArrays, place: Array, facing: Array, twist: Array, load: Array, angle: Array) -> None:
    """Look at where robots are and go (see `Traction.travel`).

    Args:
        some: robots.
        t: state.
        place: in the world, (2, n) m.
        facing: cosine and sine of the heading, (2, n).
        twist: of the robot's middle, in its frame, (3, n) m/s and rad/s.
        load: of the wheels, (W, n) N.
        angle: of the wheels, (W, n) rad.
    """
    c, wrench = t.carpet, t.wrench
    for i in each(some):
        wrench[0, i] = wrench[1, i] = wrench[5, i] = 0.0
    for w in range(load.shape[0]):
        outward = t.outward[w]
        for i in each(some):
            t.friction[w, i] = c.friction[w, i]
        for k in range(len(c.patches)):
            for i in each(some):
                at = complex(place[0, i], place[1, i]) + complex(facing[0, i], facing[1, i]) * (t.arm * outward)
                covered = laws.inside(at, complex(c.patches[k, 0, i], c.patches[k, 1, i]), c.patches[k, 2, i])
                t.friction[w, i] = laws.where(covered, c.patches[k, 3, i], t.friction[w, i])
        if t.gaps:
            for i in each(some):
                t.friction[w, i] = laws.where(laws.over_gap(angle[w, i], t.gap[w, i]), 0.0, t.friction[w, i])
        for i in each(some):
            friction = t.friction[w, i] * t.grip[w, i]
            wheel = complex(twist[0, i], twist[1, i]) * outward.conjugate() + complex(0.0, t.arm * twist[2, i])
            speed, direction, held = laws.rolled(wheel, t.bearing[i], friction)
            fibres = complex(facing[0, i], facing[1, i]) * c.fibres[i]
            drag = load[w, i] * (laws.leaning(c.pile[i], c.nap[i], direction * outward, fibres) * direction + held)
            force = drag * outward
            wrench[0, i] -= force.real
            wrench[1, i] -= force.imag
            wrench[5, i] += drag.imag
            t.rims.softness[w, i] = t.creep[w, i] * speed
            t.rims.rim_friction[w, i] = laws.left_for_the_rim(friction, held, t.radius[w, i])
    for i in each(some):
        ahead, aside, height = wrench[0, i], wrench[1, i], t.centre[2, i]
        wrench[5, i] = -t.arm * wrench[5, i] - t.centre[0, i] * aside + t.centre[1, i] * ahead
        x, y = facing[0, i] * ahead - facing[1, i] * aside, facing[1, i] * ahead + facing[0, i] * aside
        wrench[0, i], wrench[1, i], wrench[3, i], wrench[4, i] = x, y, height * y, -height * x


def press(some: Some, r: RimArrays, load: Array) -> None:
    """Find limit and creep of wheels under their loads (W, n) in N (see `Traction.press`)."""
    for w in range(load.shape[0]):
        for i in each(some):
            pressed = laws.pressed(load[w, i])
            r.limit[w, i] = r.rim_friction[w, i] * pressed
            r.impedance[w, i] = pressed / (pressed + r.softness[w, i])

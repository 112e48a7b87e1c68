"""A cycle of the wheel loops robot by robot, for compiled loops: what the classes of this room do for all at once.

`kernel.compiled` compiles a loop over robots that calls these; they go from wheel to wheel and reckon by the same
`laws`. Nothing depends on how many robots there are, so that a robot's numbers do not either. Uncompiled they give the
same, slowly.
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


def control(i: int, cycle: int, f: FirmwareArrays, gyro: float, angle: Array) -> None:
    """Run the loops of robot i if they are due: its duties are then `f.held[i]` (see `Firmware.duties`).

    Args:
        i: number of the robot.
        cycle: number of cycles before this one.
        f: state.
        gyro: rad/s.
        angle: of all wheels, (n, W) rad.
    """
    if f.off[i] != 0 or cycle % f.every[i] != 0:
        return
    silent = cycle >= f.stops[i]
    rate = f.gyro_scale[i] * gyro - f.bias[i]
    f.heading[i] += rate * f.timestep[i]
    heading = 0.0 if f.body[i] != 0 else f.heading[i]
    cosine, sine = np.cos(heading), np.sin(heading)
    turn_rate = (0.0 if silent else f.turn_rate[i]) - f.turn_gain[i] * rate
    for w in range(f.held.shape[1]):
        turn = turn_rate * f.turn[i, w]
        wanted = turn if silent else laws.wheel_speed(cosine, sine, f.along_x[i, w], f.along_y[i, w], turn)
        if not (silent or np.isnan(f.rims[i, w])):
            wanted = f.rims[i, w] / f.radius[i]
        count = laws.counted(laws.shown(angle[i, w], f.count_scale[i, w], f.count_shift[i, w]), f.counts_per_rad[i])
        if cycle == 0:  # wherever the wheels stand when the robot is switched on
            f.last_count[i, w] = count
        speed = (count - f.last_count[i, w]) * f.rate_per_count[i]
        f.last_count[i, w] = count
        voltage, error = laws.proportional(wanted, speed, f.kp[i], f.back_emf[i])
        if f.ki[i] != 0 or f.kd[i] != 0:
            last, integral = f.last_error[i, w], f.integral[i, w]
            gains = f.ki[i], f.kd[i], f.timestep[i], f.nominal[i]
            voltage, integral, windup = laws.integrated(voltage, error, last, integral, *gains)
            f.last_error[i, w] = error
            if not windup:
                f.integral[i, w] = integral
        voltage = laws.derated(voltage, f.speed_constant[i] * speed, f.swing[i, w])
        f.held[i, w] = laws.share(voltage, f.nominal[i])


def drive(i: int, m: MotorArrays, speed: Array, voltage: Array, current: Array) -> None:
    """Find what the motors of robot i do (see `Motors.drive`).

    Args:
        i: number of the robot.
        m: state.
        speed: of the wheels, (n, W) rad/s.
        voltage: at the terminals, (n, W) V: as wanted; then as it is.
        current: written, (n, W) A.
    """
    for w in range(speed.shape[1]):
        motor = m.speed_constant[i, w], m.resistance[i, w], m.commutation[i, w]
        amperes, back_emf, turning = laws.current(voltage[i, w], speed[i, w], *motor)
        if np.abs(amperes) > m.limit[i, w]:
            voltage[i, w], amperes = laws.held_back(amperes, m.limit[i, w], back_emf, turning)
            m.held_back[i, w] += 1.0
        current[i, w] = amperes


def load(i: int, b: BatteryArrays, voltage: Array, current: Array) -> None:
    """Let the battery of robot i sag under its motors' voltages and currents (n, W) (see `Battery.load`)."""
    drawn = 0.0
    for w in range(voltage.shape[1]):
        drawn += laws.share(voltage[i, w], b.voltage[i] + b.dead[i]) * current[i, w]
    b.drawn[i] += drawn
    b.loads[i] += 1.0
    b.voltage[i] = b.share[i] * laws.sagged(b.open[i], b.resistance[i], drawn)


def warm(i: int, m: MotorArrays, h: HeatArrays, currents: Array, speeds: Array) -> None:
    """Warm the motors of robot i (see `Motors.warm`) by currents and speeds (cycles, n, W), A and rad/s."""
    count = len(currents)
    for w in range(currents.shape[2]):
        square, outer = 0.0, 0.0
        for k in range(count):
            squared, speed = currents[k, i, w] * currents[k, i, w], np.abs(speeds[k, i, w])
            square += squared / count
            outer += laws.in_the_housing(squared, speed, m.commutation[i, w], h.dry[i, 0], h.viscous[i, 0]) / count
        air, cold, copper = h.ambient[i, 0], h.cold_resistance[i, 0], h.copper[i, 0]
        winding, housing = h.winding[i, w] - air, h.housing[i, w] - air
        inside, outside = h.conduction[0, :, i, 0], h.conduction[1, :, i, 0]
        first = air + laws.conducted(inside, winding, housing, square * m.resistance[i, w], outer)
        mean = (m.resistance[i, w] + laws.at_temperature(cold, copper, first)) / 2
        h.winding[i, w] = air + laws.conducted(inside, winding, housing, square * mean, outer)
        h.housing[i, w] = air + laws.conducted(outside, winding, housing, square * mean, outer)
        h.limited[i, w], m.held_back[i, w] = m.held_back[i, w] / count, 0.0
        m.resistance[i, w] = laws.at_temperature(cold, copper, h.winding[i, w])
        h.constant[i, w] = laws.at_temperature(h.cold_constant[i, w], h.magnet[i, 0], h.housing[i, w])
        m.speed_constant[i, w] = h.constant[i, w] * h.gear[i, 0]


def discharge(i: int, b: BatteryArrays, c: ChargeArrays, period: float) -> None:
    """Take what was drawn in a period, s, from the battery of robot i (see `Battery.discharge`)."""
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


def travel(
    i: int,
    t: TractionArrays,
    position: complex,
    heading: complex,
    velocity: complex,
    rate: float,
    load: Array,
    angle: Array,
) -> None:
    """Look at where robot i is and goes (see `Traction.travel`).

    Args:
        i: number of the robot.
        t: state.
        position: in the world, m.
        heading: unit vector.
        velocity: in the world, m/s.
        rate: of turning, rad/s.
        load: of the wheels, (n, W) N.
        angle: of the wheels, (n, W) rad.
    """
    c, body = t.carpet, velocity * heading.conjugate()
    force, moment = 0j, 0.0
    for w in range(load.shape[1]):
        outward = t.outward[w]
        friction = c.friction[i, w]
        for x, y, radius, other in c.patches[:, :, i, 0]:
            if laws.inside(position + heading * (t.arm * outward), complex(x, y), radius):
                friction = other
        friction = friction * t.grip[i, w]
        if laws.over_gap(angle[i, w], t.gap[i, w]):
            friction = 0.0
        speed, direction, held = laws.rolled(body * outward.conjugate() + 1j * t.arm * rate, t.bearing[i, 0], friction)
        pile = laws.leaning(c.pile[i, 0], c.nap[i, 0], direction * outward, heading * c.fibres[i, 0])
        drag = load[i, w] * (pile * direction + held)
        force -= drag * outward
        moment += drag.imag
        t.rims.softness[i, w] = t.creep[i, w] * speed
        t.rims.rim_friction[i, w] = laws.left_for_the_rim(friction, held, t.radius[i, w])
    world, wrench, height = force * heading, t.wrench[i], t.centre[i, 2]
    wrench[0], wrench[1] = world.real, world.imag
    wrench[3], wrench[4] = height * world.imag, -height * world.real
    wrench[5] = -t.arm * moment - t.centre[i, 0] * force.imag + t.centre[i, 1] * force.real


def press(i: int, r: RimArrays, load: Array) -> None:
    """Find limit and creep of the wheels of robot i under their loads (n, W) in N (see `Traction.press`)."""
    for w in range(load.shape[1]):
        pressed = laws.pressed(load[i, w])
        r.limit[i, w] = r.rim_friction[i, w] * pressed
        r.impedance[i, w] = pressed / (pressed + r.softness[i, w])

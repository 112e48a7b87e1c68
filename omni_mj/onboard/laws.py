"""Laws of what is on a robot, without state: encoders, wheel loops, drivers and motors, battery, wheels on carpet.

Each holds for single numbers and for columns of them alike: numpy reckons with all robots at once
(`physics.kernel = "numpy"`), a compiled loop goes from robot to robot and wheel to wheel (`"numba"`, see `by_robot`).
Both are this source, so that they differ by rounding alone. Conditions are `where`, so that several robots go through a
processor's wide registers together.
"""

from typing import Any

import numpy as np

Number = Any  # a float, or an array of floats
Vector = Any  # of the plane: a complex number, or an array of them
Truth = Any  # a bool, or an array of bools
Some = tuple[int, int] | None  # robots: the number of the first, and that after the last; or the only one there is

REFERENCE_C = 25.0  # at which the datasheet gives resistance and torque constant
# Open-circuit voltage of a LiPo cell over its state of charge: 4.2 V full, 3.7 V nominal at half, steep below a tenth.
CHARGE = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0])
CELL_V = np.array([3.0, 3.4, 3.55, 3.63, 3.66, 3.70, 3.83, 4.05, 4.2])
CUT_OFF_S = 1.0  # time constant with which the battery's cut-off sees the voltage
AT_REST_M_S = 0.01  # below it, dry drag fades, and a robot comes to rest
DERATE_BAND_K = 10.0  # derating begins this far below the limit
LEAST_LOAD_N = 1e-3  # of a wheel in the air
TOPPLED = np.sin(np.deg2rad(45) / 2) ** 2  # sine squared of half the tilt: x^2 + y^2 of the quaternion


def where(condition: Truth, one: Number, other: Number) -> Number:
    """One of two, by a condition; `other` itself, in its own shape, where that holds nowhere (compiled: `wide`)."""
    return np.where(condition, one, other) if np.count_nonzero(condition) else other


def count(number: int) -> int:
    """The number of a robot, 0 or more (compiled: `wide`)."""
    return number


def each(some: Some) -> range:
    """Numbers of some robots; where it is the only one, a compiler knows, and makes no loop of it."""
    if some is None:
        return range(count(0), count(1))
    return range(count(some[0]), count(some[1]))


def direction(angle: Number) -> tuple[Number, Number]:
    """Cosine and sine of an angle, rad (compiled: `wide`)."""
    return np.cos(angle), np.sin(angle)


def along(x: Number, y: Number, forward: Number, left: Number) -> tuple[Number, Number]:
    """Speeds of a wheel, rad/s, for a velocity in m/s, at heading 0 and at 90 degrees (equation 3).

    Args:
        x: velocity.
        y: same.
        forward: speed of the wheel per velocity ahead, rad/m.
        left: per velocity aside.
    """
    return x * forward + y * left, y * forward - x * left


def told_turn(rate: Number, gain: Number) -> Number:
    """Turn rate asked for, rad/s, of which a turn-rate loop of a gain takes off that of the gyro, gain times."""
    return rate * (1 + gain)


def swing(winding: Number, hot: Number, derated: Number, resistance: Number) -> Number:
    """How far a motor's voltage may be from its back-EMF, V: infinitely, but where the winding is close to its limit.

    Args:
        winding: temperature, deg C.
        hot: limit, at which no current is left.
        derated: current where derating begins, A.
        resistance: of the terminals, ohm.
    """
    left = np.minimum(np.maximum((hot - winding) / DERATE_BAND_K, 0.0), 1.0)
    return where(left < 1, resistance * (left * derated), np.inf)


def wheel_speed(cosine: Number, sine: Number, along_x: Number, along_y: Number, turn: Number) -> Number:
    """Speed wanted of a wheel, rad/s: it is linear in cosine and sine of the heading, which alone change in a frame.

    Args:
        cosine: of the heading.
        sine: same.
        along_x: the wheel's speed for the command if the heading were 0, rad/s.
        along_y: if it were 90 degrees.
        turn: its speed for the turn rate, rad/s.
    """
    return cosine * along_x + sine * along_y + turn


def shown(angle: Number, scale: Number, shift: Number) -> Number:
    """Angle that an encoder shows, rad, of a wheel at another."""
    return scale * angle + shift


def counted(angle: Number, counts_per_rad: Number) -> Number:
    """Counts of an encoder at an angle of the wheel, rad."""
    return np.floor(angle * counts_per_rad)


def proportional(wanted: Number, speed: Number, kp: Number, back_emf: Number) -> tuple[Number, Number]:
    """Wheel loop of feed-forward and proportional part.

    Args:
        wanted: of the wheel, rad/s.
        speed: that it has.
        kp: V s/rad.
        back_emf: that is fed forward, V s/rad.

    Returns:
        Voltage, V, and the error, rad/s.
    """
    error = wanted - speed
    return back_emf * wanted + kp * error, error


def integrated(
    voltage: Number,
    error: Number,
    last_error: Number,
    integral: Number,
    ki: Number,
    kd: Number,
    timestep: Number,
    nominal: Number,
) -> tuple[Number, Number, Truth]:
    """Add the integral and the derivative part to the `voltage` of the others.

    Anti-windup: while the voltage is beyond its limit, an error that pushes further is not integrated.

    Args:
        voltage: of `proportional`, V.
        error: same, rad/s.
        last_error: that of the loop's last run.
        integral: of the error, rad.
        ki: V/rad.
        kd: V s^2/rad.
        timestep: between runs, s.
        nominal: limit of the voltage, V.

    Returns:
        Voltage, the integral with this error, and whether that is not to be kept.
    """
    voltage = voltage + kd * (error - last_error) / timestep
    more = integral + error * timestep
    voltage = voltage + ki * more
    return voltage, more, (np.abs(voltage) > nominal) & (voltage * error > 0)


def derated(voltage: Number, back_emf: Number, swing: Number) -> Number:
    """The voltage held within `swing` of the back-EMF, all in V, which limits the current."""
    return np.minimum(np.maximum(voltage, back_emf - swing), back_emf + swing)


def share(voltage: Number, whole: Number) -> Number:
    """How much a voltage is of the whole, in [-1, 1]."""
    return np.minimum(np.maximum(voltage / whole, -1.0), 1.0)


def current(
    voltage: Number, speed: Number, speed_constant: Number, resistance: Number, commutation: Number
) -> tuple[Number, Number, Number]:
    """Current of a motor at a voltage, V, and a speed of its wheel, rad/s.

    Args:
        voltage: at the terminals.
        speed: of the wheel.
        speed_constant: V s/rad of the wheel.
        resistance: of the terminals at rest, ohm.
        commutation: what commutation adds to it per speed of the wheel, ohm s/rad.

    Returns:
        Current in A, back-EMF in V, resistance at this speed in ohm.
    """
    back_emf = speed_constant * speed
    turning = resistance + commutation * np.abs(speed)
    return (voltage - back_emf) / turning, back_emf, turning


def voltage(current: Number, speed: Number, speed_constant: Number, resistance: Number, commutation: Number) -> Number:
    """The voltage at which a motor has a current, A, at a speed of its wheel: the inverse of `current`."""
    return speed_constant * speed + current * (resistance + commutation * np.abs(speed))


def held_back(amperes: Number, limit: Number, back_emf: Number, turning: Number) -> tuple[Number, Number]:
    """Voltage and current of a motor whose driver holds a current beyond its limit to that, A."""
    held = np.copysign(limit, amperes)
    return back_emf + held * turning, held


def in_the_housing(square: Number, speed: Number, commutation: Number, dry: Number, viscous: Number) -> Number:
    """What a motor loses in the stator's iron and the bearings, W.

    Args:
        square: of the current, A^2.
        speed: of the wheel, its magnitude, rad/s.
        commutation: see `current`.
        dry: friction at the wheel, N m.
        viscous: same, N m s/rad.
    """
    return speed * (commutation * square + dry + viscous * speed)


def conducted(solution: Any, winding: Number, housing: Number, inner: Number, outer: Number) -> Number:
    """Temperature of one of a motor's two nodes over the air after a period, K.

    Args:
        solution: what it becomes for each of the following (4, ...).
        winding: over the air before, K.
        housing: same.
        inner: heat into the winding, W.
        outer: into the housing.
    """
    return solution[0] * winding + solution[1] * housing + solution[2] * inner + solution[3] * outer


def at_temperature(cold: Number, per_k: Number, temperature: Number) -> Number:
    """A resistance or torque constant at a temperature, deg C, from that at 25 deg C."""
    return cold * (1 + per_k * (temperature - REFERENCE_C))


def open_circuit(charge: Number) -> Number:
    """Voltage of a cell that gives no current, at its state of charge."""
    return np.interp(charge, CHARGE, CELL_V)


def sagged(open_v: Number, resistance: Number, drawn: Number) -> Number:
    """Voltage of a battery from which a current is drawn, A."""
    return open_v - resistance * drawn


def inside(place: Vector, centre: Vector, radius: Number) -> Truth:
    """Whether a place is in a round patch."""
    apart = place - centre
    return apart.real * apart.real + apart.imag * apart.imag < radius * np.abs(radius)


def leaning(pile: Number, nap: Number, direction: Vector, fibres: Vector) -> Number:
    """Rolling resistance over load of a pile whose fibres lean, to a wheel that goes in a direction."""
    return pile * (1 + nap * (direction * fibres).real)


def rolled(velocity: Vector, bearing: Number, friction: Number) -> tuple[Number, Vector, Number]:
    """How a wheel goes over the carpet.

    Args:
        velocity: of its contact, in the wheel's frame, the part along the axle first, m/s.
        bearing: coefficient of friction of the rollers' bearings.
        friction: of the carpet.

    Returns:
        Speed in m/s, direction, which fades when the wheel comes to rest, and the bearings' drag over load.
    """
    axle, along = velocity.real, velocity.imag
    speed = np.sqrt(axle * axle + along * along)
    least = np.minimum(bearing, friction)  # on ice, rollers slide before they turn
    return speed, velocity * (1 / np.maximum(speed, AT_REST_M_S)), least / np.maximum(np.abs(axle), AT_REST_M_S) * axle


def over_gap(angle: Number, gap: Number) -> Truth:
    """Whether a wheel stands where rollers are missing, at an angle of its own, over so wide a gap, both in rad."""
    return angle % (2 * np.pi) < gap


def left_for_the_rim(friction: Number, held: Number, radius: Number) -> Number:
    """Highest torque over load about the axle, m, where the bearings have their part of the friction circle."""
    return np.sqrt(np.maximum(friction**2 - held * held, 0.0)) * radius


def heading(w: Number, x: Number, y: Number, z: Number) -> Number:
    """Heading of a robot, in (-pi, pi], by its quaternion, whatever it is tilted by."""
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def toppled(x: Number, y: Number) -> Truth:
    """Whether a robot is tilted by more than 45 degrees, by its quaternion."""
    return x * x + y * y > TOPPLED


def pressed(load: Number) -> Number:
    """Load of a wheel, N; a little of one in the air."""
    return np.maximum(load, LEAST_LOAD_N)

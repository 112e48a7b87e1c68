"""What compiled loops read and write of n robots with W wheels: plain arrays of firmware, motors, battery and traction.

The classes whose `arrays` they are say what each is. Those of wheels are (W, n) here, so that the same number of all
robots is in one piece, which several at once are read from; the classes see them the other way round. Handing an array
to a compiled function costs 0.2 us, so that what is handed over in every cycle are blocks of them, (k, n) or (k, W, n):
`firmware`, `motors`, `battery` and `rims` give their parts, in Python as in loops.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array


def filled(values: Array | float, shape: tuple[int, int]) -> Array:
    """An array of the shape (n, W) that is (W, n) in memory."""
    array = np.empty(shape[::-1]).T
    array[:] = values
    return array


def plain(values: Array) -> Array:
    """A column (n, 1) as a single number (1, 1) where all are the same, with which numpy reckons faster."""
    return values[:1] if (values == values[0]).all() else values


def total(each: np.ndarray) -> np.ndarray:
    """Sums over wheels of (W, ..., n), one after the other: numpy's own would round by the number of robots."""
    found: np.ndarray = each[0] + each[1]
    for wheel in each[2:]:
        found += wheel
    return found


class FirmwareArrays(NamedTuple):
    """Of `Firmware` and its heading.

    A loop writes heading, bias, turn_rate, stops, due, cosine, sine, turning, along_x, along_y, swing, last_count,
    integral, last_error and held.
    """

    heading: Array  # (n,) rad
    bias: Array  # of the gyro, (n,) rad/s
    turn_rate: Array  # commanded, (n,) rad/s, times 1 + turn_gain
    turn_gain: Array  # (n,)
    timestep: Array  # of the loops, (n,) s
    every: Array  # cycles from one run of the loops to the next, (n,)
    stops: Array  # cycle from which the robot stands, (n,)
    body: Array  # whether commands are along the robot's own axes, 0 or 1, (n,)
    off: Array  # whether no loop runs, 0 or 1, (n,)
    gyro_scale: Array  # factor of what the gyro shows, (n,)
    due: Array  # whether the loops run in this cycle, 0 or 1, (n,)
    cosine: Array  # of the heading by which commands are turned, (n,); 0 of one that stands
    sine: Array  # same
    turning: Array  # turn rate wanted, (n,) rad/s
    counts_per_rad: Array  # (n,)
    rate_per_count: Array  # (n,) rad/s
    kp: Array  # (n,) V s/rad
    ki: Array  # (n,) V/rad
    kd: Array  # (n,) V s^2/rad
    back_emf: Array  # fed forward, (n,) V s/rad
    speed_constant: Array  # of the datasheet, (n,) V s/rad
    nominal: Array  # (n,) V
    patience: Array  # cycles from a new command to when the robot stands, (n,)
    ignores: Array  # whether the robot obeys no command, 0 or 1, (n,)
    told_x: Array  # command, (n,) m/s
    told_y: Array  # same
    told_turn: Array  # same, (n,) rad/s
    new: Array  # whether it has just arrived, 0 or 1, (n,)
    seen: Array  # heading that vision saw, (n,) rad, or not a number
    age: Array  # frames since it was sent, (n,)
    heading_share: Array  # of its error, by which the heading is put right, (n,)
    bias_share: Array  # and the gyro's bias, (n,) 1/s
    hot: Array  # where derating ends, (n,) deg C; infinite of a robot without
    derated: Array  # current where it begins, (n,) A
    resistance: Array  # of the datasheet, (n,) ohm
    turn: Array  # wheel speed per turn rate, (W, n)
    along_x: Array  # wheel speeds for the command at heading 0, (W, n) rad/s
    along_y: Array  # at 90 degrees
    rims: Array  # speeds of the wheels for rim speeds commanded, (W, n) rad/s, or not a number
    swing: Array  # from the back-EMF, at most, (W, n) V
    last_count: Array  # (W, n)
    integral: Array  # (W, n) rad
    last_error: Array  # (W, n) rad/s
    held: Array  # duties, (W, n)
    count_scale: Array  # what encoders show over the angles of wheels, (W, n)
    count_shift: Array  # and besides, (W, n) rad
    forward: Array  # wheel speed per velocity ahead, (W, n) rad/m
    left: Array  # and aside


class MotorArrays(NamedTuple):
    """Of `Motors`; a loop adds to held_back."""

    speed_constant: Array  # (W, n) V s/rad
    resistance: Array  # (W, n) ohm
    commutation: Array  # (W, n) ohm s/rad
    limit: Array  # (W, n) A
    held_back: Array  # steps in which the driver held the current back, (W, n)


class HeatArrays(NamedTuple):
    """Of `Motors`, what changes from frame to frame: a loop writes winding, housing, constant and limited."""

    winding: Array  # (W, n) deg C
    housing: Array  # (W, n) deg C
    constant: Array  # (W, n) N m/A
    limited: Array  # (W, n)
    cold_resistance: Array  # (n,) ohm
    cold_constant: Array  # (W, n) N m/A
    ambient: Array  # (n,) deg C
    copper: Array  # (n,) 1/K
    magnet: Array  # (n,) 1/K
    gear: Array  # (n,)
    dry: Array  # at the wheel, (n,) N m
    viscous: Array  # (n,) N m s/rad
    conduction: Array  # (2, 4, n)


class ChargeArrays(NamedTuple):
    """Of `Battery`, what changes from frame to frame: a loop writes charge, average and alive."""

    charge: Array  # (n,)
    average: Array  # voltage that the protection sees, (n,) V
    alive: np.ndarray  # (n,)
    cells: Array  # (n,)
    capacity: Array  # (n,) A s
    cut_off: Array  # (n,) V


class BatteryArrays(NamedTuple):
    """Of `Battery`; a loop writes voltage, and adds to drawn and loads."""

    open: Array  # (n,) V
    resistance: Array  # (n,) ohm
    dead: Array  # infinite of one that gives no more power, else 0, (n,)
    voltage: Array  # (n,) V
    drawn: Array  # sum of the currents, (n,) A
    loads: Array  # number of them, (n,)
    share: Array  # of its voltage that comes through, (n,)


class RimArrays(NamedTuple):
    """Of `Traction`, what loads act on: a loop writes all."""

    softness: Array  # (W, n) N
    rim_friction: Array  # (W, n) m
    limit: Array  # (W, n) N m
    impedance: Array  # (W, n)


class CarpetArrays(NamedTuple):
    """Of `Carpet`."""

    friction: Array  # but on patches, (W, n)
    patches: Array  # x, y and radius in m, friction: (patches, 4, n)
    pile: Array  # (n,)
    nap: Array  # (n,)
    fibres: np.ndarray  # against which way they lean, conjugate, (n,)


class TractionArrays(NamedTuple):
    """Of `Traction`; a loop writes rims, friction and wrench."""

    outward: np.ndarray  # direction of the axles, (W,)
    arm: float  # m
    centre: Array  # (3, n) m
    carpet: CarpetArrays
    grip: Array  # (W, n), a factor
    gap: Array  # where rollers are missing, from a wheel's angle 0 on, (W, n) rad
    gaps: bool  # whether any are
    bearing: Array  # (n,)
    radius: Array  # (W, n) m
    creep: Array  # (W, n) N s/m
    rims: RimArrays
    friction: Array  # under each wheel, (W, n)
    wrench: Array  # (6, n)


FIRMWARE_ROBOTS, FIRMWARE_WHEELS = 35, 13  # of the fields above, how many are (n,), and how many (W, n)
MOTORS, BATTERY, RIMS = (len(kind._fields) for kind in (MotorArrays, BatteryArrays, RimArrays))  # fields of each


def firmware(r: Array, w: Array) -> FirmwareArrays:
    """The parts of `r` (35, n) and `w` (13, W, n)."""
    state = r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15], r[16]
    more = r[17], r[18], r[19], r[20], r[21], r[22], r[23], r[24], r[25], r[26], r[27], r[28], r[29], r[30], r[31]
    last = r[32], r[33], r[34], w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7], w[8], w[9], w[10], w[11], w[12]
    return FirmwareArrays(*state, *more, *last)


def motors(w: Array) -> MotorArrays:
    """The parts of `w` (5, W, n)."""
    return MotorArrays(w[0], w[1], w[2], w[3], w[4])


def battery(r: Array) -> BatteryArrays:
    """The parts of `r` (7, n)."""
    return BatteryArrays(r[0], r[1], r[2], r[3], r[4], r[5], r[6])


def rims(w: Array) -> RimArrays:
    """The parts of `w` (4, W, n)."""
    return RimArrays(w[0], w[1], w[2], w[3])

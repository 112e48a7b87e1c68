"""What compiled loops read and write of n robots with W wheels: plain arrays of firmware, motors, battery and traction.

The classes whose `arrays` they are say what each is. Handing an array to a compiled function costs 0.2 us, so that what
is handed over in every cycle are blocks of them, (k, n) or (k, n, W): `firmware`, `motors`, `battery` and `rims` give
their parts, in Python as in loops.
"""

from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array


class FirmwareArrays(NamedTuple):
    """Of `Firmware` and its heading; a loop writes heading, last_count, integral, last_error and held."""

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
    radius: Array  # of the wheels, (n,) m
    counts_per_rad: Array  # (n,)
    rate_per_count: Array  # (n,) rad/s
    kp: Array  # (n,) V s/rad
    ki: Array  # (n,) V/rad
    kd: Array  # (n,) V s^2/rad
    back_emf: Array  # fed forward, (n,) V s/rad
    speed_constant: Array  # of the datasheet, (n,) V s/rad
    nominal: Array  # (n,) V
    turn: Array  # wheel speed per turn rate, (n, W)
    along_x: Array  # wheel speeds for the command at heading 0, (n, W) rad/s
    along_y: Array  # at 90 degrees
    rims: Array  # rim speeds commanded, (n, W) m/s, or not a number
    swing: Array  # from the back-EMF, at most, (n, W) V
    last_count: Array  # (n, W)
    integral: Array  # (n, W) rad
    last_error: Array  # (n, W) rad/s
    held: Array  # duties, (n, W)
    count_scale: Array  # what encoders show over the angles of wheels, (n, W)
    count_shift: Array  # and besides, (n, W) rad


class MotorArrays(NamedTuple):
    """Of `Motors`; a loop adds to held_back."""

    speed_constant: Array  # (n, W) V s/rad
    resistance: Array  # (n, W) ohm
    commutation: Array  # (n, W) ohm s/rad
    limit: Array  # (n, W) A
    held_back: Array  # steps in which the driver held the current back, (n, W)


class HeatArrays(NamedTuple):
    """Of `Motors`, what changes from frame to frame: a loop writes winding, housing, constant and limited."""

    winding: Array  # (n, W) deg C
    housing: Array  # (n, W) deg C
    constant: Array  # (n, W) N m/A
    limited: Array  # (n, W)
    cold_resistance: Array  # (n, 1) ohm
    cold_constant: Array  # (n, W) N m/A
    ambient: Array  # (n, 1) deg C
    copper: Array  # (n, 1) 1/K
    magnet: Array  # (n, 1) 1/K
    gear: Array  # (n, 1)
    dry: Array  # at the wheel, (n, 1) N m
    viscous: Array  # (n, 1) N m s/rad
    conduction: Array  # (2, 4, n, 1)


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

    softness: Array  # (n, W) N
    rim_friction: Array  # (n, W) m
    limit: Array  # (n, W) N m
    impedance: Array  # (n, W)


class CarpetArrays(NamedTuple):
    """Of `Carpet`."""

    friction: Array  # but on patches, (n, W)
    patches: Array  # x, y and radius in m, friction: (patches, 4, n, 1)
    pile: Array  # (n, 1)
    nap: Array  # (n, 1)
    fibres: np.ndarray  # against which way they lean, conjugate, (n, 1)


class TractionArrays(NamedTuple):
    """Of `Traction`; a loop writes rims and wrench."""

    outward: np.ndarray  # direction of the axles, (W,)
    arm: float  # m
    centre: Array  # (n, 3) m
    carpet: CarpetArrays
    grip: Array  # (n, W), a factor
    gap: Array  # where rollers are missing, from a wheel's angle 0 on, (n, W) rad
    bearing: Array  # (n, 1)
    radius: Array  # (n, W) m
    creep: Array  # (n, W) N s/m
    rims: RimArrays
    wrench: Array  # (n, 6)


FIRMWARE_ROBOTS, FIRMWARE_WHEELS = 19, 11  # of the fields above, how many are (n,), and how many (n, W)


def firmware(r: Array, w: Array) -> FirmwareArrays:
    """The parts of `r` (19, n) and `w` (11, n, W)."""
    state = r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], r[9], r[10], r[11], r[12], r[13], r[14], r[15], r[16]
    more = r[17], r[18], w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7], w[8], w[9], w[10]
    return FirmwareArrays(*state, *more)


def motors(w: Array) -> MotorArrays:
    """The parts of `w` (5, n, W)."""
    return MotorArrays(w[0], w[1], w[2], w[3], w[4])


def battery(r: Array) -> BatteryArrays:
    """The parts of `r` (7, n)."""
    return BatteryArrays(r[0], r[1], r[2], r[3], r[4], r[5], r[6])


def rims(w: Array) -> RimArrays:
    """The parts of `w` (4, n, W)."""
    return RimArrays(w[0], w[1], w[2], w[3])

"""What compiled loops read and write of n robots with W wheels: plain arrays of firmware, motors, battery and traction.

An array holds (n,) or (n, W) numbers; (n, 1) those that are alike for a robot's wheels. The classes whose `arrays` they
are say what each is.
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
    timestep: Array  # of the loops, (n, 1) s
    every: Array  # cycles from one run of the loops to the next, (n, 1)
    stops: Array  # cycle from which the robot stands, (n,)
    body: np.ndarray  # whether commands are along the robot's own axes, (n,)
    along_x: Array  # wheel speeds for the command at heading 0, (n, W) rad/s
    along_y: Array  # at 90 degrees
    wheels: Array  # rim speeds commanded, (n, W) m/s, or not a number
    turn: Array  # wheel speed per turn rate, (W,)
    radius: float  # of the wheels, m
    counts_per_rad: Array  # (n, 1)
    rate_per_count: Array  # (n, 1) rad/s
    last_count: Array  # (n, W)
    kp: Array  # (n, 1) V s/rad
    ki: Array
    kd: Array
    back_emf: Array  # fed forward, (n, 1) V s/rad
    speed_constant: Array  # of the datasheet, (n, 1) V s/rad
    nominal: Array  # (n, 1) V
    swing: Array  # from the back-EMF, at most, (n, W) V
    integral: Array  # (n, W) rad
    last_error: Array  # (n, W) rad/s
    held: Array  # duties, (n, W)


class MotorArrays(NamedTuple):
    """Of `Motors`; a loop adds to held_back."""

    speed_constant: Array  # (n, W) V s/rad
    resistance: Array  # (n, W) ohm
    commutation: Array  # (n, 1) ohm s/rad
    limit: Array  # (n, W) A
    held_back: Array  # steps in which the driver held the current back, (n, W)


class BatteryArrays(NamedTuple):
    """Of `Battery`; a loop writes voltage, and adds to drawn and loads."""

    open: Array  # (n,) V
    resistance: Array  # (n,) ohm
    dead: Array  # infinite of one that gives no more power, else 0, (n,)
    voltage: Array  # (n,) V
    drawn: Array  # sum of the currents, (n,) A
    loads: Array  # number of them, (n,)


class CarpetArrays(NamedTuple):
    """Of `Carpet`."""

    friction: Array  # but on patches, (n, W)
    patches: Array  # x, y and radius in m, friction: (patches, 4, n, 1)
    pile: Array  # (n, 1)
    nap: Array  # (n, 1)
    fibres: np.ndarray  # against which way they lean, conjugate, (n, 1)


class TractionArrays(NamedTuple):
    """Of `Traction`; a loop writes softness, rim_friction and wrench, limit and impedance."""

    outward: np.ndarray  # direction of the axles, (W,)
    arm: float  # m
    centre: Array  # (n, 3) m
    carpet: CarpetArrays
    grip: Array  # (n, W), a factor
    bearing: Array  # (n, 1)
    radius: Array  # (n, W) m
    creep: Array  # (n, W) N s/m
    softness: Array  # (n, W) N
    rim_friction: Array  # (n, W) m
    wrench: Array  # (n, 6)
    limit: Array  # (n, W) N m
    impedance: Array  # (n, W)

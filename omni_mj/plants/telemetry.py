"""Telemetry of wheels, motors and battery at a frame, as one array with named columns."""

from functools import cache
from typing import Self

import numpy as np

from omni_control.kinematics import Array


class Telemetry:
    """Quantities of n robots with W wheels at a frame; NaN on a plant without wheels.

    Peaks and means are over the cycles of the latest frame.

    Args:
        columns: All quantities, concatenated in the order of the attributes, (n, 10 W + 4). The
            attributes are views of it.

    Attributes:
        wheel_angle: Angles of the wheels, (n, W) rad.
        wheel_speed: Speeds of the wheels, (n, W) rad/s.
        voltage: Motor voltages, (n, W) V.
        current: Motor currents, (n, W) A.
        voltage_mean: Mean motor voltages, (n, W) V.
        current_mean: Mean motor currents, (n, W) A.
        duty_peak: Largest duty cycle of any motor, 1 for the battery's full voltage, (n,).
        voltage_peak: Largest magnitude of the voltages of all motors, (n,) V.
        current_peak: Largest magnitude of the currents of all motors, (n,) A.
        current_limited: Fraction of the cycles in which the driver limited the current, (n, W).
        winding: Temperatures of the windings, (n, W) deg C.
        housing: Temperatures of the housings, (n, W) deg C.
        battery: Voltage of the battery under load, (n,) V.
        slip: Speed at which rims slide over the carpet, (n, W) m/s.
    """

    wheel_angle: Array
    wheel_speed: Array
    voltage: Array
    current: Array
    voltage_mean: Array
    current_mean: Array
    duty_peak: Array
    voltage_peak: Array
    current_peak: Array
    current_limited: Array
    winding: Array
    housing: Array
    battery: Array
    slip: Array

    def __init__(self, columns: Array) -> None:
        self.columns = columns

    def __getattr__(self, name: str) -> Array:
        """Return a quantity by its name."""
        if name not in TELEMETRY_NAMES:
            raise AttributeError(f"telemetry has no {name!r}")
        return self.columns[:, locate_columns(self.columns.shape[1])[name]]

    @classmethod
    def without_wheels(cls, n: int, n_wheels: int) -> Self:
        """Return telemetry of NaN, for n robots on a plant without wheels.

        Args:
            n: Number of robots.
            n_wheels: Number of wheels W that sets the number of columns.
        """
        return cls(np.full((n, _N_PER_WHEEL * n_wheels + len(_PER_ROBOT)), np.nan))


TELEMETRY_NAMES = tuple(Telemetry.__annotations__)
_PER_ROBOT = {"duty_peak", "voltage_peak", "current_peak", "battery"}  # the others are per wheel
_N_PER_WHEEL = len(TELEMETRY_NAMES) - len(_PER_ROBOT)


@cache
def locate_columns(n_columns: int) -> dict[str, slice | int]:
    """Return the column, or slice of columns, of each quantity by its name."""
    n_wheels = (n_columns - len(_PER_ROBOT)) // _N_PER_WHEEL
    columns = dict[str, slice | int]()
    start = 0
    for name in TELEMETRY_NAMES:
        end = start + (1 if name in _PER_ROBOT else n_wheels)
        columns[name] = start if name in _PER_ROBOT else slice(start, end)
        start = end
    return columns

"""The plants: what moves when commanded. All answer the same few calls, so every controller runs on each."""

from functools import cache
from typing import Protocol

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.network.radio import ReceivedCommand


class Telemetry:
    """What the robots' W wheels and motors are doing at a frame; not a number on a plant that has none.

    wheel_angle (n, W) rad, wheel_speed (n, W) rad/s, voltage (n, W) V, current (n, W) A, and both
    as means over the frame just past, voltage_mean and current_mean; and the largest magnitudes
    over the motors and the physics steps of that frame: duty_peak (n,), 1 where a motor had all of
    the battery's voltage, voltage_peak (n,) V, current_peak (n,) A. current_limited (n, W): the
    share of these steps in which the driver held a motor's current back. Temperatures of windings
    and housings (n, W) in deg C, the battery's voltage under load (n,) in V, and the speed at which
    the wheels' contact points slide over the carpet, slip (n, W) m/s.

    Args:
        columns: all of it side by side in the order above, (n, 10 W + 4), of which the others are
            parts.
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
        """A part, by its name."""
        if name not in NAMES:
            raise AttributeError(f"telemetry has no {name!r}")
        wheels = (self.columns.shape[1] - len(_SINGLE)) // _EACH_WHEEL
        part: Array = self.columns[:, places(wheels)[name]]
        return part

    @classmethod
    def of_no_wheels(cls, n: int, wheels: int = 4) -> "Telemetry":
        """That of n robots on a plant that has no wheels, in the columns of a robot that has."""
        return cls(np.full((n, _EACH_WHEEL * wheels + len(_SINGLE)), np.nan))


NAMES = tuple(Telemetry.__annotations__)
_SINGLE = {
    "duty_peak",
    "voltage_peak",
    "current_peak",
    "battery",
}  # of a robot, the others of each of its wheels
_EACH_WHEEL = len(NAMES) - len(_SINGLE)


@cache
def places(wheels: int) -> dict[str, slice | int]:
    """Where the parts are in the columns of telemetry of robots with so many wheels."""
    found, column = dict[str, slice | int](), 0
    for name in NAMES:
        width = 1 if name in _SINGLE else wheels
        found[name] = column if name in _SINGLE else slice(column, column + width)
        column += width
    return found


class Plant(Protocol):
    """n robots, made from their rows and the poses (n, 3) at which they start: `MujocoPlant(rows, start)`.

    Attributes:
        geometry: of the wheels, or None for a plant that has none.
    """

    geometry: Kinematics | None

    def pose(self) -> Array:
        """True poses (n, 3) now; headings count full turns."""
        ...

    def twist(self) -> Array:
        """True twists (n, 3) now, world frame."""
        ...

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """Move on by one frame in which the robots obey what they `received`.

        Returns:
            The rows that failed in this frame, each with the cause in words. A row that has failed
            stays where it is and disturbs no other; its poses mean nothing any more.
        """
        ...

    def telemetry(self) -> Telemetry:
        """Wheels and motors now."""
        ...

"""When to be where on a path, and the drive in whole frames that follows such a timetable within all limits."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.traction import WheelLimits

ROUNDING = 1e-9  # by which limits may be passed, relative
_WINDOWS = 24  # lengths of smoothing that are tried
_LESS = 1.005  # how many times less is asked of wheels, at least, where it was too much


@dataclass(frozen=True)
class Timetable:
    """Times (n,) at which the places u (n,) on a path are passed, and du/dt there (n,), linear in time in between."""

    time: Array
    place: Array
    rate: Array

    @classmethod
    def of_rates(cls, step: float, rate: Array) -> "Timetable":
        """That of places a `step` apart, from 0 on, at du/dt (n,)."""
        time = np.append(0.0, np.cumsum(2 * step / (rate[:-1] + rate[1:])))
        return cls(time, step * np.arange(len(rate), dtype=float), rate)

    def at(self, time: Array) -> Array:
        """Places at times (frames,)."""
        i = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        since, duration = time - self.time[i], self.time[i + 1] - self.time[i]
        return self.place[i] + since * (
            self.rate[i] + since / duration * (self.rate[i + 1] - self.rate[i]) / 2
        )


def driven(
    path: Callable[[Array], Array], timetable: Timetable, limits: MotionLimits, period: float
) -> Array:
    """Poses (frames, 3) from rest to rest on a path, by a timetable that keeps limits of velocity and acceleration.

    The limits hold for the differences between sampled poses, since those are means of the velocity
    and acceleration over a frame or two, and a mean vector is no longer than the longest it is made
    of. To end with a frame, for the little by which steps from cell to cell are off, and for what a
    body that turns within these frames would be asked beyond its ellipse, the whole of it is driven
    slower.

    Where jerk is limited, the timetable is smoothed: each frame is at the mean of the places of
    some frames up to then, which is on the path as well. How many are best is tried out. What
    wheels can do at once is not looked at.

    Args:
        path: poses (frames, 3) at places (frames,).
        timetable: of these places.
        limits: velocity, acceleration and jerk limits.
        period: length of a frame, s.
    """
    best = None
    for window in _windows(limits, period):
        frames, excess = math.ceil(timetable.time[-1] / period), math.inf
        while excess > 1 + ROUNDING and (best is None or frames + window <= len(best)):
            places = timetable.at(np.linspace(0, timetable.time[-1], frames + 1))
            poses = path(
                np.convolve(
                    np.pad(places, window - 1, mode="edge"), np.full(window, 1 / window), "valid"
                )
            )
            excess = limits.required_time_scale(poses, period)
            frames = math.ceil(frames * excess)
        if excess <= 1 + ROUNDING:
            best = poses
    assert best is not None
    return best


def driven_on_wheels(
    path: Callable[[Array], Array],
    timetable: Callable[[float], Timetable],
    limits: MotionLimits,
    wheels: WheelLimits,
    period: float,
) -> Array:
    """The same, within what wheels can do at once.

    Args:
        path: as for `driven`.
        timetable: that of the fastest drive which asks for so large a share of what the wheels can
            do.
        limits: as for `driven`.
        wheels: whose.
        period: as for `driven`.

    Raises:
        OmniError: wheels can do little more than pull what drags them.
    """
    share = 1.0
    while share > wheels.max_drag_fraction:
        poses = driven(path, timetable(share), limits, period)
        if (asked := max(wheels.compute_peak_utilization(poses, period))) <= 1 + ROUNDING:
            return poses
        share /= max(asked, _LESS)  # smoothing and whole frames asked for more
    raise OmniError(
        f"on a carpet of friction {wheels.friction:g} wheels hardly do more than pull what drags them"
    )


def bearable(poses: Array, wheels: WheelLimits, period: float) -> bool:
    """Whether wheels can do at once what a drive asks."""
    return max(wheels.compute_peak_utilization(poses, period)) <= 1 + ROUNDING


def _windows(limits: MotionLimits, period: float) -> list[int]:
    """Frames over which to smooth: up to thrice a / j, as from full acceleration one way to the other takes 2 a / j."""
    swings = (limits.acceleration, limits.jerk), (limits.turn_acceleration, limits.turn_jerk)
    longest = 3 * max(change / (jerk or np.inf) for change, jerk in swings) / period
    return sorted({max(round(longest * part / _WINDOWS), 1) for part in range(1, _WINDOWS + 1)})

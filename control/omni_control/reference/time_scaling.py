"""Time scaling: drive along a path in whole frames, slowed down until all limits hold."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.traction import WheelLimits

ROUNDING = 1e-9  # relative tolerance of limits
_N_WINDOWS = 24  # number of smoothing windows that are tried
_MIN_REDUCTION = 1.005  # least factor by which the demand on wheels is reduced when it was too high


@dataclass(frozen=True)
class PathTiming:
    """Parameter u of a path over time; its rate is linear in time between samples.

    Args:
        time: Times of the samples, (n,) s.
        parameter: u at these times, (n,).
        rate: du/dt at these times, (n,) 1/s.
    """

    time: Array
    parameter: Array
    rate: Array

    @classmethod
    def from_rates(cls, step: float, rate: Array) -> "PathTiming":
        """Return the timing for rates (n,) at parameters 0, `step`, 2 `step`, ..."""
        time = np.append(0.0, np.cumsum(2 * step / (rate[:-1] + rate[1:])))
        return cls(time, step * np.arange(len(rate), dtype=float), rate)

    def get_parameter(self, time: Array) -> Array:
        """Return the parameters (frames,) at times (frames,)."""
        i = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        elapsed, duration = time - self.time[i], self.time[i + 1] - self.time[i]
        mean_rate = self.rate[i] + elapsed / duration * (self.rate[i + 1] - self.rate[i]) / 2
        return self.parameter[i] + elapsed * mean_rate


def sample_path(
    path: Callable[[Array], Array], timing: PathTiming, limits: MotionLimits, period: float
) -> Array:
    """Return poses (frames, 3) from rest to rest on a path within all limits but those of wheels.

    The limits hold for differences of sampled poses. These are means of the velocity and the
    acceleration over a frame or two, and a mean vector is no longer than the longest of its
    vectors. The whole drive is slowed down for three reasons: it ends with a whole frame, steps
    between cells are inexact, and a body that turns within a frame would exceed its ellipse.

    If jerk is limited, the timing is smoothed: the parameter of each frame is a moving average,
    which is on the path as well. The length of the average is searched for the fastest drive.

    Args:
        path: Function from parameters (frames,) to poses (frames, 3).
        timing: Timing of the path within the limits of velocity and acceleration.
        limits: Limits of velocity, acceleration and jerk.
        period: Length of a frame, s.
    """
    fastest = None
    for window in _list_windows(limits, period):
        frames, time_scale = math.ceil(timing.time[-1] / period), math.inf
        while time_scale > 1 + ROUNDING and (fastest is None or frames + window <= len(fastest)):
            parameters = timing.get_parameter(np.linspace(0, timing.time[-1], frames + 1))
            padded = np.pad(parameters, window - 1, mode="edge")
            poses = path(np.convolve(padded, np.full(window, 1 / window), "valid"))
            time_scale = limits.compute_time_scale(poses, period)
            frames = math.ceil(frames * time_scale)
        if time_scale <= 1 + ROUNDING:
            fastest = poses
    assert fastest is not None
    return fastest


def sample_path_on_wheels(
    path: Callable[[Array], Array],
    plan_timing: Callable[[float], PathTiming],
    limits: MotionLimits,
    wheels: WheelLimits,
    period: float,
) -> Array:
    """Return poses (frames, 3) from rest to rest on a path within all limits, wheels included.

    Args:
        path: Function from parameters (frames,) to poses (frames, 3).
        plan_timing: Function from a fraction of the wheels' capacity to the fastest timing that
            needs no more than it.
        limits: Limits of velocity, acceleration and jerk.
        wheels: Limits of the wheels.
        period: Length of a frame, s.

    Raises:
        OmniError: Friction hardly exceeds drag.
    """
    capacity = 1.0
    while capacity > wheels.max_drag_fraction:
        poses = sample_path(path, plan_timing(capacity), limits, period)
        utilization = max(wheels.compute_peak_utilization(poses, period))
        if utilization <= 1 + ROUNDING:
            return poses
        # Smoothing and whole frames need more than the timing.
        capacity /= max(utilization, _MIN_REDUCTION)
    raise OmniError(f"with friction {wheels.friction:g} the wheels can hardly overcome drag")


def is_within_wheel_limits(poses: Array, wheels: WheelLimits, period: float) -> bool:
    """Return whether wheels can drive poses (frames, 3)."""
    return max(wheels.compute_peak_utilization(poses, period)) <= 1 + ROUNDING


def _list_windows(limits: MotionLimits, period: float) -> list[int]:
    """Return the lengths of moving averages to try, in frames.

    They reach up to 3 a / j: to reverse the full acceleration a takes 2 a / j with jerk j.
    """
    rise_times = (
        limits.acceleration / (limits.jerk or np.inf),
        limits.turn_acceleration / (limits.turn_jerk or np.inf),
    )
    longest = 3 * max(rise_times) / period
    return sorted({max(round(longest * i / _N_WINDOWS), 1) for i in range(1, _N_WINDOWS + 1)})

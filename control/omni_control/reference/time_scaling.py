"""Time scaling: slow down the drive along a path until poses, once per frame, keep all limits."""

import math
from collections.abc import Callable

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.traction_limits import WheelLimits

ROUNDING = 1e-9  # relative tolerance of limits
_N_WINDOWS = 24  # number of lengths of the moving average to try
_MIN_REDUCTION = 1.005  # smallest factor between the wheel capacities of successive attempts


class PathTiming:
    """Parameter u of a path over time. Between samples, du/dt is linear in time.

    Args:
        step: Difference of u between samples; the first is at u = 0.
        rate: du/dt at the samples, (n,) 1/s.

    Attributes:
        time: Times of the samples, (n,) s.
    """

    def __init__(self, step: float, rate: Array) -> None:
        self._step = step
        self._rate = rate
        self.time = np.append(0.0, np.cumsum(2 * step / (rate[:-1] + rate[1:])))

    def get_parameter(self, time: Array) -> Array:
        """Return the parameters (frames,) at times (frames,)."""
        i = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        elapsed = time - self.time[i]
        fraction = elapsed / (self.time[i + 1] - self.time[i])
        rate = self._rate[i]
        mean_rate = rate + fraction * (self._rate[i + 1] - rate) / 2  # since sample i
        return self._step * i + elapsed * mean_rate


def sample_path(
    path: Callable[[Array], Array], timing: PathTiming, limits: MotionLimits, period: float
) -> Array:
    """Return poses (frames, 3) from rest to rest on a path within all limits but those of wheels.

    The limits apply to finite differences of the poses. The whole timing is slowed down until they
    hold, for three reasons: the drive must take a whole number of frames, the timing was integrated
    over cells of finite length, and a body that turns within a frame may leave the ellipse of its
    accelerations.

    If jerk is limited, a moving average smooths the path parameter over time. The averaged
    parameter is still on the path. The length of the average that gives the shortest drive is
    chosen.

    Args:
        path: Function from parameters (frames,) to poses (frames, 3).
        timing: Timing of the path within the limits of velocity and acceleration.
        limits: Limits of velocity, acceleration and jerk.
        period: Length of a frame, s.
    """
    fastest: Array
    fewest_poses = math.inf
    for window in _list_windows(limits, period):
        frames = math.ceil(timing.time[-1] / period)
        while frames + window <= fewest_poses:
            parameters = timing.get_parameter(np.linspace(0, timing.time[-1], frames + 1))
            padded = np.pad(parameters, window - 1, mode="edge")
            poses = path(np.convolve(padded, np.full(window, 1 / window), "valid"))
            time_scale = limits.compute_time_scale(poses, period)
            if time_scale <= 1 + ROUNDING:
                fastest = poses
                fewest_poses = len(poses)
                break
            frames = math.ceil(frames * time_scale)
    return fastest


def slow_down_for_wheels(
    poses: Array,
    path: Callable[[Array], Array],
    plan_timing: Callable[[WheelLimits, float], PathTiming],
    limits: MotionLimits,
    period: float,
) -> Array:
    """Return poses (frames, 3) from rest to rest on a path within all limits, wheels included.

    Args:
        poses: Poses (frames, 3) on the path within all limits but those of wheels. The result is
            the same object if the wheels can drive them.
        path: Function from parameters (frames,) to poses (frames, 3).
        plan_timing: Function from the limits of the wheels and a fraction of their capacity to the
            fastest timing that needs at most this fraction.
        limits: Limits of velocity, acceleration and jerk, and of the wheels.
        period: Length of a frame, s.

    Raises:
        OmniError: Friction hardly exceeds drag.
    """
    wheels = limits.wheels
    if wheels is None:
        return poses
    capacity = 1.0
    utilization = wheels.compute_peak_utilization(poses, period)
    while utilization > 1 + ROUNDING:
        if capacity <= wheels.max_drag_fraction:
            raise OmniError(
                f"with friction {wheels.friction:g} the wheels can hardly overcome drag"
            )
        poses = sample_path(path, plan_timing(wheels, capacity), limits, period)
        utilization = wheels.compute_peak_utilization(poses, period)
        # Smoothing and whole frames may need more than the timing, which keeps the capacity.
        capacity /= max(utilization, _MIN_REDUCTION)
    return poses


def _list_windows(limits: MotionLimits, period: float) -> list[int]:
    """Return the lengths of the moving average to try, frames; [1] if jerk is not limited.

    The longest is 3 a / j. Reversing the full acceleration a with the jerk j takes 2 a / j.
    """
    rise_time = max(
        limits.acceleration / (limits.jerk or np.inf),
        limits.turn_acceleration / (limits.turn_jerk or np.inf),
    )
    longest = 3 * rise_time / period
    return sorted({max(round(longest * i / _N_WINDOWS), 1) for i in range(1, _N_WINDOWS + 1)})

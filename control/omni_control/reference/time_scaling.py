"""Time scaling: drive along a path in whole frames, slowed down until all limits hold."""

import math
from collections.abc import Callable

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.traction import WheelLimits

ROUNDING = 1e-9  # relative tolerance of limits
_N_WINDOWS = 24  # number of lengths of the moving average to try
_MIN_REDUCTION = 1.005  # smallest factor by which the demand on wheels is reduced if too high


class PathTiming:
    """Parameter u of a path over time; its rate is linear in time between samples.

    Args:
        step: Difference of u between samples; the first is at u = 0.
        rate: du/dt at the samples, (n,) 1/s.

    Attributes:
        time: Times of the samples, (n,) s.
    """

    def __init__(self, step: float, rate: Array) -> None:
        self._step, self._rate = step, rate
        self.time = np.append(0.0, np.cumsum(2 * step / (rate[:-1] + rate[1:])))

    def get_parameter(self, time: Array) -> Array:
        """Return the parameters (frames,) at times (frames,)."""
        i = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        elapsed, duration = time - self.time[i], self.time[i + 1] - self.time[i]
        rate, next_rate = self._rate[i], self._rate[i + 1]
        mean_rate = rate + elapsed / duration * (next_rate - rate) / 2
        return self._step * i + elapsed * mean_rate


def sample_path(
    path: Callable[[Array], Array], timing: PathTiming, limits: MotionLimits, period: float
) -> Array:
    """Return poses (frames, 3) from rest to rest on a path within all limits but those of wheels.

    The limits hold for finite differences of the sampled poses. These are means of velocity and
    acceleration over one or two frames, so sampling a feasible timing nearly keeps the limits. The
    whole timing is then slowed down for three reasons: the duration becomes a whole number of
    frames, the integration over cells is inexact, and a body that turns within a frame may leave
    its ellipse of accelerations.

    If jerk is limited, a moving average smooths the path parameter over time. The averaged
    parameter is still on the path. The length of the average that gives the shortest drive is
    chosen.

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
    wheels, capacity = limits.wheels, math.inf
    if wheels is None:
        return poses
    while (utilization := wheels.compute_peak_utilization(poses, period)) > 1 + ROUNDING:
        # The first attempt uses the full capacity. Later ones use less, because smoothing and whole
        # frames may need more than the timing.
        capacity = min(1.0, capacity / max(utilization, _MIN_REDUCTION))
        if capacity <= wheels.max_drag_fraction:
            raise OmniError(
                f"with friction {wheels.friction:g} the wheels can hardly overcome drag"
            )
        poses = sample_path(path, plan_timing(wheels, capacity), limits, period)
    return poses


def _list_windows(limits: MotionLimits, period: float) -> list[int]:
    """Return the lengths of the moving average to try, in frames.

    The longest is 3 a / j. Reversing the full acceleration a with the jerk j takes 2 a / j.
    """
    rise_time = max(
        limits.acceleration / (limits.jerk or np.inf),
        limits.turn_acceleration / (limits.turn_jerk or np.inf),
    )
    longest = 3 * rise_time / period
    return sorted({max(round(longest * i / _N_WINDOWS), 1) for i in range(1, _N_WINDOWS + 1)})

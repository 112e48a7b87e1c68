"""Time scaling: slow down the drive along a path until poses, once per frame, keep all limits."""

import math

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.path_timing import ParametricPath, PathTiming, plan_timing

ROUNDING = 1e-9  # relative tolerance of limits
_N_WINDOWS = 24  # number of lengths of the moving average to try
_MIN_REDUCTION = 1.005  # smallest factor between the wheel capacities of successive attempts


def sample_path(
    path: ParametricPath, timing: PathTiming, limits: MotionLimits, period: float
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
        path: Path from rest to rest.
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
            poses = path.get_poses(np.convolve(padded, np.full(window, 1 / window), "valid"))
            time_scale = limits.compute_time_scale(poses, period)
            if time_scale <= 1 + ROUNDING:
                fastest = poses
                fewest_poses = len(poses)
                break
            frames = math.ceil(frames * time_scale)
    return fastest


def slow_down_for_wheels(
    poses: Array,
    path: ParametricPath,
    limits: MotionLimits,
    period: float,
) -> Array:
    """Return poses (frames, 3) from rest to rest on a path within all limits, wheels included.

    Args:
        poses: Poses (frames, 3) on the path within all limits but those of wheels. The result is
            the same object if the wheels can drive them.
        path: Path from rest to rest.
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
        poses = sample_path(path, plan_timing(path, limits, wheels, capacity), limits, period)
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

"""Timed references through way-points: straight segments from rest to rest, in whole frames.

If only velocity and acceleration are limited, `approach_pose` drives the segment: translation and
heading each as fast as their own limits allow.

If jerk is limited, the segment takes the shortest time in which all limits hold. In this time,
translation and heading are as smooth as possible. A move of length d is a step of d smoothed by
three moving averages. The first, over n_v frames, has the constant velocity d / n_v. The second,
over n_a frames, changes the velocity by d / (n_v n_a) per frame. The third, over n_j frames,
changes the acceleration by d / (n_v n_a n_j) per frame. If n_a >= n_j and n_v >= n_a + n_j, these
phases do not overlap, and these are the highest values. The move takes n_v + n_a + n_j frames. The
fastest move with limited jerk, of up to seven phases, has this form (Biagiotti and Melchiorri 2012,
FIR filters for online trajectory planning).

If the wheels cannot do both at once, translation and heading are synchronized: the heading is
linear along the segment, and `path_timing` finds the fastest timing.
"""

import math
from bisect import bisect_left
from functools import partial, reduce

import numpy as np
from numpy.typing import ArrayLike

from omni_control.arguments import check_types, explain_types
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.path_timing import ParametricPath
from omni_control.reference.replanned_reference import approach_pose
from omni_control.reference.sampled_reference import SampledReference, as_poses, check_period
from omni_control.reference.time_scaling import ROUNDING, slow_down_for_wheels

_N_CELLS = 200  # of a segment on which the wheels limit the timing
_AT_REST = 1e-9  # distance (m, rad) and speed (m/s, rad/s) up to which a robot has arrived


class TimedReference(SampledReference):
    """Fastest path through way-points within the limits, with a stop at each.

    Args:
        waypoints: Poses [x, y, heading], (points, 3); the first is the start.
        limits: Motion limits.
        period: Length of a frame, s.
        dwell_frames: Additional frames of rest at each way-point after the start.

    Raises:
        OmniError: There are no way-points, one is not three finite numbers, or the period is not
            a positive number.
    """

    @explain_types
    @check_types
    def __init__(
        self,
        waypoints: ArrayLike,
        limits: MotionLimits,
        period: float,
        dwell_frames: int = 0,
    ) -> None:
        points = as_poses(waypoints)
        # Repeated laps have the same segments, which are planned once.
        segments, indices = np.unique(
            np.stack([points[:-1], points[1:]], axis=1), axis=0, return_inverse=True
        )
        planned = _plan_segments(segments, limits, check_period(period))
        poses = [points[:1]]
        for i in indices.ravel():
            poses += [planned[i], np.repeat(segments[i, 1:], dwell_frames, axis=0)]
        super().__init__(np.concatenate(poses), period)


def _plan_segments(segments: Array, limits: MotionLimits, period: float) -> list[Array]:
    """Return for each segment the poses (frames, 3) after its start, up to its end.

    A segment ends with a frame of rest, or two if jerk is limited.

    Args:
        segments: Start and end of each segment, (segments, 2, 3). All are planned at once, with
            the same result as one by one.
        limits: Motion limits.
        period: Length of a frame, s.
    """
    if limits.jerk or limits.turn_jerk:
        trajectories = [_plan_smooth(start, end, limits, period) for start, end in segments]
    else:
        trajectories = _plan_fastest(segments[:, 0], segments[:, 1], limits, period)
    return [
        _slow_down_for_wheels(start, end, poses, limits, period)[1:]
        for (start, end), poses in zip(segments, trajectories, strict=True)
    ]


def _slow_down_for_wheels(
    start: Array, end: Array, poses: Array, limits: MotionLimits, period: float
) -> Array:
    """Return the poses (frames, 3) of a segment, slower if the wheels require it."""
    path = ParametricPath(partial(_interpolate, start, end), 1.0, _N_CELLS)
    slowed_poses = slow_down_for_wheels(poses, path, limits, period)
    if slowed_poses is poses:
        return poses
    rest_frames = 2 if limits.jerk or limits.turn_jerk else 1
    return np.concatenate([slowed_poses, np.repeat(end[None], rest_frames, axis=0)])


def _plan_fastest(start: Array, end: Array, limits: MotionLimits, period: float) -> list[Array]:
    """Return n trajectories from start to end poses (n, 3) without limits of jerk and wheels."""
    pose, twist, poses = start, np.zeros_like(start), [start]
    arrival_frames = np.full(len(start), -1)
    while (arrival_frames < 0).any():
        remaining = np.maximum(np.abs(end - pose).max(1), np.abs(twist).max(1))
        arrival_frames[(arrival_frames < 0) & ~(remaining > _AT_REST)] = len(poses) - 1
        twist = approach_pose(pose, twist, end, limits, period)
        pose = pose + twist * period
        poses.append(pose)
    trajectories = np.array(poses)
    return [
        np.concatenate([trajectories[:frames, i], end[i : i + 1]])
        for i, frames in enumerate(arrival_frames)
    ]


def _plan_smooth(start: Array, end: Array, limits: MotionLimits, period: float) -> Array:
    """Return the shortest smooth trajectory (frames, 3) within all limits but those of wheels."""
    distance, turn = np.hypot(*(end - start)[:2]), abs(end[2] - start[2])
    if not distance and not turn:
        return start[None]
    jerk = (limits.jerk or math.inf) * period**3
    turn_jerk = (limits.turn_jerk or math.inf) * period**3

    def plan(frames: int) -> Array | None:
        translation = _smooth_step(distance, limits.speed * period, jerk, frames)
        rotation = _smooth_step(turn, limits.turn_rate * period, turn_jerk, frames)
        if translation is None or rotation is None:
            return None
        poses = _interpolate(start, end, np.array([translation, translation, rotation]))
        return poses if limits.compute_time_scale(poses, period) <= 1 + ROUNDING else None

    upper_bound = 1
    while plan(upper_bound) is None:
        upper_bound *= 2
    shortest = bisect_left(
        range(upper_bound), True, lo=upper_bound // 2, key=lambda frames: plan(frames) is not None
    )
    return plan(shortest)  # type: ignore[return-value]


def _smooth_step(distance: float, speed: float, jerk: float, frames: int) -> Array | None:
    """Return the smoothest step (frames + 1,) from 0 to 1 in a number of frames.

    Of the moving averages that keep the limits, those with the shortest n_j are the smoothest.

    Args:
        distance: Length of the move, m or rad.
        speed: Highest speed, m or rad per frame.
        jerk: Highest jerk, m or rad per frame^3.
        frames: Duration of the step.

    Returns:
        The step, or None if no moving averages of this duration keep the limits.
    """
    n_j = np.zeros(1, int) if math.isinf(jerk) else np.arange(1, max(frames // 4, 1) + 1)
    min_n_v = max(math.ceil(distance / speed - ROUNDING), 1)
    n_a = np.minimum((frames - 2 * n_j) // 2, frames - n_j - min_n_v)
    n_v = frames - n_a - n_j
    keeps_jerk = n_v * n_a * n_j >= distance / jerk * (1 - ROUNDING)
    is_feasible = (n_a >= np.maximum(n_j, 1)) & keeps_jerk
    if not is_feasible.any():
        return None
    i = is_feasible.argmax()
    windows = [np.ones(max(length[i], 1)) for length in (n_v, n_a, n_j)]
    velocity = reduce(np.convolve, windows)
    progress = np.append(0.0, np.cumsum(velocity) / velocity.sum())
    return np.pad(progress, (0, frames + 1 - len(progress)), mode="edge")


def _interpolate(start: Array, end: Array, progress: Array) -> Array:
    """Return poses (frames, 3) for a progress from 0 to 1, (frames,) or (3, frames)."""
    progress = np.atleast_2d(progress).T
    return np.where(progress == 1, end, start + progress * (end - start))

"""The way from one way-point to the next, straight, from rest to rest, in whole frames.

Where velocity and acceleration alone are limited, `approach_pose` leads there, translation and heading each as fast as
its own limits let it.

With a limit of jerk, both are as gentle as the time allows, in the shortest time in which all limits are kept. A move
of d is then a step of d smoothed by three boxes: its mean over n_v frames has a constant velocity of d / n_v, the mean
of that over n_a frames changes velocity by d / (n_v n_a) a frame, and the mean of that over n_j frames acceleration by
d / (n_v n_a n_j). As long as n_a >= n_j and n_v >= n_a + n_j nothing overlaps: these are the highest it has, and it
takes n_v + n_a + n_j frames. The fastest with a limit of jerk, of up to seven phases, is of this form (Biagiotti
and Melchiorri 2012, FIR filters for online trajectory planning).

Where wheels cannot do both at once, robots drive and turn in step: the heading is linear along the way, and what there
is left for speeding up and braking depends on the place alone, so that the fastest drive is an integral each way.
"""

import math
from bisect import bisect_left
from collections.abc import Sequence
from functools import partial, reduce

import numpy as np

from omni_control.kinematics import Array, world_to_body
from omni_control.reference.motion_limits import MotionLimits, approach_pose
from omni_control.reference.time_scaling import ROUNDING, Timetable, bearable, driven_on_wheels
from omni_control.traction import WheelLimits, max_over_neighbors

_CELLS = 200  # of a leg on which wheels limit the drive

Way = tuple[tuple[float, ...], tuple[float, ...]]  # from a pose [x, y, heading] to another


def legs(ways: Sequence[Way], limits: MotionLimits, period: float) -> list[Array]:
    """Return for each way the poses (frames, 3) after its start, up to its end.

    There it rests a frame, or two if jerk is limited. All are planned side by side, each as it
    would be alone.
    """
    drives = zip(ways, _driven(ways, limits, period), strict=True)
    return [_borne(way, poses, limits, period)[1:] for way, poses in drives]


def _borne(way: Way, poses: Array, limits: MotionLimits, period: float) -> Array:
    """Return the same poses, or others where wheels could not drive these."""
    if limits.wheels is None or bearable(poses, limits.wheels, period):
        return poses
    start, end = np.array(way)
    plan = partial(_in_step, start, end, limits, limits.wheels)
    poses = driven_on_wheels(partial(_poses_at, start, end), plan, limits, limits.wheels, period)
    return np.concatenate(
        [poses, np.repeat(end[None], 2 if limits.jerk or limits.turn_jerk else 1, axis=0)]
    )


def _driven(ways: Sequence[Way], limits: MotionLimits, period: float) -> list[Array]:
    """Return the poses (frames + 1, 3) of each way, from its start on, whatever its wheels can do."""
    start, end = np.array(ways).reshape(-1, 2, 3).swapaxes(0, 1)
    if limits.jerk or limits.turn_jerk:
        return [_gentlest(*ends, limits, period) for ends in zip(start, end, strict=True)]
    return _fastest(start, end, limits, period)


def _fastest(start: Array, end: Array, limits: MotionLimits, period: float) -> list[Array]:
    """Return n drives as fast as the limits of velocity and acceleration let heading and rest."""
    pose, twist, poses, lasts = start, np.zeros_like(start), [start], np.full(len(start), -1)
    while True:
        apart = np.maximum(np.abs(end - pose).max(1), np.abs(twist).max(1))
        # Nm: beyond it there is only rounding
        lasts[(lasts < 0) & ~(apart > 1e-9)] = len(poses) - 1
        if (lasts >= 0).all():
            break
        twist = approach_pose(pose, twist, end, limits, period)
        pose = pose + twist * period
        poses.append(pose)
    drives = np.array(poses)
    return [np.concatenate([drives[:last, i], end[i : i + 1]]) for i, last in enumerate(lasts)]


def _gentlest(start: Array, end: Array, limits: MotionLimits, period: float) -> Array:
    """Return a drive of the fewest frames in which both moves, as gentle as can be, keep all limits."""
    distance, turn = np.hypot(*(end - start)[:2]), abs(end[2] - start[2])
    if not distance and not turn:
        return start[None]
    cube = period**3
    move = partial(_smooth_step, distance, limits.speed * period, (limits.jerk or math.inf) * cube)
    rotate = partial(
        _smooth_step, turn, limits.turn_rate * period, (limits.turn_jerk or math.inf) * cube
    )

    def drive(frames: int) -> Array | None:
        way, heading = move(frames), rotate(frames)
        if way is None or heading is None:
            return None
        poses = _poses_at(start, end, np.stack([way, way, heading], axis=1))
        return poses if limits.required_time_scale(poses, period) <= 1 + ROUNDING else None

    most = 1
    while (poses := drive(most)) is None:
        most *= 2
    shortest = bisect_left(
        range(most), True, lo=most // 2, key=lambda frames: drive(frames) is not None
    )
    return poses if shortest == most else drive(shortest)  # type: ignore[return-value]


def _smooth_step(distance: float, speed: float, jerk: float, frames: int) -> Array | None:
    """Return a step in so many frames (frames + 1,), from 0 to 1, as gentle as can be.

    None if it cannot keep limits of velocity and jerk per frame. Of boxes that do, those with the
    shortest n_j are the gentlest.
    """
    third = np.zeros(1, int) if math.isinf(jerk) else np.arange(1, max(frames // 4, 1) + 1)
    fastest = max(math.ceil(distance / speed - ROUNDING), 1)
    second = np.minimum((frames - 2 * third) // 2, frames - third - fastest)
    first = frames - second - third
    fits = (second >= np.maximum(third, 1)) & (
        first * second * third >= distance / jerk * (1 - ROUNDING)
    )
    if not fits.any():
        return None
    i = fits.argmax()
    velocity = reduce(np.convolve, [np.ones(max(box[i], 1)) for box in (first, second, third)])
    share = np.append(0.0, np.cumsum(velocity) / velocity.sum())
    return np.pad(share, (0, frames + 1 - len(share)), mode="edge")


def _in_step(
    start: Array, end: Array, limits: MotionLimits, wheels: WheelLimits, share: float
) -> Timetable:
    """The fastest drive that asks for so large a share of what wheels can do, by shares of the way from 0 to 1."""
    way = np.tile(end - start, (_CELLS, 1))
    heading = start[2] + way[:, 2] * (np.arange(_CELLS) + 0.5) / _CELLS
    travel = world_to_body(way, heading)
    rows, dragged = wheels.get_friction_constraints(travel)
    own = np.hypot(*limits.stretched(way[:, :2], heading).T) / limits.acceleration
    own = np.maximum(own, np.abs(way[:, 2]) / limits.turn_acceleration)[:, None]
    pushed = travel @ rows.T / (share - max_over_neighbors(dragged, "edge"))
    up, down = (
        2 / _CELLS / np.max(np.concatenate([own, each], axis=1), axis=1)
        for each in (pushed, -pushed)
    )
    slowest = max(
        np.hypot(*way[0, :2]) / limits.speed,
        abs(way[0, 2]) / limits.turn_rate,
        wheels.compute_rim_speeds(travel).max() / (share * wheels.max_rim_speed),
    )
    squares = np.minimum(np.append(0, np.cumsum(up)), np.append(0, np.cumsum(down[::-1]))[::-1])
    return Timetable.of_rates(1 / _CELLS, np.sqrt(np.minimum(squares, slowest**-2.0)))


def _poses_at(start: Array, end: Array, share: Array) -> Array:
    """Poses (frames, 3) at shares of the way (frames,), or of the way of each coordinate (frames, 3)."""
    share = share if share.ndim == 2 else share[:, None]
    return np.where(share == 1, end, start + share * (end - start))

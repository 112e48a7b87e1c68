"""The way from one way-point to the next, from rest to rest, in whole frames.

Where velocity and acceleration alone are limited, `approach_pose` leads there, translation and heading each as fast as
its own limits let it.

With a limit of jerk, and where wheels cannot do both at once, both are as gentle as the time allows, and of all times
the shortest is taken in which the limits are kept. A move of d that is as gentle as can be is a step of d smoothed
by three boxes: the mean of a step over n_v frames is a constant velocity d / n_v, that over n_a frames more is a
trapezoid of velocity which changes by d / (n_v n_a), that over n_j frames more is one of acceleration, which changes by
d / (n_v n_a n_j). As long as n_a >= n_j and n_v >= n_a + n_j nothing of it overlaps, these are the highest it has, and
the whole takes n_v + n_a + n_j frames. The fastest profile with a limit of jerk, of up to seven phases, is of this
form (Biagiotti and Melchiorri 2012, FIR filters for online trajectory planning).
"""

import math
from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference.limits import MotionLimits, approach_pose

_ROUNDING = 1e-9


def leg(start: Array, end: Array, limits: MotionLimits, period: float) -> Array:
    """Poses (frames, 3) after `start` up to and including `end`, from rest to rest."""
    if limits.jerk is None and limits.turn_jerk is None:
        fastest = _fastest(start, end, limits, period)
        if _bearable(np.vstack([start, fastest]), limits, period):
            return fastest
    return _gentlest(start, end, limits, period)


def _fastest(start: Array, end: Array, limits: MotionLimits, period: float) -> Array:
    pose, twist, poses = start[None], np.zeros((1, 3)), []
    while max(np.abs(end - pose).max(), np.abs(twist).max()) > 1e-9:  # nm: beyond it there is only rounding
        twist = approach_pose(pose, twist, end[None], limits, period)
        pose = pose + twist * period
        poses.append(pose[0])
    return np.array([*poses[:-1], end] if poses else poses).reshape(-1, 3)


def _gentlest(start: Array, end: Array, limits: MotionLimits, period: float) -> Array:
    """The same, translation and heading as gentle as can be, in as few frames as the limits allow."""
    moves = (
        _Move(float(np.hypot(*(end - start)[:2])), limits.speed * period, _cubed(limits.jerk, period)),
        _Move(abs(float(end[2] - start[2])), limits.turn_rate * period, _cubed(limits.turn_jerk, period)),
    )
    if not any(move.distance for move in moves):
        return np.empty((0, 3))

    def drive(frames: int) -> Array | None:
        """All poses (frames + 1, 3), if they keep the limits."""
        way, heading = (move.shares(frames) for move in moves)
        if way is None or heading is None:
            return None
        share = np.stack([way, way, heading], axis=1)
        poses = np.where(share == 1, end, start + share * (end - start))
        return poses if limits.excess(poses, period) <= 1 + _ROUNDING and _bearable(poses, limits, period) else None

    most = 1
    while (found := drive(most)) is None:
        most *= 2
    least = bisect_left(range(most), True, lo=most // 2, key=lambda frames: drive(frames) is not None)
    shortest = drive(least)
    return (found if shortest is None else shortest)[1:]


@dataclass(frozen=True)
class _Move:
    """A step of `distance`, with limits of velocity and jerk (None: without) per frame."""

    distance: float
    speed: float
    jerk: float | None

    def shares(self, frames: int) -> Array | None:
        """The step in so many frames (frames + 1,), from 0 to 1, as gently as the limits allow; None if they do not."""
        boxes = self._boxes(frames)
        if boxes is None:
            return None
        velocity = np.ones(1)
        for length in filter(None, boxes):
            velocity = np.cumsum(np.pad(velocity, (0, length - 1)))
            velocity[length:] -= velocity[:-length].copy()  # exact: all of them are whole numbers
        way = np.concatenate([[0], np.cumsum(velocity) / velocity.sum()])
        return np.pad(way, (0, frames + 1 - len(way)), mode="edge")

    def _boxes(self, frames: int) -> tuple[int, int, int] | None:
        fastest = max(math.ceil(self.distance / self.speed - _ROUNDING), 1)
        third = np.zeros(1, int) if self.jerk is None else np.arange(1, max(frames // 4, 1) + 1)
        second = np.minimum((frames - 2 * third) // 2, frames - third - fastest)
        first = frames - second - third
        fits = second >= np.maximum(third, 1)
        if self.jerk is not None:
            fits &= first * second * third * self.jerk >= self.distance * (1 - _ROUNDING)
        return (first[i], second[i], third[i]) if (i := fits.argmax()) or fits[0] else None


def _bearable(poses: Array, limits: MotionLimits, period: float) -> bool:
    return limits.wheels is None or max(limits.wheels.shares(poses, period)) <= 1 + _ROUNDING


def _cubed(jerk: float | None, period: float) -> float | None:
    return None if jerk is None else jerk * period**3

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
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from omni_control.kinematics import Array, world_to_body
from omni_control.reference.limits import MotionLimits, approach_pose
from omni_control.reference.timetable import ROUNDING, Timetable, bearable, driven_on_wheels
from omni_control.traction import WheelLimits, around

_CELLS = 200  # of a leg on which wheels limit the drive


Way = tuple[Array, Array, MotionLimits]  # from a pose to another, within limits


def legs(ways: Sequence[Way], period: float) -> list[Array]:
    """Of each the poses (frames, 3) after its start up to its end, where it rests a frame, or two if jerk is limited.

    Those that differ in nothing but poses and highest speeds are planned side by side, each as it would be alone.
    """
    found: dict[int, Array] = {}
    together: dict[MotionLimits, list[int]] = {}
    for number, (start, end, limits) in enumerate(ways):
        if _jerks(limits):
            found[number] = _gentlest(start, end, limits, period)
        else:
            together.setdefault(replace(limits, speed=1.0, turn_rate=1.0, wheels=None), []).append(number)
    for numbers in together.values():
        found |= zip(numbers, _fastest([ways[number] for number in numbers], period), strict=True)
    return [_borne(way, found[number], period)[1:] for number, way in enumerate(ways)]


def _jerks(limits: MotionLimits) -> bool:
    return limits.jerk is not None or limits.turn_jerk is not None


def _borne(way: Way, poses: Array, period: float) -> Array:
    """The same poses, or others where wheels could not drive these."""
    start, end, limits = way
    if limits.wheels is None or bearable(poses, limits, period):
        return poses
    plan = partial(_in_step, start, end, limits, limits.wheels)
    poses = driven_on_wheels(partial(_between, start, end), plan, limits, limits.wheels, period)
    return np.concatenate([poses, np.repeat(end[None], 2 if _jerks(limits) else 1, axis=0)])


def _fastest(ways: Sequence[Way], period: float) -> list[Array]:
    """Poses (frames + 1, 3) from a start on, as fast as limits of velocity and acceleration let heading and rest."""
    start, end = (np.array([way[i] for way in ways]) for i in (0, 1))
    speeds: Any = np.array([(way[2].speed, way[2].turn_rate) for way in ways])
    limits = replace(ways[0][2], speed=speeds[:, :1], turn_rate=speeds[:, 1:])
    pose, twist, poses, ends = start, np.zeros_like(start), [start], np.full(len(ways), -1)
    while True:
        apart = np.maximum(np.abs(end - pose).max(1), np.abs(twist).max(1))
        ends[(ends < 0) & ~(apart > 1e-9)] = len(poses) - 1  # nm: beyond it there is only rounding
        if (ends >= 0).all():
            break
        twist = approach_pose(pose, twist, end, limits, period)
        pose = pose + twist * period
        poses.append(pose)
    drives = np.array(poses)
    return [np.concatenate([drives[:last, i], end[i : i + 1]]) for i, last in enumerate(ends)]


# --- with a limit of jerk ---


def _gentlest(start: Array, end: Array, limits: MotionLimits, period: float) -> Array:
    """The same in the fewest frames in which translation and heading, as gentle as can be, keep all limits."""
    moves = (
        _Move(float(np.hypot(*(end - start)[:2])), limits.speed * period, _cubed(limits.jerk, period)),
        _Move(abs(float(end[2] - start[2])), limits.turn_rate * period, _cubed(limits.turn_jerk, period)),
    )
    if not any(move.distance for move in moves):
        return start[None]

    def drive(frames: int) -> Array | None:
        way, heading = (move.shares(frames) for move in moves)
        if way is None or heading is None:
            return None
        poses = _between(start, end, np.stack([way, way, heading], axis=1))
        return poses if limits.excess(poses, period) <= 1 + ROUNDING else None

    most = 1
    while (found := drive(most)) is None:
        most *= 2
    shortest = drive(bisect_left(range(most), True, lo=most // 2, key=lambda frames: drive(frames) is not None))
    return found if shortest is None else shortest


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
        """Lengths n_v, n_a and n_j (0: without) that add up to so many frames; the shorter n_j, the gentler."""
        fastest = max(math.ceil(self.distance / self.speed - ROUNDING), 1)
        third = np.zeros(1, int) if self.jerk is None else np.arange(1, max(frames // 4, 1) + 1)
        second = np.minimum((frames - 2 * third) // 2, frames - third - fastest)
        first = frames - second - third
        fits = second >= np.maximum(third, 1)
        if self.jerk is not None:
            fits &= first * second * third * self.jerk >= self.distance * (1 - ROUNDING)
        return (first[i], second[i], third[i]) if (i := fits.argmax()) or fits[0] else None


def _cubed(jerk: float | None, period: float) -> float | None:
    return None if jerk is None else jerk * period**3


# --- where wheels cannot do both at once ---


def _in_step(start: Array, end: Array, limits: MotionLimits, wheels: WheelLimits, share: float) -> Timetable:
    """The fastest drive that asks for so large a share of what wheels can do, by shares of the way from 0 to 1."""
    way = np.tile(end - start, (_CELLS, 1))
    heading = start[2] + way[:, 2] * (np.arange(_CELLS) + 0.5) / _CELLS
    travel = world_to_body(way, heading)
    rows, dragged = wheels.faces(travel)
    own = np.hypot(*limits.stretched(way[:, :2], heading).T) / limits.acceleration
    own = np.maximum(own, np.abs(way[:, 2]) / limits.turn_acceleration)[:, None]
    pushed = travel @ rows.T / (share - around(dragged, "edge"))
    up, down = (2 / _CELLS / np.max(np.concatenate([own, each], axis=1), axis=1) for each in (pushed, -pushed))
    slowest = max(
        np.hypot(*way[0, :2]) / limits.speed,
        abs(way[0, 2]) / limits.turn_rate,
        wheels.rims(travel).max() / (share * wheels.rim_speed),
    )
    squares = np.minimum(np.append(0, np.cumsum(up)), np.append(0, np.cumsum(down[::-1]))[::-1])
    return Timetable.of_rates(1 / _CELLS, np.sqrt(np.minimum(squares, slowest**-2.0)))


def _between(start: Array, end: Array, share: Array) -> Array:
    """Poses (frames, 3) at shares of the way (frames,), or of the way of each coordinate (frames, 3)."""
    share = share if share.ndim == 2 else share[:, None]
    return np.where(share == 1, end, start + share * (end - start))

"""Set-point driven reference generator with velocity and acceleration limits (section 3-A).

One rule, `approach`, moves a point towards a set-point as fast as the limits let it and stops it there exactly, in
whole frames. Iterated from its own output it gives a timed reference, the same for every controller; iterated from
the robot's pose it gives the re-planned reference that the paper also describes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array


@dataclass(frozen=True)
class MotionLimits:
    """Limits of the reference: m/s and m/s^2 along the path, rad/s and rad/s^2 in heading."""

    speed: float = 3.159
    acceleration: float = 0.826
    turn_rate: float = 6.0
    turn_acceleration: float = 12.0

    def __post_init__(self) -> None:
        """Check the limits.

        Raises:
            OmniError: a limit is not a positive number.
        """
        for name, value in vars(self).items():
            if not 0 < value < np.inf:
                raise OmniError(f"the reference's limit of {name} must be a positive number, not {value}")


def stopping_speed(distance: Array, acceleration: float, period: float) -> Array:
    """Highest speed (m/s) from which `distance` (m, >= 0) is covered exactly while braking at most at `acceleration`.

    A point that moves s, s - 1, s - 2, ... units of a T^2 in successive frames of length T covers m (m + 1) / 2 in m
    frames; between these distances the speed is linear, which makes it fall by exactly one unit each frame
    but the last.
    """
    unit = acceleration * period**2
    d = np.asarray(distance, float) / unit
    m = np.floor(np.sqrt(0.25 + 2 * d) - 0.5)
    return (m + (d - m * (m + 1) / 2) / (m + 1)) * unit / period


def approach(offset: Array, velocity: Array, speed: float, acceleration: float, period: float) -> Array:
    """Velocity for the next frame of a point that shall stop at a set-point.

    Args:
        offset: set-point minus position, (n, d) m.
        velocity: velocity of the last frame, (n, d) m/s.
        speed: highest speed, m/s.
        acceleration: highest change of velocity per second, m/s^2.
        period: length of a frame, s.

    Returns:
        (n, d) m/s: no faster than `speed`, changed by at most `acceleration * period`. That is shared between braking
        what leads past the set-point and the speed towards it, whose gain counts for no more than one frame's.
    """
    step = acceleration * period
    distance = _size(offset)
    direction = np.divide(offset, distance, out=np.zeros_like(offset), where=distance > 0)
    along = (velocity * direction).sum(-1, keepdims=True)
    across = velocity - along * direction
    wanted = np.minimum(speed, stopping_speed(distance, acceleration, period))
    change = np.minimum(wanted - along, step) * direction - across
    return velocity + change * (step / np.maximum(_size(change), step))


def _size(vector: Array) -> Array:
    return np.sqrt((vector**2).sum(-1, keepdims=True))


def _approach_pose(pose: Array, twist: Array, target: Array, limits: MotionLimits, period: float) -> Array:
    """`approach` for position and heading of (n, 3) poses, each within its own limits; headings count full turns."""
    offset = target - pose
    xy = approach(offset[:, :2], twist[:, :2], limits.speed, limits.acceleration, period)
    turn = approach(offset[:, 2:], twist[:, 2:], limits.turn_rate, limits.turn_acceleration, period)
    return np.concatenate([xy, turn], axis=1)


def _checked(waypoints: Sequence[Sequence[float]]) -> Array:
    if not len(waypoints) or any(len(point) != 3 for point in waypoints) or not np.isfinite(waypoints).all():
        raise OmniError("a reference needs at least one way-point, each three finite numbers [x, y, heading]")
    return np.array(waypoints, float)


def _leg(start: Array, end: Array, limits: MotionLimits, period: float) -> Array:
    """Poses (frames, 3) after `start` up to and including `end`, from rest to rest."""
    pose, twist, poses = start[None], np.zeros((1, 3)), []
    while max(np.abs(end - pose).max(), np.abs(twist).max()) > 1e-9:  # nm: beyond it there is only rounding
        twist = _approach_pose(pose, twist, end[None], limits, period)
        pose = pose + twist * period
        poses.append(pose[0])
    return np.array([*poses[:-1], end] if poses else poses).reshape(-1, 3)


class Reference(Protocol):
    """Where a robot should be and how fast it should move there."""

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """Return the reference poses (n, 3) at `frame` and the twists (n, 3) that lead from there to a frame later.

        Args:
            frame: one for all robots, one each (n,), or one for each component of each pose (n, 3). It need not be
                whole: a robot may look ahead by a latency of 6.4 frames. A reference that is planned anew in every
                frame does not look ahead and ignores it.
            pose: where the robots are, or are predicted to be, at that frame, (n, 3); ignored by one known in advance.
        """
        ...


class SampledReference:
    """A reference known in advance, the same for every robot.

    Args:
        poses: one per frame from the start on, (frames, 3).
        period: length of a frame, s.
    """

    def __init__(self, poses: Array, period: float) -> None:
        self.poses, self.period = poses, period

    @property
    def frames(self) -> int:
        """Number of frames, both ends counted."""
        return len(self.poses)

    def after_rest(self, frames: int) -> "SampledReference":
        """The same after `frames` frames of rest at its start."""
        return SampledReference(np.concatenate([np.repeat(self.poses[:1], frames, axis=0), self.poses]), self.period)

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """See `Reference`: linear between frames; at rest before the first, which counts as now, and after the last."""
        start = np.maximum(frame, 0)
        here, later = self._between(start), self._between(start + 1)
        return np.broadcast_to(here, pose.shape), np.broadcast_to((later - here) / self.period, pose.shape)

    def _between(self, frame: Array) -> Array:
        last = self.frames - 1
        frame = np.minimum(frame, last)
        frame = frame[..., None] if frame.ndim < 2 else frame
        before, axis = frame.astype(int), np.arange(3)
        here, following = self.poses[before, axis], self.poses[np.minimum(before + 1, last), axis]
        return here + (frame - before) * (following - here)


class TimedReference(SampledReference):
    """The way through the way-points as fast as the limits allow, stopping at each; known in advance.

    Args:
        waypoints: poses [x, y, heading], at least one; the first is the start.
        limits: velocity and acceleration limits.
        period: length of a frame, s.
        dwell_frames: further frames of rest at each way-point after the start.
        settle_frames: further frames of rest at the end.

    Raises:
        OmniError: no way-points, or one that is not three finite numbers.
    """

    def __init__(
        self,
        waypoints: Sequence[Sequence[float]],
        limits: MotionLimits,
        period: float,
        dwell_frames: int = 0,
        settle_frames: int = 0,
    ) -> None:
        points = _checked(waypoints)
        legs: dict[bytes, Array] = {}  # laps repeat their legs
        poses = [points[:1]]
        for leg in pairwise(points):
            key = np.array(leg).tobytes()
            if key not in legs:
                legs[key] = _leg(*leg, limits, period)
            poses += [legs[key], np.repeat(leg[1][None], dwell_frames, axis=0)]
        super().__init__(np.concatenate([*poses, np.repeat(points[-1:], settle_frames, axis=0)]), period)


class IteratedReference:
    """The reference planned anew in every frame from where the robot is; `n` robots with their own progress.

    A way-point counts as reached within `arrival_radius` (m) and `arrival_angle` (rad); the robot then turns to the
    next, still slowing down. The first `rest_frames` frames are spent at the first way-point.

    Raises:
        OmniError: no way-points, or one that is not three finite numbers.
    """

    def __init__(
        self,
        waypoints: Sequence[Sequence[float]],
        limits: MotionLimits,
        period: float,
        n: int,
        arrival_radius: float = 0.02,
        arrival_angle: float = 0.1,
        rest_frames: int = 0,
    ) -> None:
        self.waypoints = _checked(waypoints)
        self.limits, self.period = limits, period
        self.arrival_radius, self.arrival_angle = arrival_radius, arrival_angle
        self._rest = rest_frames
        self.goal = np.minimum(np.ones(n, int), len(waypoints) - 1)
        self.twist = np.zeros((n, 3))
        self.next_pose = np.repeat(self.waypoints[:1], n, axis=0)

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """See `Reference`: the pose expected one frame after the last call, and the twist from here on."""
        here = self.next_pose
        if self._rest:
            self._rest -= 1
            return here, self.twist
        self.twist = _approach_pose(pose, self.twist, self.waypoints[self.goal], self.limits, self.period)
        self.next_pose = pose + self.twist * self.period
        offset = self.waypoints[self.goal] - pose
        near = np.hypot(offset[:, 0], offset[:, 1]) < self.arrival_radius
        arrived = near & (np.abs(offset[:, 2]) < self.arrival_angle)
        self.goal = np.minimum(self.goal + arrived, len(self.waypoints) - 1)
        return here, self.twist

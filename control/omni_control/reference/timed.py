"""References known in advance, a pose for each frame; the fastest way through way-points as one of them."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.legs import legs
from omni_control.reference.limits import MotionLimits, checked_waypoints

Task = tuple[Sequence[Sequence[float]], MotionLimits, int, int]  # see `drives`


class SampledReference:
    """A reference known in advance, the same for every robot.

    Args:
        poses: one per frame from the start on, (frames, 3).
        period: length of a frame, s.

    Attributes:
        poses: the same, to be read only: controllers share it.

    Raises:
        OmniError: no poses, or one that is not three finite numbers.
    """

    def __init__(self, poses: Array, period: float) -> None:
        poses = np.array(poses, float)
        if poses.ndim != 2 or poses.shape[1] != 3 or not len(poses) or not np.isfinite(poses).all():
            raise OmniError("a reference needs poses (frames, 3) of finite numbers [x, y, heading]")
        self._store(poses, period)

    def _store(self, poses: Array, period: float) -> None:
        """Store poses (frames, 3) or (frames, n, 3), and rows (frames, 1 or n, 6) of poses and twists."""
        self.poses, self.period = poses, period
        self.poses.flags.writeable = False
        twists = np.zeros_like(poses)
        twists[:-1] = np.diff(poses, axis=0) / period
        rows = np.concatenate([poses, twists], axis=-1) + 0.0  # turns -0.0 into 0.0
        self._rows = rows.reshape(len(rows), -1, 6)

    @property
    def frames(self) -> int:
        """Number of frames, both ends counted."""
        return len(self.poses)

    def after_rest(self, frames: int) -> "SampledReference":
        """The same after `frames` frames of rest at its start."""
        return SampledReference(np.concatenate([np.repeat(self.poses[:1], frames, axis=0), self.poses]), self.period)

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """See `Reference`: linear between frames; at rest before the first, which counts as now, and after the last."""
        rows = np.empty((len(pose), 6))
        rows[:] = self._between(frame)
        return rows[:, :3], rows[:, 3:]

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """See `Reference`."""
        first = np.asarray(frame)
        first = first[..., None] if first.ndim == 1 else first
        rows = self._between(first + np.arange(count)[:, None, None])
        if rows.shape[1] < len(pose):
            rows = np.repeat(rows, len(pose), axis=1)
        return rows[..., :3], rows[..., 3:]

    def _between(self, frame: float | Array) -> Array:
        """Return poses and twists (..., 1 or n, 6) at frames: a number, (n,), or with the components last."""
        last = self.frames - 1
        if isinstance(frame, float | int):  # of most controllers: needs no arrays of indices
            frame = min(max(frame, 0), last)
            row = int(frame)
            here, following = self._rows[row], self._rows[min(row + 1, last)]
            return here if row == frame else here + (frame - row) * (following - here)
        frame = np.minimum(np.maximum(frame, 0), last)
        frame = frame[..., None] if frame.ndim < 2 else frame
        if frame.shape[-1] > 1:
            frame = np.concatenate([frame, frame], axis=-1)
        before = frame.astype(int)
        after = np.minimum(before + 1, last)
        robots, columns = np.arange(self._rows.shape[1])[:, None], np.arange(6)
        here, following = self._rows[before, robots, columns], self._rows[after, robots, columns]
        return here + (frame - before) * (following - here)


class EachReference(SampledReference):
    """References known in advance, one for each robot: n robots share a controller, whose routes are not the same.

    Args:
        references: of frames of the same length, n of them.

    Attributes:
        poses: one per frame and robot, (frames, n, 3), to be read only; those that end before others rest at their end.

    Raises:
        OmniError: there are none, or their frames differ in length.
    """

    def __init__(self, references: Sequence[SampledReference]) -> None:
        if len({reference.period for reference in references}) != 1:
            raise OmniError("robots that share a controller need references of frames of the same length")
        longest = max(reference.frames for reference in references)
        poses = [np.pad(each.poses, ((0, longest - each.frames), (0, 0)), "edge") for each in references]
        self._store(np.stack(poses, axis=1), references[0].period)


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
        (poses,) = drives([(waypoints, limits, dwell_frames, settle_frames)], period)
        super().__init__(poses, period)


def drives(tasks: Sequence[Task], period: float) -> list[Array]:
    """Poses (frames, 3) of a `TimedReference` for each task; many are planned in the time of a few.

    Args:
        tasks: the first two and the last two arguments of `TimedReference`.
        period: length of a frame, s.

    Raises:
        OmniError: as `TimedReference`.
    """
    ways = [(checked_waypoints(points), limits) for points, limits, *_ in tasks]
    distinct = {_key(ends, limits): (*ends, limits) for points, limits in ways for ends in pairwise(points)}
    planned = dict(zip(distinct, legs(list(distinct.values()), period), strict=True))  # laps repeat their legs
    found = []
    for (points, limits), (_, _, dwell, settle) in zip(ways, tasks, strict=True):
        poses = [points[:1]]
        for ends in pairwise(points):
            poses += [planned[_key(ends, limits)], np.repeat(ends[1][None], dwell, axis=0)]
        found.append(np.concatenate([*poses, np.repeat(points[-1:], settle, axis=0)]))
    return found


def _key(ends: tuple[Array, Array], limits: MotionLimits) -> tuple[bytes, MotionLimits]:
    return np.array(ends).tobytes(), limits

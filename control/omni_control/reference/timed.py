"""References known in advance, a pose for each frame; the fastest way through way-points as one of them."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits, validate_waypoints
from omni_control.reference.segments import legs


class Reference(Protocol):
    """Where robots should be and how fast they should move there."""

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """Return the reference poses (n, 3) at `frame` and the twists (n, 3) that lead from there to a frame later.

        Args:
            frame: one for all robots, or one each (n,). It need not be whole: a robot may look
                ahead by a latency of 6.4 frames. A reference that is planned anew in every frame
                does not look ahead: it tells by the frame alone whether it has been asked before.
            pose: where the robots are, or are predicted to be, at that frame, (n, 3); ignored by
                one known in advance.
        """
        ...

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """Return what `at` would answer in `frame`, `frame` + 1, ... to robots that follow: (count, n, 3) each.

        Nothing is changed by it, and what `at` answers later is the same with it and without.

        Args:
            frame: as for `at`.
            pose: where the robots are, or are predicted to be, at that frame, (n, 3).
            count: how many frames.
        """
        ...


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
        self._robots = np.arange(self._rows.shape[1])

    @property
    def frames(self) -> int:
        """Number of frames, both ends counted."""
        return len(self.poses)

    def with_initial_rest(self, frames: int) -> "SampledReference":
        """The same after `frames` frames of rest at its start."""
        return SampledReference(np.pad(self.poses, ((frames, 0), (0, 0)), "edge"), self.period)

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """See `Reference`: linear between frames; at rest before the first, which counts as now, and after the last."""
        if not isinstance(frame, float | int):
            poses, twists = self.preview(frame, pose, 1)
            return poses[0], twists[0]
        frame = min(
            max(frame, 0), self.frames - 1
        )  # of most controllers: arrays of indices take four times as long
        row = int(frame)
        here, following = self._rows[row], self._rows[min(row + 1, self.frames - 1)]
        rows = np.repeat(here + (frame - row) * (following - here), len(pose) // len(here), axis=0)
        return rows[:, :3], rows[:, 3:]

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """See `Reference`."""
        last = self.frames - 1
        frames = np.minimum(np.maximum(frame + np.arange(count)[:, None], 0), last)
        before = frames.astype(int)
        here, following = (
            self._rows[i, self._robots] for i in (before, np.minimum(before + 1, last))
        )
        rows = here + (frames - before)[..., None] * (following - here)
        rows = np.repeat(rows, len(pose) // rows.shape[1], axis=1)
        return rows[..., :3], rows[..., 3:]


class PerRobotReference(SampledReference):
    """References known in advance, one for each robot: n robots share a controller, whose routes are not the same.

    Args:
        references: of frames of the same length, n of them.

    Attributes:
        poses: one per frame and robot, (frames, n, 3), to be read only; those that end before
            others rest at their end.

    Raises:
        OmniError: there are none, or their frames differ in length.
    """

    def __init__(self, references: Sequence[SampledReference]) -> None:
        if len({reference.period for reference in references}) != 1:
            raise OmniError(
                "robots that share a controller need references of frames of the same length"
            )
        longest = max(reference.frames for reference in references)
        poses = [
            np.pad(each.poses, ((0, longest - each.frames), (0, 0)), "edge") for each in references
        ]
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
        route = list(pairwise(map(tuple, validate_waypoints(waypoints).tolist())))
        ways = list(dict.fromkeys(route))  # laps repeat their legs
        planned = dict(zip(ways, legs(ways, limits, period), strict=True))
        parts = [np.array(waypoints[:1], float)]
        for way in route:
            parts += [planned[way], np.tile(way[1], (dwell_frames, 1))]
        super().__init__(
            np.pad(np.concatenate(parts), ((0, settle_frames), (0, 0)), "edge"), period
        )

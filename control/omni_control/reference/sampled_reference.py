"""Interface of references, and references that are known in advance: one pose per frame."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from omni_control.arguments import check_types, explain_types
from omni_control.errors import OmniError
from omni_control.kinematics import Array


@runtime_checkable
class Reference(Protocol):
    """Desired poses and twists of robots over time."""

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """Return the desired poses (n, 3) at a frame, and the twists (n, 3) to the next frame.

        Args:
            frame: Frame number, one for all robots or one per robot (n,). It may be fractional: a
                robot may look ahead by a latency of 6.4 frames. A reference that is planned anew in
                every frame does not look ahead. It uses the frame only to detect a repeated call.
            pose: Measured or predicted poses of the robots at that frame, (n, 3). A reference known
                in advance ignores them.
        """
        ...

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """Return the results of `at` in successive frames for robots that follow the reference.

        The state of the reference does not change: a preview has no effect on later results.

        Args:
            frame: First frame, as for `at`.
            pose: Measured or predicted poses of the robots at that frame, (n, 3).
            count: Number of frames.

        Returns:
            Poses and twists, (count, n, 3) each.
        """
        ...


@explain_types
class SampledReference:
    """Reference known in advance, one for all robots or one per robot.

    Args:
        poses: Pose of each frame, (frames, 3) for all robots or (frames, n, 3) per robot. Headings
            are unwrapped (continuous, not limited to (-pi, pi]).
        period: Length of a frame, s.

    Attributes:
        poses: Poses as above, read-only because controllers share them.

    Raises:
        OmniError: There are no poses, or one is not three finite numbers.
    """

    @check_types
    def __init__(self, poses: ArrayLike, period: float) -> None:
        self.period, self.poses = check_period(period), as_poses(poses)
        twists = np.diff(self.poses, axis=0, append=self.poses[-1:]) / period
        samples = np.concatenate([self.poses, twists], axis=-1) + 0.0  # turns -0.0 into 0.0
        # Poses with twists, (frames, 1 or n, 6).
        self._samples = samples.reshape(len(samples), -1, 6)
        self._robots = np.arange(self._samples.shape[1])

    @property
    def frames(self) -> int:
        """Number of frames, both ends included."""
        return len(self.poses)

    def with_rest(self, initial_frames: int, final_frames: int = 0) -> "SampledReference":
        """Return the reference with additional frames of rest at its start and at its end."""
        rest = [(initial_frames, final_frames), *(self.poses.ndim - 1) * [(0, 0)]]
        return SampledReference(np.pad(self.poses, rest, "edge"), self.period)

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """Return poses and twists at a frame; see `Reference`.

        Both are interpolated linearly between frames. Before the first frame and after the last,
        the reference rests.
        """
        poses, twists = self.preview(frame, pose, 1)
        return poses[0], twists[0]

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """Return poses and twists of successive frames; see `Reference`."""
        last_frame = self.frames - 1
        frames = np.minimum(np.maximum(frame + np.arange(count)[:, None], 0), last_frame)
        index = frames.astype(int)
        start = self._samples[index, self._robots]
        end = self._samples[np.minimum(index + 1, last_frame), self._robots]
        samples = start + (frames - index)[..., None] * (end - start)
        samples = np.repeat(samples, len(pose) // samples.shape[1], axis=1)
        return samples[..., :3], samples[..., 3:]


class PerRobotReference(SampledReference):
    """Combination of references known in advance, one per robot of a controller.

    Args:
        references: One reference per robot, all with the same period and with poses (frames, 3).

    Attributes:
        poses: Read-only poses, (frames, n, 3). Shorter references rest at their end.

    Raises:
        OmniError: There are no references, or their frames differ in length.
    """

    def __init__(self, references: Sequence[SampledReference]) -> None:
        if len({reference.period for reference in references}) != 1:
            raise OmniError(
                "robots that share a controller need references with frames of the same length"
            )
        frames = max(reference.frames for reference in references)
        poses = [
            reference.with_rest(0, frames - reference.frames).poses for reference in references
        ]
        super().__init__(np.stack(poses, axis=1), references[0].period)


def combine_references(references: Sequence[SampledReference]) -> SampledReference:
    """Return one reference for several robots: the one that all share, or a combination."""
    is_shared = all(reference is references[0] for reference in references)
    return references[0] if is_shared else PerRobotReference(references)


def check_period(period: float) -> float:
    """Return the length of a frame, s.

    Raises:
        OmniError: It is not a positive number.
    """
    if not 0 < period < np.inf:
        raise OmniError(f"period must be a positive number of seconds, got {period}")
    return period


def as_poses(poses: ArrayLike) -> Array:
    """Return poses or way-points as a read-only array (..., 3) of two or more dimensions.

    Raises:
        OmniError: There are no poses, or one is not three finite numbers.
    """
    try:
        array = np.array(poses, float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.ndim < 2 or not array.size or array.shape[-1] != 3 or not np.isfinite(array).all():
        raise OmniError(
            "a reference needs at least one pose or way-point, each three finite numbers "
            "[x, y, heading]"
        )
    array.flags.writeable = False
    return array

"""What a controller may ask of a reference, known in advance or planned anew in each frame."""

from typing import Protocol

from omni_control.kinematics import Array


class Reference(Protocol):
    """Where robots should be and how fast they should move there."""

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """Return the reference poses (n, 3) at `frame` and the twists (n, 3) that lead from there to a frame later.

        Args:
            frame: one for all robots, one each (n,), or one for each component of each pose (n, 3). It need not be
                whole: a robot may look ahead by a latency of 6.4 frames. A reference that is planned anew in every
                frame does not look ahead: it tells by the frame alone whether it has been asked before.
            pose: where the robots are, or are predicted to be, at that frame, (n, 3); ignored by one known in advance.
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

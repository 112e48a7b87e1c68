"""The way that robots made lately, to compare what a camera saw a while ago with what is believed of now."""

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array

Vectors = NDArray[Any]  # (n, ...): real, or complex ones of the plane

KEPT_FRAMES = 64


class Way:
    """What robots moved in each of the last frames, by the velocities that are believed now.

    A velocity that was corrected since was as wrong in the frames before: they are counted with what it is corrected by,
    so that where a robot was depends on its velocity now as on time, -a for an age a. A filter that corrects by this
    with the way that it believed in then would correct too much, and swing.

    Args:
        period: length of a frame, s.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._frames: deque[tuple[Vectors, Vectors, Vectors]] = deque(maxlen=KEPT_FRAMES)

    def add(self, moved: Vectors, before: Vectors, after: Vectors) -> None:
        """Add the frame just past; the arrays must not change from then on.

        Args:
            moved: in it, (n, ...).
            before, after: velocities (n, ...) when it began, and as they were expected when it ended.
        """
        self._frames.append((moved, before, after))

    def since(self, age: Array) -> Vectors:
        """What robots moved in the time `age` (n,) until now, s, evenly within each frame; (n, ...)."""
        frames = age / self._period
        corrected = total = np.zeros_like(self._frames[-1][0])
        later = self._frames[-1][2]  # as it is expected is all that is known of now
        for back, (moved, before, after) in zip(range(int(np.ceil(frames.max()))), reversed(self._frames), strict=False):
            corrected = corrected + (later - after)
            share = np.minimum(np.maximum(frames - back, 0.0), 1.0).reshape(-1, *(1,) * (moved.ndim - 1))
            total = total + share * (moved + self._period * corrected)
            later = before
        return total

"""Filters of vision that comes late: how far behind the present they are, and how they go on."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.delay import Rows
from omni_control.kinematics import Array

MOST_FRAMES = 15  # that filters may be behind; of what is older they are told that it is no older
_ROUNDING = 1e-6  # of a frame


class Late(NamedTuple):
    """A step of filters of n robots, which ends at a frame in the past.

    Attributes:
        behind: by how many frames that lies before the present, (n,).
        held: which stay where they are, (n,).
        after: how much later vision saw what it reports with this step, (n,) s.
    """

    behind: Array
    held: NDArray[np.bool_]
    after: Array

    def of(self, rows: Rows) -> "Late":
        """The same of some robots, in arrays of its own."""
        return Late(self.behind[rows].copy(), self.held[rows].copy(), self.after[rows].copy())


class Clock:
    """Where filters are: at the last frame that was over when vision saw a robot.

    From there to the present robots are predicted by the commands, as over the dead time. To correct the present by the
    past would need the velocity that is to be corrected, and take for evidence what came upon it since.

    Args:
        n: robots.
        period: length of a frame, s.
    """

    def __init__(self, n: int, period: float) -> None:
        self._period, self.behind = period, np.zeros(n)

    def steps(self, age: Array, seen: Array) -> list[Late]:
        """The steps of this frame, of which the last has what vision reports: of this age (n,) s, of robots seen (n,).

        An image from before the frame where a robot's filter is, as may come after one that had none, finds it waiting.
        """
        frames = np.minimum(age / self._period, MOST_FRAMES)
        wanted = np.where(seen, np.ceil(frames - _ROUNDING), self.behind)
        behind = np.minimum(wanted, self.behind + 1)
        steps = self.behind + 1 - behind
        after = np.where(seen, (behind - frames) * self._period, 0.0)
        self.behind = behind
        left = range(max(int(steps.max()), 1) - 1, -1, -1)
        return [Late(behind + more, steps <= more, after if more == 0 else 0 * after) for more in left]

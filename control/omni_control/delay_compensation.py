"""Dead time: commands that are in flight, and the pose predicted to the end of it (equations 10 and 11)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array

Rows = slice | Sequence[int] | np.ndarray[Any, np.dtype[np.intp]]


class CommandHistory:
    """The last commands sent by each robot's controller, newest last.

    With a dead time of k_d frames, the pose measured in frame k has felt the commands up to k - k_d
    - 1, and the command computed in frame k acts from frame k + k_d on. In between lie k_d commands
    already sent:

        k_d = 2         frame k-3   k-2   k-1    k    k+1   k+2
        sent                u0     u1     u2     ?
        felt in                           u0     u1    u2     ?      <- x(k) has felt u0's frame,
                                                                        u1 and u2 are in flight

    Equation 11 sums to i = k, which includes the command that is being computed; the k_d in flight
    are meant.

    A latency need not be a whole number of frames, nor the same for all robots and axes: with one
    of 1.5 frames, the first half of the frame just past felt the command sent before the command
    that its second half felt.

    Args:
        n: robots.
        length: commands kept, at least the dead time k_d.
    """

    def __init__(self, n: int, length: int) -> None:
        self._store(np.zeros((length, n, 3)))

    def _store(self, table: Array) -> None:
        table.flags.writeable = False
        self._sent, self.length = table, len(table)

    def append(self, command: Array) -> None:
        """Add the commands (n, 3) that were sent in the frame just past."""
        if self.length:
            self._store(
                np.concatenate([self._sent[1:], command[None]])
            )  # who was handed the last table keeps it

    def select(self, rows: Rows, length: int | None = None) -> "CommandHistory":
        """Return a queue of some robots' last `length` commands [all].

        Raises:
            OmniError: more than are stored.
        """
        part = object.__new__(CommandHistory)
        part._store(self.get_latest(self.length if length is None else length)[:, rows])
        return part

    def get_latest(self, count: int, skip: int = 0) -> Array:
        """Return the `count` commands sent before the `skip` newest, (count, n, 3), oldest first, to be read only.

        Raises:
            OmniError: more than are stored.
        """
        if count + skip > self.length:
            raise OmniError(
                f"{count + skip} commands were asked for, but only {self.length} are kept"
            )
        return self._sent[self.length - skip - count : self.length - skip]

    def get_pending_fractions(self, latency: float | Array, count: int | None = None) -> Array:
        """Return the share of each command that is still to act, (count, n or 1, 3 or 1).

        Args:
            latency: frames, one for all, or (n, 1), or (n, 3).
            count: of the last commands. [all]
        """
        since = np.arange((self.length if count is None else count) - 1, -1.0, -1)[
            :, None, None
        ]  # frames
        shares: Array = np.minimum(np.maximum(latency - since, 0.0), 1.0)
        return shares

    def get_delayed(self, latency: float | Array) -> Array:
        """Return the commands that acted in the frame just past, on its average, (..., n, 3).

        Args:
            latency: frames, one for all, or (..., n, 1), or (..., n, 3).
        """
        if isinstance(latency, float | int):  # of most robots: a tenth of their team's time
            newest = self.length - 1 - int(latency)
            return np.asarray(
                self._sent[newest] + latency % 1 * (self._sent[newest - 1] - self._sent[newest])
            )
        frames = latency.astype(int)
        robots, axes = np.arange(self._sent.shape[1])[:, None], np.arange(3)
        row = self.length - 1 - frames
        newer, older = self._sent[row, robots, axes], self._sent[row - 1, robots, axes]
        return np.asarray(newer + (latency - frames) * (older - newer))


def predict_displacement(in_flight: Array, alpha: Array | float, period: float) -> Array:
    """Displacement (n, 3) that commands in flight will still cause (equation 11).

    Args:
        in_flight: world-frame commands (k_d, n, 3), m/s and rad/s.
        alpha: motor correction factors (n, 3), 1 for a robot that does as told.
        period: length of a frame T, s.
    """
    return alpha * in_flight.sum(0) * period

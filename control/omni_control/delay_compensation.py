"""Dead time: history of sent commands, and the displacement by commands in flight (equation 11)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from omni_control.arguments import check_types, explain_types
from omni_control.errors import OmniError
from omni_control.kinematics import Array

RowSelection = slice | Sequence[int] | np.ndarray[Any, np.dtype[np.intp]]


@explain_types
@check_types
class CommandHistory:
    """The latest commands sent to n robots, newest last.

    With a dead time of k_d frames, the pose measured in frame k depends on the commands up to
    k - k_d - 1. The command computed in frame k acts from frame k + k_d on. The k_d commands in
    between are in flight:

        k_d = 2         frame k-3   k-2   k-1    k    k+1   k+2
        sent                u0     u1     u2     ?
        acts in                           u0     u1    u2     ?      <- x(k) includes u0's effect,
                                                                        u1 and u2 are in flight

    The sum of equation 11 ends at i = k, and thus includes the command that is being computed. Here
    the sum contains only the k_d commands in flight.

    A latency need not be an integer, nor the same for all robots and axes. With a latency of 1.5
    frames, one command acted in the first half of the previous frame and the next one in its
    second half.

    Args:
        n: Number of robots.
        length: Number of stored commands, at least the dead time k_d.
    """

    def __init__(self, n: int, length: int) -> None:
        self._store(np.zeros((length, n, 3)))

    def _store(self, commands: Array) -> None:
        commands.flags.writeable = False
        self._sent, self.length = commands, len(commands)

    def append(self, command: Array) -> None:
        """Add the commands (n, 3) of the previous frame. Arrays returned earlier stay valid."""
        if self.length:
            self._store(np.concatenate([self._sent[1:], command[None]]))

    def select(self, rows: RowSelection, length: int | None = None) -> "CommandHistory":
        """Return the history of some robots with their latest `length` commands. Default: all.

        Raises:
            OmniError: `length` exceeds the number of stored commands.
        """
        selection = object.__new__(CommandHistory)
        selection._store(self.get_latest(self.length if length is None else length)[:, rows])
        return selection

    def get_latest(self, count: int, skip: int = 0) -> Array:
        """Return `count` commands before the `skip` newest, (count, n, 3), oldest first; read-only.

        Raises:
            OmniError: `count + skip` exceeds the number of stored commands.
        """
        if count + skip > self.length:
            raise OmniError(f"{count + skip} commands requested, but only {self.length} are stored")
        return self._sent[self.length - skip - count : self.length - skip]

    def get_pending_fractions(self, latency: float | Array, count: int | None = None) -> Array:
        """Return the fraction of each command that is still to act, (count, n or 1, 3 or 1).

        Args:
            latency: Frames; one for all, (n, 1), or (n, 3).
            count: Number of commands, counted from the newest. Default: all.
        """
        n_commands = self.length if count is None else count
        frames_since_sent = np.arange(n_commands - 1, -1.0, -1)[:, None, None]
        return np.minimum(np.maximum(latency - frames_since_sent, 0.0), 1.0)

    def get_delayed(self, latency: float | Array) -> Array:
        """Return the mean command that acted during the previous frame, (..., n, 3).

        A latency that is not an integer interpolates between two commands.

        Args:
            latency: Frames; one for all, (..., n, 1), or (..., n, 3).
        """
        latency = np.asarray(latency)
        frames = latency.astype(int)
        robots, axes = np.arange(self._sent.shape[1])[:, None], np.arange(3)
        index = self.length - 1 - frames
        newer, older = self._sent[index, robots, axes], self._sent[index - 1, robots, axes]
        return newer + (latency - frames) * (older - newer)


def predict_displacement(commands_in_flight: Array, alpha: Array | float, period: float) -> Array:
    """Return the displacement (n, 3) that commands in flight will still cause (equation 11).

    Args:
        commands_in_flight: World-frame commands (k_d, n, 3), m/s and rad/s.
        alpha: Motor correction factors, (n, 3) or one for all; 1 for a nominal robot.
        period: Length of a frame T, s.
    """
    return alpha * commands_in_flight.sum(0) * period

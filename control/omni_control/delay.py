"""Dead time: commands that are in flight, and the pose predicted to the end of it (equations 10 and 11)."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Number

Rows = slice | Sequence[int] | np.ndarray[Any, np.dtype[np.intp]]


class Acted(NamedTuple):
    """Commands that acted in the frame just past, on its average, (n, 3); see `CommandsInFlight.around`.

    Attributes:
        command: those.
        change: by how much they were more, if the latency were longer by so many `frames`, (n,).
    """

    command: Array
    change: Array
    frames: Array


class CommandsInFlight:
    """The last commands sent by each robot's controller, newest last.

    With a dead time of k_d frames, the pose measured in frame k has felt the commands up to k - k_d - 1, and the
    command computed in frame k acts from frame k + k_d on. In between lie k_d commands already sent:

        k_d = 2         frame k-3   k-2   k-1    k    k+1   k+2
        sent                u0     u1     u2     ?
        felt in                           u0     u1    u2     ?      <- x(k) has felt u0's frame,
                                                                        u1 and u2 are in flight

    Equation 11 sums to i = k, which includes the command that is being computed; the k_d in flight are meant.

    A latency need not be a whole number of frames, nor the same for all robots and axes: with one of 1.5 frames, the
    first half of the frame just past felt the command sent before the command that its second half felt.

    Args:
        n: robots.
        length: commands kept, at least the dead time k_d.
    """

    def __init__(self, n: int, length: int) -> None:
        self.length = length
        self._sent = np.zeros((2 * length, n, 3))  # the newest ends at _end; what is written stays as it is
        self._end, self._shown = length, _to_read(self._sent)

    def push(self, command: Array) -> None:
        """Add the commands (n, 3) that were sent in the frame just past.

        Raises:
            OmniError: these commands are somebody else's, given to be read.
        """
        if not self._sent.flags.writeable:
            raise OmniError("commands that were handed out can only be read; a queue of your own takes more")
        if not self.length:
            return
        if self._end == len(self._sent):  # a new table, since views of the old one have been handed out
            kept = self._sent[self._end - self.length + 1 :]
            self._sent, self._end = np.zeros_like(self._sent), self.length - 1
            self._sent[: self._end], self._shown = kept, _to_read(self._sent)
        self._sent[self._end] = command
        self._end += 1

    def of(self, rows: Rows, length: int | None = None) -> "CommandsInFlight":
        """The same of some robots, the last `length` commands (all, if none is given), to be read only.

        Raises:
            OmniError: more than are kept.
        """
        part = object.__new__(CommandsInFlight)
        part._sent = self.last(self.length if length is None else length)[:, rows]
        if not isinstance(rows, slice):
            part._sent.flags.writeable = False
        part._shown = part._sent
        part.length = part._end = len(part._sent)
        return part

    def copy(self) -> "CommandsInFlight":
        """The same, in an array of its own."""
        other = object.__new__(CommandsInFlight)
        other._sent, other.length, other._end = self._sent.copy(), self.length, self._end
        other._sent.flags.writeable = False
        other._shown = other._sent
        return other

    def last(self, count: int, skip: int = 0) -> Array:
        """The `count` commands sent before the `skip` newest, (count, n, 3), oldest first, to be read only.

        Raises:
            OmniError: more than are kept.
        """
        if count + skip > self.length:
            raise OmniError(f"{count + skip} commands were asked for, but only {self.length} are kept")
        end = self._end - skip
        return self._shown[end - count : end]

    def ahead(self, latency: float | Array) -> Array:
        """Share of each command kept that is still to act, (length, n, 3), for a latency (n, 3) in frames."""
        if isinstance(latency, float | int):
            return _ahead_alike(latency, self.length)
        shares: Array = left(latency, _since(self.length))
        return shares

    def acted(self, latency: float | Array) -> Array:
        """Share of each command kept that acted in the frame just past, (length, n, 3), for a latency (n, 3)."""
        return acted(latency, self.length)

    def felt(self, latency: float | Array) -> Array:
        """Commands (n, 3) that acted in the frame just past, on its average, for a latency (n, 3) in frames."""
        return (self.acted(latency) * self.last(self.length)).sum(0)

    def around(self, latency: Array, spread: Array) -> Acted:
        """What robots have felt by a latency (n,), and from one shorter to one longer by a spread (n,), in frames."""
        sooner, later = np.maximum(latency - spread, 0.0), latency + spread
        shares = self.acted(np.array([latency, sooner, later]))[..., None]
        acting, early, belated = np.add.reduce(shares * self.last(self.length)[:, None])
        return Acted(acting, belated - early, later - sooner)


def _to_read(table: Array) -> Array:
    """The same table, to be read only."""
    shown = table.view()
    shown.flags.writeable = False
    return shown


def acted(latency: float | Array, length: int) -> Array:
    """Share of each of the last `length` commands that acted in the frame just past; see `CommandsInFlight.acted`."""
    return np.maximum(1 - np.abs(latency - _since(length)), 0.0)


def left(latency: Number, since: Number) -> Number:
    """Share of a command that is still to act, so many frames since it was sent."""
    return np.minimum(np.maximum(latency - since, 0.0), 1.0)


@lru_cache
def _ahead_alike(latency: float, length: int) -> Array:
    """Those of one latency for all, which is asked for again in every frame."""
    shares: Array = left(latency, _since(length))
    shares.flags.writeable = False
    return shares


@lru_cache
def _since(length: int) -> Array:
    """Whole frames since each of so many commands was sent, (length, 1, 1): 0 for the newest."""
    frames = np.arange(length - 1, -1.0, -1)[:, None, None]
    frames.flags.writeable = False
    return frames


def compensation(in_flight: Array, alpha: Array | float, period: float) -> Array:
    """Displacement (n, 3) that commands in flight will still cause (equation 11).

    Args:
        in_flight: world-frame commands (k_d, n, 3), m/s and rad/s.
        alpha: motor correction factors (n, 3), 1 for a robot that does as told.
        period: length of a frame T, s.
    """
    return caused(in_flight.sum(0), alpha, period)


def caused(commands: Number, alpha: Number, period: float) -> Number:
    """Displacement by a sum of commands."""
    return alpha * commands * period

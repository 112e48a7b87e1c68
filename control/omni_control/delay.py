"""Dead time: commands that are in flight, and the pose predicted to the end of it (equations 10 and 11)."""

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array


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
        self._sent = np.zeros((length, n, 3))
        self._age = np.arange(length, 0.0, -1)[:, None, None]

    def push(self, command: Array) -> None:
        """Add the commands (n, 3) that were sent in the frame just past."""
        if len(self._sent):
            self._sent[:-1] = self._sent[1:]
            self._sent[-1] = command

    def last(self, count: int, skip: int = 0) -> Array:
        """The `count` commands sent before the `skip` newest, (count, n, 3), oldest first; valid until the next push.

        Raises:
            OmniError: more than are kept.
        """
        if count + skip > len(self._sent):
            raise OmniError(f"{count + skip} commands were asked for, but only {len(self._sent)} are kept")
        end = len(self._sent) - skip
        return self._sent[end - count : end]

    def ahead(self, latency: float | Array) -> Array:
        """Share of each command kept that is still to act, (length, n, 3), for a latency (n, 3) in frames."""
        return np.clip(latency - (self._age - 1), 0.0, 1.0)

    def acted(self, latency: float | Array) -> Array:
        """Share of each command kept that acted in the frame just past, (length, n, 3), for a latency (n, 3)."""
        return np.clip(latency - (self._age - 2), 0.0, 1.0) - self.ahead(latency)

    def felt(self, latency: float | Array) -> Array:
        """Commands (n, 3) that acted in the frame just past, on its average, for a latency (n, 3) in frames."""
        return (self.acted(latency) * self._sent).sum(0)


def compensation(in_flight: Array, alpha: Array, period: float) -> Array:
    """Displacement (n, 3) that commands in flight will still cause (equation 11).

    Args:
        in_flight: world-frame commands (k_d, n, 3), m/s and rad/s.
        alpha: motor correction factors (n, 3), 1 for a robot that does as told.
        period: length of a frame T, s.
    """
    return alpha * in_flight.sum(0) * period

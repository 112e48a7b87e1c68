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

    Args:
        n: robots.
        length: commands kept, at least the dead time k_d.
    """

    def __init__(self, n: int, length: int) -> None:
        self._sent = np.zeros((length, n, 3))

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


def compensation(in_flight: Array, alpha: Array, period: float) -> Array:
    """Displacement (n, 3) that commands in flight will still cause (equation 11).

    Args:
        in_flight: world-frame commands (k_d, n, 3), m/s and rad/s.
        alpha: motor correction factors (n, 3), 1 for a robot that does as told.
        period: length of a frame T, s.
    """
    return alpha * in_flight.sum(0) * period

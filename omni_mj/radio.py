"""The radio link: a queue in which each command spends k_d frames."""

import numpy as np

from omni_control.kinematics import Array


class Radio:
    """Ring of packets in flight: a command, and the heading that vision saw when it was sent.

    With a delay of 2 frames, sending a, b, c, d in frames 0 to 3 delivers nothing, nothing, a, b; nothing is a command
    of zero and a heading that is not a number.

    Args:
        n: robots.
        delay_frames: frames from sending to delivery, 0 or more.
    """

    def __init__(self, n: int, delay_frames: int) -> None:
        self._ring = np.tile([0.0, 0.0, 0.0, np.nan], (delay_frames + 1, n, 1))
        self._head = 0

    def exchange(self, command: Array, heading: Array) -> tuple[Array, Array]:
        """Send commands (n, 3) and headings (n,); return those that arrive in this frame."""
        self._ring[self._head] = np.column_stack([command, heading])
        self._head = (self._head + 1) % len(self._ring)
        arrived = self._ring[self._head].copy()
        return arrived[:, :3], arrived[:, 3]

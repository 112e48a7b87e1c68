"""The radio link: a queue in which each command spends k_d frames."""

import numpy as np

from omni_control.kinematics import Array


class Radio:
    """Ring of commands in flight.

    With a delay of 2 frames, sending a, b, c, d in frames 0 to 3 delivers 0, 0, a, b.

    Args:
        n: robots.
        delay_frames: frames from sending to delivery, 0 or more.
    """

    def __init__(self, n: int, delay_frames: int) -> None:
        self._ring = np.zeros((delay_frames + 1, n, 3))
        self._head = 0

    def exchange(self, command: Array) -> Array:
        """Send commands (n, 3) and return those that arrive in this frame; zero before the first arrives."""
        self._ring[self._head] = command
        self._head = (self._head + 1) % len(self._ring)
        return self._ring[self._head].copy()

"""What the team's computer may command: speed and acceleration limits on the way to the radio."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference.limits import MotionLimits


class CommandLimits:
    """Limits on velocity commands and their change per frame, by the norm of translation and by turn.

    Args:
        limits: those of each of n robots.
        period: length of a frame T, s.
    """

    def __init__(self, limits: Sequence[MotionLimits], period: float) -> None:
        table = np.array([[s.speed, s.turn_rate, s.acceleration, s.turn_acceleration] for s in limits])
        self._highest, self._step = table[:, :2], table[:, 2:] * period

    def __call__(self, command: Array, last: Array) -> Array:
        """Return the commands (n, 3) that may be sent, given those wanted and those sent before."""
        return last + _clip(_clip(command, self._highest) - last, self._step)


def _clip(vector: Array, limit: Array) -> Array:
    """Return vectors (n, 3) whose translation and turn are at most limits (n, 2)."""
    clipped = np.empty_like(vector)
    size, turn = np.hypot(vector[:, 0], vector[:, 1]), limit[:, 1]
    scale = np.minimum(limit[:, 0] / np.maximum(size, 1e-300), 1.0)
    np.multiply(vector[:, :2], scale[:, None], out=clipped[:, :2])
    clipped[:, 2] = np.minimum(np.maximum(vector[:, 2], -turn), turn)
    return clipped

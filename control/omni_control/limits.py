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
        speed, turn_rate, acceleration, turn_acceleration = np.array(
            [[s.speed, s.turn_rate, s.acceleration, s.turn_acceleration] for s in limits]
        ).T[..., None]
        self._highest = speed, turn_rate, -turn_rate
        turn_step = turn_acceleration * period
        self._step = acceleration * period, turn_step, -turn_step

    def __call__(self, command: Array, last: Array) -> Array:
        """Return the commands (n, 3) that may be sent, given those wanted and those sent before."""
        return last + _clip(_clip(command, *self._highest) - last, *self._step)


def _clip(vector: Array, size: Array, turn: Array, turn_back: Array) -> Array:
    """Return vectors (n, 3) whose translation and turn are at most as large as limits (n, 1)."""
    clipped = np.minimum(np.maximum(vector, turn_back), turn)
    translation = vector[:, :2]
    norm = np.hypot(translation[:, :1], translation[:, 1:])
    np.multiply(translation, size / np.maximum(norm, size), out=clipped[:, :2])
    return clipped

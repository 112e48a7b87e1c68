"""Limits of speed and slew rate for the commands that a team sends."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits

AT_LIMIT = 1 - 1e-6  # fraction of a limit from which a command is at the limit, for rounding


class CommandLimiter:
    """Limiter of the commands of n robots and of their change from frame to frame.

    Translation is limited by its norm, rotation by its absolute value.

    Args:
        limits: Limits of each of the n robots.
        period: Length of a frame T, s.
    """

    def __init__(self, limits: Sequence[MotionLimits], period: float) -> None:
        speed, turn_rate, acceleration, turn_acceleration = np.array(
            [
                [limit.speed, limit.turn_rate, limit.acceleration, limit.turn_acceleration]
                for limit in limits
            ]
        ).T[..., None]
        self._max_command = speed, turn_rate
        self._max_change = acceleration * period, turn_acceleration * period

    def is_active(self, command: Array, last_command: Array) -> NDArray[np.bool_]:
        """Return whether sent commands (n, 3) are at a limit: x, y and turning, (n, 3)."""
        speed = _compute_norms(command) / np.hstack(self._max_command)
        change = _compute_norms(command - last_command) / np.hstack(self._max_change)
        is_at_limit: NDArray[np.bool_] = np.maximum(speed, change) > AT_LIMIT
        return is_at_limit[:, [0, 0, 1]]

    def __call__(self, command: Array, last_command: Array) -> Array:
        """Return the commands (n, 3) within the limits.

        Args:
            command: Desired commands [vx, vy, w], (n, 3), m/s and rad/s.
            last_command: Commands sent in the previous frame, (n, 3).
        """
        change = _clip_translation_and_rotation(command, *self._max_command) - last_command
        return last_command + _clip_translation_and_rotation(change, *self._max_change)


def _compute_norms(vectors: Array) -> Array:
    """Return the norm of [x, y] and |z| of vectors (n, 3), (n, 2)."""
    return np.stack([np.hypot(vectors[:, 0], vectors[:, 1]), np.abs(vectors[:, 2])], axis=1)


def _clip_translation_and_rotation(
    vectors: Array, max_translation: Array, max_rotation: Array
) -> Array:
    """Return vectors (n, 3), clipped to limits (n, 1) of the norm of [x, y] and of |z|."""
    clipped = np.minimum(np.maximum(vectors, -max_rotation), max_rotation)
    norm = np.hypot(vectors[:, :1], vectors[:, 1:2])
    clipped[:, :2] = vectors[:, :2] * (max_translation / np.maximum(norm, max_translation))
    return clipped

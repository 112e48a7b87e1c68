"""What the team's computer may command: speed and acceleration limits on the way to the radio."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S, ControlSettings


class CommandLimits:
    """Limits velocity commands and their change per frame, translation by its norm and rotation by itself."""

    def __init__(self, settings: ControlSettings, n: int) -> None:
        self._settings = settings
        self._last = np.zeros((n, 3))

    def __call__(self, command: Array) -> Array:
        """Return the commands (n, 3) that may be sent, given those wanted."""
        s = self._settings
        step = self._clip(command, s.max_speed_m_s, s.max_turn_rate_rad_s) - self._last
        step = self._clip(step, s.max_acceleration_m_s2 * PERIOD_S, s.max_turn_acceleration_rad_s2 * PERIOD_S)
        self._last = self._last + step
        return self._last

    @staticmethod
    def _clip(vector: Array, translation: float, rotation: float) -> Array:
        size = np.sqrt((vector[:, :2] ** 2).sum(1, keepdims=True))
        scale = np.minimum(1.0, translation / np.maximum(size, 1e-300))
        return np.concatenate([vector[:, :2] * scale, np.clip(vector[:, 2:], -rotation, rotation)], axis=1)

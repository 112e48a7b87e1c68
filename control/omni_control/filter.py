"""Smoothing of vision: a steady-state Kalman (alpha-beta) filter of pose and twist."""

import numpy as np

from omni_control.kinematics import Array, wrap_angle


class PoseFilter:
    """Constant-velocity filter of the poses that vision reports at a fixed rate.

    Args:
        pose: poses at the start, (n, 3).
        period: time between frames, s.
        smoothing: in (0, 1): how much of a surprise is believed to be noise. The gains are those of a critically
            damped filter, 1 - s^2 for the pose and (1 - s)^2 for the twist, whose memory is about 2 / (1 - s) frames.
    """

    def __init__(self, pose: Array, period: float, smoothing: float) -> None:
        self.pose = np.array(pose, float)
        self.twist = np.zeros_like(self.pose)
        self._period = period
        self._pose_gain, self._twist_gain = 1 - smoothing**2, (1 - smoothing) ** 2

    def update(self, measured: Array, valid: Array) -> Array:
        """Return the filtered poses (n, 3); headings count full turns.

        Args:
            measured: poses seen by vision (n, 3).
            valid: whether a robot was seen (n,); the pose of one that was not is carried on at its twist.
        """
        predicted = self.pose + self.twist * self._period
        surprise = measured - predicted
        surprise[:, 2] = wrap_angle(surprise[:, 2])
        surprise[np.logical_not(valid)] = 0.0
        self.pose = predicted + self._pose_gain * surprise
        self.twist = self.twist + self._twist_gain / self._period * surprise
        return self.pose

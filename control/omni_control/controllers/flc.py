"""The paper's controllers: FLC, and comp-FLC, which compensates the dead time."""

import numpy as np

from omni_control.controllers.base import Controller, Seen, Told
from omni_control.delay import compensation
from omni_control.estimation.alpha import AlphaEstimator
from omni_control.fuzzy.rules import FuzzyLaw
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import Reference


class Flc(Controller):
    """FLC: reference velocity as feed-forward, the fuzzy controller's correction, and a proportional heading hold.

    It compares the pose of now with the reference of now, as if commands acted at once.
    """

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        self.fuzzy = FuzzyLaw(told.error_range_m, told.speed_range_m_s)

    def command(self, frame: int, seen: Seen) -> Array:
        """See `Controller`."""
        return self.track(frame, seen.pose)

    def track(self, frame: int, pose: Array) -> Array:
        """Command (n, 3) that brings robots which are at `pose` (n, 3) in `frame` to the reference of that frame."""
        self.predicted = pose
        target, feed_forward = self.reference.at(frame, pose)
        error = target - pose
        turn = self.told.heading_gain * wrap_angle(error[:, 2:])
        return feed_forward + np.concatenate([self.fuzzy(error[:, :2]), turn], axis=1)


class CompFlc(Flc):
    """comp-FLC: the same, for the pose predicted at the end of the dead time and the reference of that time."""

    def __init__(self, told: Told, reference: Reference, n: int) -> None:
        super().__init__(told, reference, n)
        window, delay = told.alpha_window_frames, told.delay_frames
        self.memory_frames = window + delay
        self.alpha = AlphaEstimator(n, window, delay, told.period)

    def command(self, frame: int, seen: Seen) -> Array:
        """See `Controller`."""
        self.alpha_hat[:, :2] = self.alpha.update(seen.pose[:, :2], seen.sent)
        predicted = seen.pose + compensation(seen.in_flight, self.alpha_hat, self.told.period)
        return self.track(frame + self.told.delay_frames, predicted)

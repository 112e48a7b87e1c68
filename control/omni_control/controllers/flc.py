"""The paper's controllers: FLC, and comp-FLC, which compensates the dead time."""

import math

import numpy as np

from omni_control.controllers.base import Controller, Seen, Told
from omni_control.delay import compensation
from omni_control.estimation.alpha import AlphaEstimator
from omni_control.fuzzy import FuzzyLaw
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

    def track(self, frame: float, pose: Array) -> Array:
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
        self.latency = self.latency_told(told)
        window, whole = told.alpha_window_frames, round(self.latency)
        self.memory_frames = window + math.ceil(self.latency)
        self.alpha = AlphaEstimator(n, window, whole, told.period)

    @staticmethod
    def latency_told(told: Told) -> float:
        """Time from a command to its effect that is compensated, frames."""
        return told.delay_frames

    def command(self, frame: int, seen: Seen) -> Array:
        """See `Controller`."""
        pose, sent = seen.pose, seen.sent
        self.alpha_hat[:, :2] = self.alpha.update(pose[:, :2], sent)
        in_flight = sent.ahead(self.latency) * sent.last(sent.length)
        predicted = pose + compensation(in_flight, self.alpha_hat, self.told.period)
        return self.track(frame + self.latency, predicted)


class CompFlcLag(CompFlc):
    """comp-flc-lag: comp-FLC that is told all of the latency, the dead time and the lag of the wheel loops.

    The paper's compensator knows the radio's dead time only; all others here are told the lag too.
    """

    @staticmethod
    def latency_told(told: Told) -> float:
        """See `CompFlc`."""
        return told.latency_frames

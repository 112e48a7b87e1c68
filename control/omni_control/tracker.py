"""Trajectory trackers: what turns a pose and a reference into a velocity command (figure 4 of the paper).

A tracker is called once a frame with the filtered poses of its robots and the commands that were sent in the frame
before (after the loop's limits), and returns new commands in the world frame.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from omni_control.alpha import AlphaEstimator
from omni_control.delay import CommandsInFlight, compensation
from omni_control.fuzzy import FuzzyController
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import Reference


@dataclass(frozen=True)
class TrackerSettings:
    """What every tracker may know.

    Args:
        period: length of a frame T, s.
        delay_frames: dead time k_d that the tracker reckons with, frames.
        error_range_m, speed_range_m_s: ranges of the fuzzy controller, m and m/s.
        heading_gain: turn rate per heading error of the heading hold, 1/s.
        alpha_window_frames: window of the estimate of alpha, frames.
    """

    period: float
    delay_frames: int
    error_range_m: float = 0.1
    speed_range_m_s: float = 1.0
    heading_gain: float = 3.0
    alpha_window_frames: int = 15


class Tracker(Protocol):
    """A controller of n robots.

    Attributes:
        predicted: pose (n, 3) for which the last command was computed.
        alpha_hat: estimated motor correction factors (n, 2); 1 for a tracker that estimates none.
    """

    predicted: Array
    alpha_hat: Array

    def command(self, frame: int, pose: Array, sent: Array) -> Array:
        """Return commands [vx, vy, w] (n, 3), world frame, m/s and rad/s.

        Args:
            frame: k, from 0.
            pose: filtered poses (n, 3) at frame k.
            sent: commands (n, 3) sent in frame k - 1; zero at k = 0.
        """
        ...


class FuzzyTracker:
    """FLC: reference velocity as feed-forward, the fuzzy controller's correction, and a proportional heading hold.

    It compares the pose of now with the reference of now, as if commands acted at once.
    """

    def __init__(self, settings: TrackerSettings, reference: Reference, n: int) -> None:
        self.settings, self.reference = settings, reference
        self.fuzzy = FuzzyController(settings.error_range_m, settings.speed_range_m_s)
        self.predicted = np.zeros((n, 3))
        self.alpha_hat = np.ones((n, 2))

    def command(self, frame: int, pose: Array, sent: Array) -> Array:
        """See `Tracker`."""
        return self.track(frame, pose)

    def track(self, frame: int, pose: Array) -> Array:
        """Command (n, 3) that brings robots which are at `pose` (n, 3) in `frame` to the reference of that frame."""
        self.predicted = pose
        target, feed_forward = self.reference.at(frame, pose)
        error = target - pose
        turn = self.settings.heading_gain * wrap_angle(error[:, 2:])
        return feed_forward + np.concatenate([self.fuzzy(error[:, :2]), turn], axis=1)


class CompensatedFuzzyTracker(FuzzyTracker):
    """comp-FLC: the same, for the pose predicted at the end of the dead time and the reference of that time."""

    def __init__(self, settings: TrackerSettings, reference: Reference, n: int) -> None:
        super().__init__(settings, reference, n)
        window, delay = settings.alpha_window_frames, settings.delay_frames
        self.sent = CommandsInFlight(n, window + delay)
        self.alpha = AlphaEstimator(n, window, delay, settings.period)

    def command(self, frame: int, pose: Array, sent: Array) -> Array:
        """See `Tracker`."""
        delay = self.settings.delay_frames
        self.sent.push(sent)
        self.alpha_hat = self.alpha.update(pose[:, :2], self.sent)
        alpha = np.concatenate([self.alpha_hat, np.ones((len(pose), 1))], axis=1)
        return self.track(frame + delay, pose + compensation(self.sent.last(delay), alpha, self.settings.period))


TRACKERS: dict[str, type[FuzzyTracker]] = {"flc": FuzzyTracker, "comp-flc": CompensatedFuzzyTracker}

"""Trajectory trackers: what turns an observation and a reference into a velocity command (figure 4 of the paper).

A tracker is called once a frame with what is known of its robots and the commands that were sent in the frame before
(after the loop's limits), and returns new commands in the world frame.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omni_control.delay import CommandsInFlight, compensation
from omni_control.estimation.alpha import AlphaEstimator
from omni_control.fuzzy.rules import FuzzyLaw
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference.timed import Reference


@dataclass(frozen=True)
class Told:
    """What every tracker is told.

    Args:
        period: length of a frame T, s.
        delay_frames: dead time k_d from command to robot, frames; as far as the team knows it.
        lag_s: time constant of the robots' wheel loops, s; as far as the team knows it.
        position_noise_m, heading_noise_rad: standard deviation of what vision sees, per axis.
        drag_m_s: what dry friction may cost the robots of their speed, m/s.
        error_range_m, speed_range_m_s: ranges of the fuzzy controller, m and m/s.
        heading_gain: turn rate per heading error of the heading hold, 1/s.
        alpha_window_frames: window of the estimate of alpha (equation 8), frames.
    """

    period: float
    delay_frames: int
    lag_s: float = 0.02
    position_noise_m: float = 0.0013
    heading_noise_rad: float = 0.01
    drag_m_s: float = 0.04
    error_range_m: float = 0.1
    speed_range_m_s: float = 1.0
    heading_gain: float = 3.0
    alpha_window_frames: int = 15

    @property
    def latency_frames(self) -> float:
        """Time from a command to its effect, on average: the dead time and the wheel loops' lag, frames."""
        return self.delay_frames + self.lag_s / self.period

    @property
    def vision_noise(self) -> tuple[float, float, float]:
        """Standard deviation of what vision sees, per axis of a pose, m and rad."""
        return self.position_noise_m, self.position_noise_m, self.heading_noise_rad


@dataclass(frozen=True)
class Seen:
    """What is known of n robots in a frame, world frame; headings count full turns.

    Args:
        pose: filtered [x, y, heading], (n, 3).
        twist: filtered [vx, vy, w], (n, 3).
        measured: the pose that vision reported in this frame, (n, 3), its heading in (-pi, pi]; not a number where a
            robot was not seen.
    """

    pose: Array
    twist: Array
    measured: Array


class Controller:
    """A controller of n robots; derive from it and write `command`.

    Args:
        settings: what is known of the loop.
        reference: where the robots should be.
        n: robots.

    Attributes:
        predicted: pose (n, 3) for which the last command was computed, for the record.
        alpha_hat: estimated motor correction factors (n, 3), for the record; 1 for a tracker that estimates none.
        latency_hat: estimated time from a command to its effect forward, to the left and turning (n, 3), frames, for
            the record; not a number for a tracker that estimates none.
        knows_truth: whether its observations hold the true pose and twist instead of filtered vision.
    """

    knows_truth: ClassVar[bool] = False

    def __init__(self, settings: Told, reference: Reference, n: int) -> None:
        self.settings, self.reference = settings, reference
        self.predicted = np.full((n, 3), np.nan)
        self.alpha_hat = np.ones((n, 3))
        self.latency_hat = np.full((n, 3), np.nan)

    def command(self, frame: int, observed: Seen, sent: Array) -> Array:
        """Return commands [vx, vy, w] (n, 3), world frame, m/s and rad/s.

        Args:
            frame: k, from 0.
            observed: what is known of the robots at frame k.
            sent: commands (n, 3) sent in frame k - 1; zero at k = 0.
        """
        raise NotImplementedError


class Flc(Controller):
    """FLC: reference velocity as feed-forward, the fuzzy controller's correction, and a proportional heading hold.

    It compares the pose of now with the reference of now, as if commands acted at once.
    """

    def __init__(self, settings: Told, reference: Reference, n: int) -> None:
        super().__init__(settings, reference, n)
        self.fuzzy = FuzzyLaw(settings.error_range_m, settings.speed_range_m_s)

    def command(self, frame: int, observed: Seen, sent: Array) -> Array:
        """See `Controller`."""
        return self.track(frame, observed.pose)

    def track(self, frame: int, pose: Array) -> Array:
        """Command (n, 3) that brings robots which are at `pose` (n, 3) in `frame` to the reference of that frame."""
        self.predicted = pose
        target, feed_forward = self.reference.at(frame, pose)
        error = target - pose
        turn = self.settings.heading_gain * wrap_angle(error[:, 2:])
        return feed_forward + np.concatenate([self.fuzzy(error[:, :2]), turn], axis=1)


class CompFlc(Flc):
    """comp-FLC: the same, for the pose predicted at the end of the dead time and the reference of that time."""

    def __init__(self, settings: Told, reference: Reference, n: int) -> None:
        super().__init__(settings, reference, n)
        window, delay = settings.alpha_window_frames, settings.delay_frames
        self.sent = CommandsInFlight(n, window + delay)
        self.alpha = AlphaEstimator(n, window, delay, settings.period)

    def command(self, frame: int, observed: Seen, sent: Array) -> Array:
        """See `Controller`."""
        delay, pose = self.settings.delay_frames, observed.pose
        self.sent.push(sent)
        self.alpha_hat[:, :2] = self.alpha.update(pose[:, :2], self.sent)
        in_flight = compensation(self.sent.last(delay), self.alpha_hat, self.settings.period)
        return self.track(frame + delay, pose + in_flight)

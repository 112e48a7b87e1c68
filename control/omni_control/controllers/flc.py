"""The paper's controllers: FLC, and comp-FLC, which compensates the dead time (equation 11)."""

import math

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.delay_compensation import CommandHistory, predict_displacement
from omni_control.fuzzy import FuzzyLaw
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import Reference

# Commanded displacement at which a new ratio has the same weight as the old value. It is well
# above the noise of vision.
EQUAL_WEIGHT_M = 0.02
MIN_ALPHA, MAX_ALPHA = 0.5, 1.1


class AlphaEstimator:
    """Ratio of achieved to commanded displacement in a sliding window, per robot and axis.

    Equation 8 sums n_0 ratios of single frames and divides by T. That sum is not in [0.7, 1], but
    60 n_0 times as large, and it divides by zero at rest. The ratio of the window's sums is used
    instead:

        alpha = (dx dx_d + rho alpha_old) / (dx_d^2 + rho)

    Here dx is the displacement measured by vision in the window, and dx_d that of the commands
    which acted in it. The regularization rho keeps the old value at standstill. The weight of an
    old value shrinks by rho / (dx_d^2 + rho) in each frame.

    Args:
        n: Number of robots.
        window_frames: Length of the window n_0, frames.
        delay_frames: Dead time k_d, frames.
        period: Length of a frame T, s.

    Attributes:
        value: Latest estimate, (n, 2).
    """

    def __init__(self, n: int, window_frames: int, delay_frames: int, period: float) -> None:
        self.value = np.ones((n, 2))
        self._window_frames, self._delay_frames = window_frames, delay_frames
        self._period = period
        self._positions: list[Array] = []

    def update(self, position: Array, sent: CommandHistory) -> Array:
        """Return the new estimate of alpha along x and y, (n, 2).

        Args:
            position: Filtered positions (n, 2), m.
            sent: Commands sent before this frame.
        """
        self._positions.append(position.copy())
        if len(self._positions) > self._window_frames + 1:
            del self._positions[0]
        achieved = position - self._positions[0]
        count = len(self._positions) - 1
        commands = sent.get_latest(count, skip=self._delay_frames)[..., :2]
        commanded = np.add.reduce(commands) * self._period
        rho = EQUAL_WEIGHT_M**2
        ratio = (achieved * commanded + rho * self.value) / (commanded * commanded + rho)
        self.value = np.minimum(np.maximum(ratio, MIN_ALPHA), MAX_ALPHA)
        return self.value


class Flc(Controller):
    """FLC: velocity feedforward, fuzzy correction of the position, proportional heading control.

    It compares the present pose with the present reference, as if commands acted at once.
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.fuzzy = FuzzyLaw(model.error_range_m, model.speed_range_m_s)

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        return self.track(frame, observation.pose)

    def track(self, frame: float, pose: Array) -> Array:
        """Return the commands (n, 3) that move robots from `pose` to the reference of `frame`."""
        self.predicted_pose = pose
        target, feedforward = self.reference.at(frame, pose)
        error = target - pose
        turn_rate = self.model.heading_gain * wrap_angle(error[:, 2:])
        return feedforward + np.concatenate([self.fuzzy(error[:, :2]), turn_rate], axis=1)


class CompFlc(Flc):
    """comp-FLC: FLC on the pose and the reference predicted at the end of the dead time."""

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.latency = self.get_compensated_latency(model)
        window_frames = model.alpha_window_frames
        self.memory_frames = window_frames + math.ceil(self.latency)
        self.alpha = AlphaEstimator(n, window_frames, round(self.latency), model.period)

    @staticmethod
    def get_compensated_latency(model: TeamModel) -> float:
        """Return the time from a command to its effect that is compensated, frames."""
        return model.delay_frames

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        pose, sent = observation.pose, observation.sent_commands
        self.alpha_hat[:, :2] = self.alpha.update(pose[:, :2], sent)
        count = math.ceil(self.latency)
        in_flight = sent.get_pending_fractions(self.latency, count) * sent.get_latest(count)
        predicted_pose = pose + predict_displacement(in_flight, self.alpha_hat, self.model.period)
        return self.track(frame + self.latency, predicted_pose)


class CompFlcLag(CompFlc):
    """comp-flc-lag: comp-FLC that compensates the dead time and the lag of the wheel loops.

    The paper's compensator knows the dead time of the radio only. All other controllers here also
    know the lag.
    """

    @staticmethod
    def get_compensated_latency(model: TeamModel) -> float:
        """See `CompFlc`."""
        return model.latency_frames

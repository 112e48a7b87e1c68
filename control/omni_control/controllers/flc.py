"""The paper's controllers: FLC, and comp-FLC, which compensates the dead time with the alpha of equation 8."""

import math

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.delay_compensation import CommandHistory, predict_displacement
from omni_control.fuzzy import FuzzyLaw
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import Reference

# Commanded displacement at which a new ratio and the old value weigh the same: well above vision's
# error.
CONFIDENCE_M = 0.02
LOWEST_ALPHA, HIGHEST_ALPHA = 0.5, 1.1


class AlphaEstimator:
    """Ratio of the displacement achieved to that commanded, over a sliding window, per robot and axis.

    Equation 8 sums n_0 ratios of single frames and divides by T, whose sum is not in [0.7, 1] but
    n_0 times 60 as large, and divides by zero at rest. The ratio of the window's sums is what it
    can mean:

        alpha = (dx dx_d + rho alpha_old) / (dx_d^2 + rho)

    with dx the displacement seen by vision in the window and dx_d that of the commands which acted
    in it. The regularisation rho keeps the old value at standstill, when neither means anything;
    what is left of an old value shrinks by rho / (dx_d^2 + rho) each frame.

    Args:
        n: robots.
        window_frames: length of the window n_0, frames.
        delay_frames: dead time k_d, frames.
        period: length of a frame T, s.

    Attributes:
        value: as estimated last, (n, 2).
    """

    def __init__(self, n: int, window_frames: int, delay_frames: int, period: float) -> None:
        self.value = np.ones((n, 2))
        self._window, self._delay, self._period = window_frames, delay_frames, period
        self._positions: list[Array] = []

    def update(self, position: Array, sent: CommandHistory) -> Array:
        """Return alpha (n, 2) for x and y, given the filtered positions (n, 2) and the commands sent so far."""
        self._positions.append(position.copy())
        if len(self._positions) > self._window + 1:
            del self._positions[0]
        achieved = position - self._positions[0]
        count = len(self._positions) - 1
        commanded = np.add.reduce(sent.get_latest(count, skip=self._delay)[..., :2]) * self._period
        rho = CONFIDENCE_M**2
        ratio = (achieved * commanded + rho * self.value) / (commanded * commanded + rho)
        self.value = np.minimum(np.maximum(ratio, LOWEST_ALPHA), HIGHEST_ALPHA)
        return self.value


class Flc(Controller):
    """FLC: reference velocity as feed-forward, the fuzzy controller's correction, and a proportional heading hold.

    It compares the pose of now with the reference of now, as if commands acted at once.
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.fuzzy = FuzzyLaw(model.error_range_m, model.speed_range_m_s)

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        return self.track(frame, observation.pose)

    def track(self, frame: float, pose: Array) -> Array:
        """Command (n, 3) that brings robots which are at `pose` (n, 3) in `frame` to the reference of that frame."""
        self.predicted_pose = pose
        target, feed_forward = self.reference.at(frame, pose)
        error = target - pose
        turn = self.model.heading_gain * wrap_angle(error[:, 2:])
        return feed_forward + np.concatenate([self.fuzzy(error[:, :2]), turn], axis=1)


class CompFlc(Flc):
    """comp-FLC: the same, for the pose predicted at the end of the dead time and the reference of that time."""

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.latency = self.latency_told(model)
        window, whole = model.alpha_window_frames, round(self.latency)
        self.memory_frames = window + math.ceil(self.latency)
        self.alpha = AlphaEstimator(n, window, whole, model.period)

    @staticmethod
    def latency_told(model: TeamModel) -> float:
        """Time from a command to its effect that is compensated, frames."""
        return model.delay_frames

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        pose, sent = observation.pose, observation.sent_commands
        self.alpha_hat[:, :2] = self.alpha.update(pose[:, :2], sent)
        count = math.ceil(self.latency)
        in_flight = sent.get_pending_fractions(self.latency, count) * sent.get_latest(count)
        predicted = pose + predict_displacement(in_flight, self.alpha_hat, self.model.period)
        return self.track(frame + self.latency, predicted)


class CompFlcLag(CompFlc):
    """comp-flc-lag: comp-FLC that is told all of the latency, the dead time and the lag of the wheel loops.

    The paper's compensator knows the radio's dead time only; all others here are told the lag too.
    """

    @staticmethod
    def latency_told(model: TeamModel) -> float:
        """See `CompFlc`."""
        return model.latency_frames

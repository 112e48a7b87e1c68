"""The paper's controllers: FLC, and comp-FLC, which compensates the dead time (equation 11)."""

import math
from typing import ClassVar

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.delay_compensation import predict_displacement
from omni_control.estimation.alpha_estimator import AlphaEstimator
from omni_control.fuzzy_rules import FuzzyLaw
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import Reference


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
    """comp-FLC: FLC at the end of the dead time.

    It compares the pose predicted for that time (equation 11) with the reference at that time.
    """

    compensates_lag: ClassVar[bool] = False

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.latency_frames = model.latency_frames if self.compensates_lag else model.delay_frames
        window_frames = model.alpha_window_frames
        self.memory_frames = window_frames + math.ceil(self.latency_frames)
        # A lag is no dead time, so that the latency need not be exact.
        delay_frames = round(self.latency_frames) if self.compensates_lag else model.delay_frames
        self.alpha_estimator = AlphaEstimator(n, window_frames, delay_frames, model.period)

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        pose, sent = observation.pose, observation.sent_commands
        self.alpha_hat[:, :2] = self.alpha_estimator.update(pose[:, :2], sent)
        n_commands = math.ceil(self.latency_frames)
        fractions = sent.get_pending_fractions(self.latency_frames, n_commands)
        in_flight = fractions * sent.get_latest(n_commands)
        predicted_pose = pose + predict_displacement(in_flight, self.alpha_hat, self.model.period)
        return self.track(frame + self.latency_frames, predicted_pose)


class CompFlcLag(CompFlc):
    """comp-flc-lag: comp-FLC that compensates the dead time and the lag of the wheel loops.

    The paper's compensator takes only the dead time of the radio into account. All controllers
    here except `flc` and `comp-flc` also take the lag into account.
    """

    compensates_lag = True

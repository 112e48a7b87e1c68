"""Tracking of robots from camera measurements and commands: outlier gate and Kalman filter.

For each axis the state of the filter is the position x and a drift b, the part of the velocity that
the commands do not explain:

    x(k+1) = x(k) + q(k) + T b(k) + noise of standard deviation DISPLACEMENT_NOISE_RATIO |q(k)|
    b(k+1) = b(k) exp(-T / DRIFT_TIME_S) + noise of variance DRIFT_NOISE_DENSITY^2 T

with the commanded displacement q. How much robots deviate from their commands is not known. The
process noise is therefore scaled until the mean normalized innovation squared (NIS) is 1.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.delay_compensation import CommandHistory
from omni_control.estimation.delayed_measurements import FilterStep, plan_steps
from omni_control.estimation.outlier_gate import OutlierGate
from omni_control.kinematics import Array, compute_pose_error
from omni_control.reference import MotionLimits

# Standard deviation of the displacement in a frame, relative to the commanded displacement.
DISPLACEMENT_NOISE_RATIO = 0.06
DRIFT_NOISE_DENSITY = 0.1, 0.1, 0.5  # of the random walk of the drift, m/s and rad/s per sqrt(s)
DRIFT_TIME_S = 0.5  # time constant with which the drift decays
# Relative change of the noise scale per frame, per unit by which the NIS differs from 1. It is not
# written as 0.03, which differs in the last bit.
SCALE_GAIN = 1 - 0.97
MAX_NIS = 9.0  # 3 sigma; larger values are clipped to this
SCALE_BOUNDS = 0.1, 100.0
MIN_MEASUREMENT_SIGMA = 1e-5, 1e-5, 1e-4  # m and rad, for cameras without noise


class KalmanFilter:
    """Kalman filter for the poses of n robots, with the commanded displacements as inputs.

    Args:
        pose: Initial poses, (n, 3).
        period: Length of a frame, s.
        noise: Standard deviation of measurements, per axis (3,) or per robot and axis (n, 3), m and
            rad.

    Attributes:
        pose: Filtered poses, (n, 3); headings are unwrapped (continuous, not limited to (-pi, pi]).
        drift: Part of the twist that the commands do not explain, (n, 3).
        twist: Filtered twists: commanded twist plus drift, (n, 3).
    """

    def __init__(self, pose: Array, period: float, noise: ArrayLike) -> None:
        self._period = period
        self.change_noise(noise)
        self._drift_decay = math.exp(-period / DRIFT_TIME_S)
        self._drift_noise = np.square(DRIFT_NOISE_DENSITY) * period
        self.pose, (self.drift, self.twist) = pose.copy(), np.zeros((2, *pose.shape))
        # The axes are independent: each has a symmetric 2x2 covariance, stored as three numbers.
        self._pose_variance = np.zeros_like(pose) + self._measurement_variance
        self._cross_covariance, self._drift_variance = np.zeros((2, *pose.shape))
        self._noise_scale = np.ones_like(pose)
        self._innovation, self._innovation_variance = np.full((2, *pose.shape), np.nan)

    def change_noise(self, noise: ArrayLike) -> None:
        """Change the standard deviation of measurements from now on; see the constructor."""
        self._measurement_variance = np.maximum(noise, MIN_MEASUREMENT_SIGMA) ** 2

    @property
    def sigma(self) -> Array:
        """Standard deviation of the pose, (n, 3)."""
        return np.sqrt(self._pose_variance)

    @property
    def normalized_innovation(self) -> Array:
        """Innovations over their standard deviations, (n, 3); NaN without a measurement."""
        return self._innovation / np.sqrt(self._innovation_variance)

    def update(
        self,
        measured_pose: Array,
        displacement: Array,
        step: FilterStep,
        capture_displacement: Array | float = 0.0,
    ) -> Array:
        """Predict poses (n, 3) from commands, correct them by measurements, and return them.

        Args:
            measured_pose: Measured poses, (n, 3); NaN without a measurement, and in every step of a
                frame but the last.
            displacement: Commanded displacement during the step, (n, 3), m and rad.
            step: Robots whose state stays frozen in this step, and the time from the state to the
                capture of their measurement.
            capture_displacement: Commanded displacement from the end of the step to the capture of
                the measurements, (n, 3), m and rad.
        """
        process_noise = self._predict(displacement, step.is_frozen[:, None])
        offset = step.capture_offset[:, None]
        self._correct(measured_pose, offset, capture_displacement, process_noise)
        self.twist = displacement / self._period + self.drift
        return self.pose

    def _predict(self, displacement: Array, is_frozen: NDArray[np.bool_]) -> Array:
        """Advance state and covariance by a frame; return the variance of displacement noise."""
        period, decay = self._period, self._drift_decay
        process_noise = self._noise_scale * (DISPLACEMENT_NOISE_RATIO * displacement) ** 2
        # With the covariance P: P_xx grows by 2 T P_xb + T^2 P_bb = T (P_xb + (P_xb + T P_bb)).
        cross_covariance = self._cross_covariance + period * self._drift_variance
        pose_growth = period * (self._cross_covariance + cross_covariance)
        state = [
            self.pose + period * self.drift + displacement,
            decay * self.drift,
            self._pose_variance + pose_growth + process_noise,
            decay * cross_covariance,
            decay**2 * self._drift_variance + self._noise_scale * self._drift_noise,
        ]
        previous = (
            self.pose,
            self.drift,
            self._pose_variance,
            self._cross_covariance,
            self._drift_variance,
        )
        self.pose, self.drift, self._pose_variance, self._cross_covariance, self._drift_variance = (
            np.where(is_frozen, *values) for values in zip(previous, state, strict=True)
        )
        return process_noise

    def _correct(
        self,
        measured_pose: Array,
        offset: Array,
        capture_displacement: Array | float,
        process_noise: Array,
    ) -> None:
        """Correct state and covariance by measured poses.

        Args:
            measured_pose: Measured poses, (n, 3), NaN without a measurement.
            offset: Time from the state to the capture of the measurements, (n, 1) s.
            capture_displacement: Commanded displacement in that time, (n, 3), m and rad.
            process_noise: Variance of the displacement noise in the last step, (n, 3), also of
                frozen robots.
        """
        # Covariances of pose and drift with the expected measurement x + offset b.
        pose_covariance = self._pose_variance + offset * self._cross_covariance
        drift_covariance = self._cross_covariance + offset * self._drift_variance
        expected_variance = (
            pose_covariance
            + offset * drift_covariance
            + self._measurement_variance
            + np.maximum(offset / self._period, 0.0) * process_noise
        )
        expected = self.pose + capture_displacement + offset * self.drift
        innovation = compute_pose_error(measured_pose, expected)
        self._innovation, self._innovation_variance = innovation, expected_variance
        is_missing = np.isnan(innovation)
        nis = np.where(is_missing, 1.0, innovation**2 / expected_variance)
        innovation = np.where(is_missing, 0.0, innovation)
        pose_gain = np.where(is_missing, 0.0, pose_covariance / expected_variance)
        drift_gain = np.where(is_missing, 0.0, drift_covariance / expected_variance)
        self.pose = self.pose + pose_gain * innovation
        self.drift = self.drift + drift_gain * innovation
        self._pose_variance = self._pose_variance - pose_gain * pose_covariance
        self._drift_variance = self._drift_variance - drift_gain * drift_covariance
        self._cross_covariance = self._cross_covariance - pose_gain * drift_covariance
        growth = np.exp(SCALE_GAIN * (np.minimum(nis, MAX_NIS) - 1))
        scale = np.maximum(self._noise_scale * growth, SCALE_BOUNDS[0])
        self._noise_scale = np.minimum(scale, SCALE_BOUNDS[1])


class VisionTracker:
    """Outlier gate and Kalman filter of n robots, with extrapolation to the present.

    Args:
        pose: Initial poses, (n, 3).
        noise: Standard deviation of measurements, (n, 3), m and rad.
        latency: Dead time plus lag of the robots, (n, 1) frames.
        period: Length of a frame, s.
        limits: Command limits of each robot.

    Attributes:
        filter: Kalman filter; with late measurements its state lies in the past.
        memory_frames: Number of sent commands that a frame without late measurements needs.
        pose, twist: Estimated present poses and twists, (n, 3).
        steps: Steps of the filter in this frame.
    """

    def __init__(
        self,
        pose: Array,
        noise: Array,
        latency: Array,
        period: float,
        limits: Sequence[MotionLimits],
    ) -> None:
        self.filter = KalmanFilter(pose, period, noise)
        self._gate = OutlierGate(noise, limits, period)
        self._period = period
        self.change_model(noise, latency, limits)
        self._default_step = FilterStep.to_present(len(latency))
        self.pose, self.twist = self.filter.pose, self.filter.twist
        self.steps: tuple[FilterStep, ...] = (self._default_step,)

    def change_model(self, noise: Array, latency: Array, limits: Sequence[MotionLimits]) -> None:
        """Change noise, latencies and limits from now on; see the constructor."""
        self.filter.change_noise(noise)
        self._gate.change_margins(noise, limits)
        self._latency = latency
        self.memory_frames = math.ceil(latency.max()) + 1

    @property
    def is_reversed(self) -> NDArray[np.bool_]:
        """Robots whose heading stays reversed in the measurements, (n,)."""
        return self._gate.is_reversed

    def update(self, measured_pose: Array, age: Array, sent: CommandHistory) -> Array:
        """Update the estimates by measurements, and return the accepted measurements.

        Args:
            measured_pose: Poses measured by vision, (n, 3), NaN without a measurement.
            age: Time from the capture of each measurement to this frame, (n,) s.
            sent: Commands up to the previous frame, at least `memory_frames` plus
                `MAX_FRAMES_BEHIND` of them.

        Returns:
            Measured poses that passed the outlier gate, (n, 3), NaN for all others.
        """
        displacement = sent.get_delayed(self._latency) * self._period
        accepted = self._gate.reject_outliers(measured_pose, age, displacement)
        if np.count_nonzero(age) or np.count_nonzero(self.steps[-1].frames_behind):
            self._update_delayed(accepted, age, sent)
        else:
            self.pose = self.filter.update(accepted, displacement, self._default_step)
            self.twist, self.steps = self.filter.twist, (self._default_step,)
        return accepted

    def _update_delayed(self, accepted: Array, age: Array, sent: CommandHistory) -> None:
        """Process a frame with late measurements, or with a filter whose state lies in the past."""
        latency, period = self._latency, self._period
        is_visible = ~np.isnan(accepted[:, 0])
        self.steps = plan_steps(self.steps[-1].frames_behind, age, is_visible, period)
        for step in self.steps:
            frames_behind, offset = step.frames_behind[:, None], step.capture_offset[:, None]
            displacement = sent.get_delayed(latency + frames_behind) * period
            next_command = sent.get_delayed(latency + np.maximum(frames_behind - 1, 0.0))
            # Not simplified, so that results stay the same to the last bit.
            capture_displacement = offset / period * next_command * period
            measured = accepted if step is self.steps[-1] else np.full_like(accepted, np.nan)
            self.filter.update(measured, displacement, step, capture_displacement)
        # From the state of the filter to the present: the fractions of a frame in which each
        # command acts between them.
        frames_behind, drift = self.steps[-1].frames_behind[:, None], self.filter.drift
        fractions = sent.get_pending_fractions(
            latency + frames_behind
        ) - sent.get_pending_fractions(latency)
        commanded = (fractions * sent.get_latest(sent.length)).sum(0)
        self.pose = self.filter.pose + (commanded + frames_behind * drift) * period
        self.twist = sent.get_delayed(latency) + drift

"""LQR tracking of a recorded run: its commands plus feedback on the estimated deviation.

A Kalman filter on `DeviationModel` estimates how each robot deviates from its run. It also
estimates the error c of the firmware's heading and the remaining bias b of its gyro. Both follow
`omni_mj.robot.firmware`, with its heading gain g and bias gain h:

    c(k+1) = c(k) + T b(k) + T g e(k),    b(k+1) = b(k) + T h e(k),

where e(k) is the received heading minus the firmware's heading at the time it was sent. The effects
of c and b equal a change of the command: a rotation by -c, and the turn rate -b / (1 + turn gain).
The kinematic plant scales commands by an unknown gain, which equals a change of the command too. A
linear quadratic regulator acts on the deviation predicted for the end of the dead time, which is
optimal for a robot with dead time (D. L. Kleinman, IEEE Trans. Automatic Control 14, 1969).
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from omni_control.controllers.base import Observation
from omni_control.kinematics import Array, compute_pose_error, wrap_angle
from omni_mj.config import PERIOD_S
from omni_mj.config.faults import WHEELED_PLANTS
from omni_mj.config.scenario import Scenario
from omni_mj.studies.limit.deviation_model import SCALE, DeviationModel

# Indices of the state: deviations of pose and velocity, slowly changing velocity disturbance,
# heading error c, gyro bias b, and relative error of the kinematic plant's speeds.
POSE, VELOCITY, DRIFT = slice(0, 3), slice(3, 6), slice(6, 9)
HEADING_OFFSET, BIAS, SPEED_ERROR = 9, 10, slice(11, 14)
N_STATES = 14
# States whose process noise is tuned by `FeedbackSettings.noise_factor`.
IS_TUNED = np.array([1, 1, 0, 1, 1, 0, 1, 1, 0, 0, 0, 1, 1, 1], bool)
DRIFT_DECAY = np.exp(-1 / 30.0)  # per frame
MIN_NOISE = 2e-6  # m or rad, of the measured pose; keeps its covariance invertible
# Standard deviations per frame of model errors: velocity and drift in m/s and rad/s, heading error
# in rad. Of all values tried, they predict the poses of tigers-v2016 on `rect` best.
MODEL_ERROR = np.array([0, 0, 0, 5e-4, 5e-4, 2e-3, 2e-5, 2e-5, 4e-5, 2.5e-4, 0, 0, 0, 0])
# Fixed-point iterations for the command whose disturbed effect is the desired one. The disturbance
# is at most 0.2 of the command, so the remaining error is negligible.
INVERSION_ITERATIONS = 5


class FeedbackSettings(NamedTuple):
    """Settings of filter and regulator.

    Attributes:
        weight: Weight of commands relative to deviations in the regulator, s^2. Its square root is
            about the time constant of the feedback.
        noise_factor: Factor on the standard deviations of the filter's process noise, for the
            states in `IS_TUNED`.
    """

    weight: float
    noise_factor: float = 1.0


class RunTracker:
    """Tracker that keeps n robots near n recorded runs; it is called once per frame.

    Args:
        model: Deviation model of all runs.
        commands: Sent commands of the runs, (F, n, 3), or (F, 1, 3) for one run of all robots.
        poses: Poses of the runs, same shape.
        scenario: Scenario whose noise, plant and firmware are known to the tracker.
        feedback: Settings of each robot.
    """

    def __init__(
        self,
        model: DeviationModel,
        commands: Array,
        poses: Array,
        scenario: Scenario,
        feedback: Sequence[FeedbackSettings],
    ) -> None:
        n, settings = len(feedback), scenario.settings
        has_firmware = scenario.plant in WHEELED_PLANTS
        # Commands are stored with `_offset` frames in front, so that delayed ones always exist.
        self._delay, self._offset = model.delay, model.delay + 1
        padding = [(0, model.delay), (0, 0), (0, 0)]
        self._velocity_matrix = np.pad(model.velocity, padding, "edge")
        self._command_matrix = np.pad(model.command, [(0, 0), *padding], "edge")
        self._command_per_velocity = np.linalg.pinv(self._command_matrix.sum(0))
        self._commands = np.pad(commands, [(self._offset, 0), (0, 0), (0, 0)])
        self._poses = poses
        self._sent = np.zeros((self._offset + model.frames, n, 3))
        # Sent heading minus the filter's heading, in each frame.
        self._headings = np.zeros((model.frames, n))
        self._frame = -1
        firmware = settings.firmware
        self._heading_gain = has_firmware * PERIOD_S * firmware.heading_gain
        self._bias_gain = has_firmware * PERIOD_S * firmware.gyro_bias_gain
        self._bias_effect = has_firmware / (1 + firmware.turn_rate_gain)
        vision = settings.vision
        vision_noise = [vision.position_noise_m, vision.position_noise_m, vision.heading_noise_rad]
        self._vision_covariance = np.diag(np.maximum(vision_noise, MIN_NOISE) ** 2)
        noise, speed_error_sigma, self._speed_error_decay = _process_noise(scenario)
        self._noise = np.array(
            [np.where(IS_TUNED, robot.noise_factor, 1.0) * noise for robot in feedback]
        )
        gains = [
            np.pad(regulator_gains(model, robot.weight), padding, "edge") for robot in feedback
        ]
        self._gains = np.stack(gains, axis=1)
        self._state = np.zeros((n, N_STATES))
        self._covariance = np.zeros((n, N_STATES, N_STATES))
        self._covariance[:, BIAS, BIAS] = has_firmware * settings.sensors.gyro_bias_rad_s**2
        self._covariance[:, SPEED_ERROR, SPEED_ERROR] = speed_error_sigma**2 * np.eye(3)

    def __call__(self, observation: Observation) -> Array:
        """Return the commands to send in this frame, before the limits, (n, 3)."""
        predicted = self.predict(
            observation.extrapolated_pose,
            observation.pose[:, 2],
            observation.sent_commands.get_latest(1)[0],
        )
        effective_frame, now = self._frame + self._delay, self._frame + self._offset
        last_sent = self._sent[now - 1]
        last_change = last_sent - self._commands[now - 1]
        last_effect = last_change + self._disturbance(predicted, last_sent, effective_frame)
        state = np.concatenate([predicted[:, POSE], predicted[:, VELOCITY], last_effect], axis=1)
        feedback = (self._gains[effective_frame] * state[:, None]).sum(-1)
        desired = command = self._commands[now] - feedback
        for _ in range(INVERSION_ITERATIONS):
            command = desired - self._disturbance(predicted, command, effective_frame)
        return command

    def predict(self, measured: Array, heading: Array, last_command: Array) -> Array:
        """Advance the filter by a frame, and predict the states at the end of the dead time.

        It must be called once per frame.

        Args:
            measured: Poses reported by vision, (n, 3); NaN without a detection.
            heading: Headings that are sent together with the commands, (n,) rad.
            last_command: Commands sent in the previous frame, after the limits, (n, 3).

        Returns:
            Predicted states, (n, N_STATES).
        """
        if self._frame >= 0:
            self._sent[self._frame + self._offset] = last_command
            self._advance_filter()
        self._frame += 1
        pose = self._poses[self._frame]
        self._correct(measured - pose)
        self._headings[self._frame] = wrap_angle(heading - pose[:, 2] - self._state[:, 2])
        predicted = self._state
        for frame in range(self._frame, self._frame + self._delay):
            predicted = self._next_state(predicted, frame)
        return predicted

    def _advance_filter(self) -> None:
        """Advance states and covariances by a frame.

        `_next_state` is affine in the state. So the columns of its Jacobian are differences between
        its values for unit vectors and for zero.
        """
        states = np.zeros((1 + N_STATES, *self._state.shape))
        states[1:] = np.eye(N_STATES)[:, None]
        images = self._next_state(states, self._frame)
        jacobian = (images[1:] - images[0]).transpose(1, 2, 0)
        self._state = self._next_state(self._state, self._frame)
        noise_input = np.eye(N_STATES)
        noise_input[POSE, VELOCITY] = PERIOD_S * np.eye(3)
        noise = noise_input * self._noise[:, None] ** 2 @ noise_input.T
        self._covariance = jacobian @ self._covariance @ jacobian.swapaxes(1, 2) + noise

    def _next_state(self, state: Array, frame: int) -> Array:
        """Return the states (..., n, N_STATES) one frame later, from those of a frame."""
        velocity = state[..., VELOCITY] @ self._velocity_matrix[frame].T + state[..., DRIFT]
        for age, matrix in enumerate(self._command_matrix[:, frame]):
            # Age 0: the command sent one dead time ago. Age 1: the one before. The stored commands
            # begin one dead time and one frame before the run.
            command = self._sent[frame - age + 1]
            change = (
                command - self._commands[frame - age + 1] + self._firmware_error(state, command)
            )
            velocity = velocity + change @ matrix.T
        next_state = state.copy()
        next_state[..., VELOCITY] = velocity
        next_state[..., POSE] += PERIOD_S * velocity
        next_state[..., DRIFT] *= DRIFT_DECAY
        next_state[..., SPEED_ERROR] *= self._speed_error_decay
        bias = state[..., BIAS]
        next_state[..., HEADING_OFFSET] += PERIOD_S * bias
        if frame >= self._delay:
            # e(k), with the heading error a dead time ago: c(k-D) = c(k) - D T b(k)
            sent = self._headings[frame - self._delay]
            error = sent - state[..., HEADING_OFFSET] + self._delay * PERIOD_S * bias
            next_state[..., HEADING_OFFSET] += self._heading_gain * error
            next_state[..., BIAS] += self._bias_gain * error
        return next_state

    def _firmware_error(self, state: Array, command: Array) -> Array:
        """Return the command change (..., n, 3) with the effect of heading error, bias and gain."""
        offset, bias = state[..., HEADING_OFFSET], state[..., BIAS]
        # Rotation by -c, for a small c
        change = offset * command[:, 1], -offset * command[:, 0], -self._bias_effect * bias
        return np.stack(change, axis=-1) + state[..., SPEED_ERROR] * command

    def _disturbance(self, state: Array, command: Array, frame: int) -> Array:
        """Return the command change (n, 3) with the effect of all disturbances in a frame."""
        return (
            self._firmware_error(state, command)
            + state[:, DRIFT] @ self._command_per_velocity[frame].T
        )

    def _correct(self, deviation: Array) -> None:
        """Correct states and covariances with measured deviations (n, 3) from the runs' poses."""
        innovation = compute_pose_error(deviation, self._state[:, POSE])
        is_visible = ~np.isnan(innovation[:, 0])
        innovation_covariance = self._covariance[:, POSE, POSE] + self._vision_covariance
        kalman_gain = (
            np.linalg.solve(innovation_covariance, self._covariance[:, POSE]).swapaxes(1, 2)
            * is_visible[:, None, None]
        )
        self._state = self._state + (kalman_gain @ np.nan_to_num(innovation)[..., None])[..., 0]
        covariance = self._covariance - kalman_gain @ self._covariance[:, POSE]
        self._covariance = (covariance + covariance.swapaxes(1, 2)) / 2


def _process_noise(scenario: Scenario) -> tuple[Array, float, float]:
    """Return the process noise of the filter for a scenario's plant and settings.

    Returns:
        Standard deviation of each state per frame, (N_STATES,); and of the kinematic plant's
        relative error of speeds, the standard deviation and the decay per frame.
    """
    settings, deviations = scenario.settings, np.zeros(N_STATES)
    if scenario.plant in WHEELED_PLANTS:
        gyro, disturbance = settings.sensors.gyro_noise_rad_s, settings.disturbance
        deviations[VELOCITY] = disturbance.force_n / settings.body.mass_kg * PERIOD_S / 3**0.5
        deviations[5] = gyro / (1 + settings.firmware.turn_rate_gain)
        deviations[HEADING_OFFSET] = PERIOD_S * gyro
        return np.hypot(deviations, MODEL_ERROR), 0.0, 1.0
    kinematic = settings.kinematic
    deviations[VELOCITY] = 1e-9 + settings.disturbance.velocity_m_s / 3**0.5
    deviations[DRIFT] = 1e-9
    # Standard deviations of uniform distributions, here and for the disturbance: width / sqrt(12).
    speed_error_sigma = (
        (kinematic.alpha_high - kinematic.alpha_low)
        / (kinematic.alpha_high + kinematic.alpha_low)
        / 3**0.5
    )
    decay = (
        float(np.exp(-PERIOD_S / kinematic.alpha_correlation_time_s))
        if kinematic.alpha_correlation_time_s
        else 0.0
    )
    deviations[SPEED_ERROR] = speed_error_sigma * (1 - decay**2) ** 0.5
    return deviations, speed_error_sigma, decay


@lru_cache(maxsize=8)  # robots share weights
def regulator_gains(model: DeviationModel, weight: float) -> Array:
    """Compute the gains of the time-varying linear quadratic regulator.

    They minimize the sum over frames of |dp|^2 + weight |du|^2, with angles scaled to lengths by
    `SCALE`. The Riccati recursion runs backward from the last frame.

    Args:
        model: Deviation model, with F frames.
        weight: Weight of commands, s^2.

    Returns:
        K (F, 3, 9) of du = -K [dp, dv, du of the frame before], by the frame in which du takes
        effect. Here dp and dv are the deviations in that frame.
    """
    state_cost, command_cost = np.zeros((9, 9)), weight * np.diag(SCALE**2)
    state_cost[POSE, POSE] = np.diag(SCALE**2)
    gains, cost = np.zeros((model.frames, 3, 9)), state_cost
    for k in reversed(range(model.frames)):
        transition, effect = np.zeros((9, 9)), np.zeros((9, 3))
        transition[VELOCITY, VELOCITY] = model.velocity[k]
        transition[VELOCITY, 6:] = model.command[1, k]
        transition[POSE] = PERIOD_S * transition[VELOCITY]
        transition[POSE, POSE] += np.eye(3)
        effect[VELOCITY], effect[6:] = model.command[0, k], np.eye(3)
        effect[POSE] = PERIOD_S * effect[VELOCITY]
        command_hessian = command_cost + effect.T @ cost @ effect
        gains[k] = np.linalg.solve(command_hessian, effect.T @ cost @ transition)
        cost = state_cost + transition.T @ cost @ (transition - effect @ gains[k])
    return gains

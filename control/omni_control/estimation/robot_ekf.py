"""Extended Kalman filter for the state and the parameters of robots.

The filter estimates pose, velocity, disturbance, and the parameters of `MotionModel`: couplings,
inverse gains (1 / alpha), dead time, creep, lag, and friction. Its inputs are vision measurements
and sent commands.
"""

import math

import numpy as np
from numpy.typing import NDArray

from omni_control.command_limiter import CommandLimiter
from omni_control.controllers.base import Observation, TeamModel
from omni_control.delay_compensation import CommandHistory
from omni_control.errors import OmniError
from omni_control.estimation.dead_time_search import DeadTimeSearch
from omni_control.estimation.delayed_measurements import FilterStep
from omni_control.estimation.motion_model import (
    CREEP,
    DEAD_TIME,
    FORWARD_INVERSE_GAIN,
    INVERSE_GAIN,
    MIN_LAG_S,
    POSE,
    SIDEWAYS_INVERSE_GAIN,
    STATE_SIZE,
    TURN_RATE,
    VELOCITY,
    MotionModel,
)
from omni_control.kinematics import Array, wrap_angle

# Groups of states.
MOTION = slice(0, 6)  # pose and velocity
# States before this index are estimated, the others are held.
LEARNED_STATES = {"nothing": 6, "disturbance": 9, "all": STATE_SIZE}
UNMEASURED = slice(6, STATE_SIZE)
PARAMETERS = slice(9, STATE_SIZE)
TRANSLATION_VELOCITY, TRANSLATION_GAINS = slice(3, 5), slice(11, 13)
RESPONSE_PARAMETERS = slice(11, STATE_SIZE)  # inverse gains, dead time, creep, lag, friction
# The same without the inverse gain of turning.
TRANSLATION_PARAMETERS = [
    FORWARD_INVERSE_GAIN,
    SIDEWAYS_INVERSE_GAIN,
    *range(DEAD_TIME, STATE_SIZE),
]

# Prior standard deviations.
# Inverse gains; then creep, lag and friction relative to their nominal values. Known and unknown:
# whether the nominal model contains alpha.
KNOWN_SIGMA, UNKNOWN_SIGMA = (0.07, 0.2, 0.35, 0.3), (0.12, 0.35, 0.5, 0.4)
ZERO_SIGMA = 0.04, 0.01, 0.02  # creep, lag and friction with nominal value 0, s^2/m, s, m/s
YAW_GAIN_SIGMA = 0.05
GAIN_CORRELATION = 0.5  # between the inverse gains forward and sideways
DEAD_TIME_SIGMA = 1.2  # frames
COUPLING_SIGMA = 0.1  # rad/m
DISTURBANCE_SIGMA = 0.02, 0.02, 0.05  # m/s and rad/s

# Time constants with which estimates return to the prior, s.
DISTURBANCE_TIME_S, PARAMETER_TIME_S = (0.5, 0.5, 1.0), 12.0
# Bounds of couplings (rad/m), inverse gains, dead time (frames), creep (s^2/m), lag (s), and
# friction (m/s). Those of the dead time are replaced: see MIN_DEAD_TIME_CHANGE.
MIN_DEAD_TIME_CHANGE, MAX_DEAD_TIME_CHANGE = -10, 10  # from the nominal dead time, frames
LOWER_BOUNDS = -1, -1, 0.8, 0.8, 0.8, 0, 0, MIN_LAG_S, 0
UPPER_BOUNDS = 1, 1, 1.9, 1.9, 1.9, np.inf, 0.2, 0.1, 0.15

# Process noise: standard deviation of the unmodeled acceleration.
ACCELERATION_M_S2, TURN_ACCELERATION_RAD_S2 = 0.35, 1.5
ACCELERATION_RATIO = 0.3  # additional part, relative to the modeled acceleration
MAX_NOISE_SCALE = 30.0  # the process noise grows with the mean NIS up to this factor
NIS_FRAMES = 10  # time constant of the mean NIS, frames
RELOCATION_NIS = 50.0  # NIS above which the robot may have been carried
TRUSTED_NIS = 1.5  # mean NIS up to which parameters are learned at the full rate
EVIDENT_SPEED_M_S = 0.1  # below it, dry friction may hold a robot and hide its parameters
STEADY_ACCELERATION_M_S2 = 2.0  # above it, wheels may slide and hide the gains
MAX_BRAKING_M_S2 = 9.81  # deceleration by friction with a coefficient of 1
# A robot is unresponsive if its velocity, averaged over RESPONSE_FRAMES, stays below a fraction
# MIN_RESPONSE of its commands for SILENT_FRAMES.
RESPONSE_FRAMES, MIN_RESPONSE, SILENT_FRAMES = 8, 0.4, 5
JACOBIAN_STEP = 1e-5  # perturbation of a state for finite differences, in its unit


class RobotEkf:
    """Extended Kalman filter for n robots.

    Args:
        model: Nominal model.
        n: Number of robots.
        noise: Standard deviations of measured x, y and heading, m, m, rad.
        learns: What is estimated besides pose and velocity, of `LEARNED_STATES`. The others stay at
            their nominal values.

    Attributes:
        dynamics: Motion model.
        state: States (n, 18) with the layout of the constants in `motion_model`.
        covariance: Covariances of the states, (n, 18, 18).
        mean_nis: Running mean of the normalized innovation squared (NIS), (n,); 1 for a robot that
            follows the model.
        memory_frames: Number of sent commands that the filter needs.

    Raises:
        OmniError: `learns` is none of `LEARNED_STATES`.
    """

    def __init__(
        self, model: TeamModel, n: int, noise: tuple[float, float, float], learns: str = "all"
    ) -> None:
        self.period, self.dynamics = model.period, MotionModel(model)
        prior = self.dynamics.prior[PARAMETERS]
        lower_bounds = np.minimum(LOWER_BOUNDS, prior)
        upper_bounds = np.maximum(UPPER_BOUNDS, prior)
        dead_time = DEAD_TIME - PARAMETERS.start
        lower_bounds[dead_time] = max(model.delay_frames + MIN_DEAD_TIME_CHANGE, 0)
        upper_bounds[dead_time] = model.delay_frames + MAX_DEAD_TIME_CHANGE
        self._bounds = lower_bounds, upper_bounds
        times = np.array([*DISTURBANCE_TIME_S, *9 * [PARAMETER_TIME_S]])
        self._decay = np.append(np.ones(6), np.exp(-self.period / times))
        if learns not in LEARNED_STATES:
            raise OmniError(f"learns must be one of {', '.join(LEARNED_STATES)}, got {learns!r}")
        is_learned = np.arange(STATE_SIZE) < LEARNED_STATES[learns]
        covariance = self._make_prior_covariance(model) * np.outer(is_learned, is_learned)
        # Noise that keeps the prior covariance stationary under the decay: (1 - decay^2) P.
        noise_ratio = np.sqrt(1 - self._decay**2)
        self._parameter_noise = covariance * np.outer(noise_ratio, noise_ratio)
        self._vision_covariance = np.diag(np.maximum(noise, [1e-4, 1e-4, 1e-3])) ** 2
        covariance[POSE, POSE] = self._vision_covariance
        self._prior_covariance = covariance
        self._prior = np.tile(self.dynamics.prior, (n, 1))
        self.state = self._prior.copy()
        self.covariance = np.tile(covariance, (n, 1, 1))
        sigma = np.sqrt(np.diagonal(self._vision_covariance))
        self._limiter = CommandLimiter([model.limits], self.period)
        self._search = DeadTimeSearch(model, self.dynamics, sigma, n)
        self._search.is_active &= is_learned[DEAD_TIME]
        step = JACOBIAN_STEP * np.eye(STATE_SIZE)
        self._perturbations = np.concatenate([0 * step[:1], step, -step])[:, None]
        self.memory_frames = math.ceil(model.delay_frames) + MAX_DEAD_TIME_CHANGE + 8
        self.mean_nis = np.ones(n)
        # Running means of the squared command, and of the command times the velocity, (2, n).
        self._mean_powers = np.zeros((2, n))
        self._silent_frames = np.zeros(n)  # frames without a response
        self._started = False

    def _make_prior_covariance(self, model: TeamModel) -> Array:
        """Return the prior covariance (18, 18); only disturbances and parameters are set."""
        correlation = np.eye(STATE_SIZE)
        forward_sideways = [FORWARD_INVERSE_GAIN, SIDEWAYS_INVERSE_GAIN]
        correlation[forward_sideways, forward_sideways[::-1]] = GAIN_CORRELATION
        gain_sigma, *relative = KNOWN_SIGMA if model.alpha else UNKNOWN_SIGMA
        is_unknown = np.equal([model.creep_s2_m, model.lag_s, model.friction_loss_m_s], 0)
        sigma = np.zeros(STATE_SIZE)
        sigma[UNMEASURED] = [
            *DISTURBANCE_SIGMA,
            *2 * [COUPLING_SIGMA],
            *2 * [gain_sigma],
            YAW_GAIN_SIGMA,
            DEAD_TIME_SIGMA,
            *np.where(is_unknown, ZERO_SIGMA, relative * self.dynamics.prior[CREEP:]),
        ]
        return correlation * np.outer(sigma, sigma)

    @property
    def dead_time(self) -> Array:
        """Time from sending a command to its first effect, (n,) frames."""
        return self.state[:, DEAD_TIME]

    @property
    def is_responsive(self) -> NDArray[np.bool_]:
        """Whether the robots respond to their commands, (n,)."""
        return self._silent_frames < SILENT_FRAMES

    def update(self, observation: Observation) -> None:
        """Predict over the filter steps of a frame, then correct the states by its measurements."""
        if not self._started:
            self._started = True
            self.state[:, POSE] = observation.pose
            self._search.start(observation.pose)
        for step in observation.filter_steps or (FilterStep.to_present(len(self.state)),):
            command = self._advance(observation.sent_commands, step)
        self._frames_behind = step.frames_behind
        offset = step.capture_offset[:, None]
        self._correct(observation.measured_pose, offset, command)
        if np.count_nonzero(self._search.is_active):
            self._search_dead_time(observation.measured_pose, offset)

    def _search_dead_time(self, measured_pose: Array, offset: Array) -> None:
        """Replace states whose dead time does not explain the motion, and forget their past.

        Args:
            measured_pose: Measured poses (n, 3), NaN without a measurement.
            offset: Time from the state to the capture, (n, 1) s.
        """
        speed = np.abs(self.state[:, VELOCITY] * [1, 1, self.dynamics.arm]).max(1)
        self._search.correct(measured_pose, offset, np.minimum(speed / EVIDENT_SPEED_M_S, 1))
        robots, states = self._search.find(self.dead_time)
        self.state[robots], self.covariance[robots] = states, self._prior_covariance
        self._prior[robots, DEAD_TIME] = states[:, DEAD_TIME]
        self.mean_nis[robots] = 1.0

    def predict(self, observation: Observation) -> Array:
        """Return the states (n, 18) predicted for the end of the dead time."""
        dead_time, sent = self.dead_time + self._frames_behind, observation.sent_commands
        count = int(np.ceil(dead_time.max()))
        state = self.state
        fractions = sent.get_pending_fractions(dead_time[:, None], count)[..., 0]
        for command, fraction in zip(sent.get_latest(count), fractions, strict=True):
            next_state = self.dynamics.step(state, command, fraction * self.period)
            state = np.where(fraction[:, None] > 0, next_state, state)
        return state

    def _advance(self, sent: CommandHistory, step: FilterStep) -> Array:
        """Predict states and covariances over a step; return the commands (n, 3) in effect."""
        if np.count_nonzero(self._search.is_active):
            self._search.advance(sent, step)
        command, next_state, transition = self._linearize(sent, step.frames_behind)
        speed_change = np.hypot(*(next_state - self.state)[:, TRANSLATION_VELOCITY].T)
        dead_time = (self.dead_time + step.frames_behind)[:, None]
        is_limited = self._limiter.is_active(command, sent.get_delayed(dead_time + 1))
        self._limit_learning(transition, speed_change, is_limited)
        transition *= self._decay[:, None]
        predicted = self._decay * next_state + (1 - self._decay) * self._prior
        covariance = transition @ self.covariance @ transition.swapaxes(1, 2)
        # An unresponsive robot teaches nothing about disturbances and parameters.
        is_responsive = self.is_responsive[:, None, None]
        covariance[:, MOTION, UNMEASURED] *= is_responsive
        covariance[:, UNMEASURED, MOTION] *= is_responsive
        self._add_process_noise(covariance, speed_change)
        self.state = np.where(step.is_frozen[:, None], self.state, predicted)
        self.covariance = np.where(step.is_frozen[:, None, None], self.covariance, covariance)
        return command

    def _linearize(self, sent: CommandHistory, frames_behind: Array) -> tuple[Array, Array, Array]:
        """Linearize a step that ends `frames_behind` (n,) frames before the present.

        Returns:
            Commands that act in the step, (n, 3); states after it, (n, 18); and Jacobians of these
            by the states before it, (n, 18, 18).
        """
        dead_time = (self.dead_time + frames_behind)[:, None]
        dead_times = np.maximum(dead_time + np.array([0, -1, 1])[:, None, None], 0)
        command, newer, older = sent.get_delayed(dead_times)
        # Derivative of the acting command by the dead time, for the Jacobian.
        command_slope = (older - newer) / (dead_times[2] - dead_times[1])
        commands = command + self._perturbations[..., DEAD_TIME, None] * command_slope
        next_states = self.dynamics.step(self.state + self._perturbations, commands, self.period)
        plus, minus = next_states[1 : STATE_SIZE + 1], next_states[STATE_SIZE + 1 :]
        jacobian = np.moveaxis((plus - minus) / (2 * JACOBIAN_STEP), 0, -1)
        return command, next_states[0], jacobian

    def _limit_learning(
        self, transition: Array, speed_change: Array, is_limited: NDArray[np.bool_]
    ) -> None:
        """Reduce in place the effect of parameters on motion, and with it the rate of learning.

        - While innovations are large, parameters are learned more slowly: the inverse gain of
          turning by the factor TRUSTED_NIS / mean NIS, all others by its square.
        - All parameters but the inverse gain of turning are also learned more slowly from an axis
          that moves slowly, because dry friction may hold it.
        - The inverse gains of translation are learned more slowly while the robot accelerates hard,
          because wheels may slide.
        - No inverse gain is learned while a limit of commands acts: the robot then follows the
          limit, and what it lacks looks like a weak gain.

        Args:
            transition: Jacobians (n, 18, 18) of a step.
            speed_change: Change of the velocity in this step, (n,) m/s.
            is_limited: Whether the acting command is at a limit: x, y and turning, (n, 3).
        """
        speed = np.hypot(*self.state[:, TRANSLATION_VELOCITY].T)
        turn_speed = self.dynamics.arm * np.abs(self.state[:, TURN_RATE])
        axis_speeds = np.stack(2 * [speed, speed, turn_speed], 1)
        speed_weight = np.minimum(axis_speeds / EVIDENT_SPEED_M_S, 1) ** 2
        trust = np.minimum(TRUSTED_NIS / self.mean_nis, 1)[:, None, None]
        steady_change = STEADY_ACCELERATION_M_S2 * self.period
        unsteadiness = 1 + (speed_change[:, None, None] / steady_change) ** 2
        transition[:, MOTION, RESPONSE_PARAMETERS] *= trust
        transition[:, MOTION, TRANSLATION_PARAMETERS] *= speed_weight[..., None] * trust
        transition[:, MOTION, TRANSLATION_GAINS] /= unsteadiness
        transition[:, MOTION, INVERSE_GAIN] *= ~is_limited[:, None]

    def _add_process_noise(self, covariance: Array, speed_change: Array) -> None:
        """Add the process noise of a step to covariances (n, 18, 18) in place.

        Args:
            covariance: Predicted covariances (n, 18, 18).
            speed_change: Change of the velocity in this step, (n,) m/s.
        """
        scale = np.clip(self.mean_nis, 1, MAX_NOISE_SCALE)
        variance = (ACCELERATION_M_S2 * self.period) ** 2 + (ACCELERATION_RATIO * speed_change) ** 2
        covariance[:, [3, 4], [3, 4]] += (scale * variance)[:, None]
        turn_variance = (TURN_ACCELERATION_RAD_S2 * self.period) ** 2
        covariance[:, TURN_RATE, TURN_RATE] += scale * turn_variance
        covariance += self._parameter_noise

    def _correct(self, measured_pose: Array, offset: Array, command: Array) -> None:
        """Correct the states by measured poses.

        Args:
            measured_pose: Measured poses (n, 3), NaN without a measurement.
            offset: Time from the state to the capture, (n, 1) s.
            command: Commands that acted in the last step, (n, 3).
        """
        state, covariance = self.state, self.covariance
        innovation = measured_pose - state[:, POSE] - offset * state[:, VELOCITY]
        innovation[:, 2] = wrap_angle(innovation[:, 2])
        is_visible = ~np.isnan(innovation[:, 0])
        innovation[~is_visible] = 0.0
        offset = offset[..., None]
        cross_covariance = covariance[:, :, POSE] + offset * covariance[:, :, VELOCITY]
        pose_covariance = cross_covariance[:, POSE] + offset * cross_covariance[:, VELOCITY]
        inverse = np.linalg.inv(pose_covariance + self._vision_covariance)
        nis = (innovation * (inverse @ innovation[..., None])[..., 0]).sum(1) / 3
        kalman_gain = cross_covariance @ inverse * is_visible[:, None, None]
        corrected = state + (kalman_gain @ innovation[..., None])[..., 0]
        corrected_covariance = covariance - kalman_gain @ cross_covariance.swapaxes(1, 2)
        distance = np.hypot(innovation[:, 0], innovation[:, 1])
        is_relocated = (nis > RELOCATION_NIS) & (distance > MAX_BRAKING_M_S2 * self.period**2)
        for i in np.flatnonzero(is_relocated):
            # No motion of the robot explains this: it was carried, or the camera was moved.
            corrected[i], corrected_covariance[i] = state[i], covariance[i]
            corrected[i, :2] += innovation[i, :2]
            corrected_covariance[i, :2], corrected_covariance[i, :, :2] = 0.0, 0.0
            corrected_covariance[i, :2, :2] = self._vision_covariance[:2, :2]
            corrected_covariance[i, [3, 4], [3, 4]] += (distance[i] / self.period) ** 2
        corrected[:, PARAMETERS] = np.clip(corrected[:, PARAMETERS], *self._bounds)
        self.state = corrected
        self.covariance = (corrected_covariance + corrected_covariance.swapaxes(1, 2)) / 2
        change = (np.minimum(nis, RELOCATION_NIS) - self.mean_nis) / NIS_FRAMES
        self.mean_nis = self.mean_nis + is_visible * change
        self._count_silent_frames(command)

    def _count_silent_frames(self, command: Array) -> None:
        """Count successive frames in which robots do not respond to their commands (n, 3)."""
        rim_scale = np.array([1.0, 1.0, self.dynamics.arm])
        commanded, velocity = command * rim_scale, self.state[:, VELOCITY] * rim_scale
        powers = (commanded * np.array([commanded, velocity])).sum(2)
        self._mean_powers += (powers - self._mean_powers) / RESPONSE_FRAMES
        command_power, response_power = self._mean_powers
        is_silent = response_power < MIN_RESPONSE * command_power
        is_silent &= command_power > EVIDENT_SPEED_M_S**2
        self._silent_frames = (self._silent_frames + 1) * is_silent

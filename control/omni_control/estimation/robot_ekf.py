"""An extended Kalman filter that finds where robots are and how they answer to commands.

Per axis i of the body (forward, to the left, turning), with u the command that acts and v the velocity:

    (tau_i + g_i^2 T_i s) v'_i = u_i + b_i - c_i n_i - g_i v_i

    g   inverse gain, 1 / alpha (equation 8): the command per speed
    T   creep, s^2/m: rubber that pulls slides in proportion to the speed s of its travel
    tau lag of the wheel loops, s
    c   speed that dry friction costs, against the direction of motion n
    b   disturbance: whatever else acts like a command (a push, a slope, a biased gyro)

What the velocity lacks of the command, u - v, turns the robot: by how wheels give way (`Compliance`), less the
coupling k (u - v), which is what is left of that: a wheel is weak or slides, the centre of mass is off the middle.

A command acts `latency` frames after it was sent. Of creep, lag and friction only those of driving forward
are states; those of the other axes are in proportion, by the directions of the wheels.
"""

import numpy as np

from omni_control.controllers.base import Observation, TeamModel
from omni_control.delay_compensation import CommandHistory
from omni_control.estimation.delayed_measurements import FilterStep
from omni_control.estimation.yaw_coupling import WheelCompliance
from omni_control.kinematics import Array, Kinematics, body_to_world, world_to_body, wrap_angle

POSE, VELOCITY, DISTURBANCE, COUPLING, INVERSE_GAIN = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 9),
    slice(9, 11),
    slice(11, 14),
)
LATENCY, CREEP, LAG, FRICTION, SIZE = 14, 15, 16, 17, 18
TURNED = slice(8, 11)  # what turns robots besides commands: disturbance and couplings

# Wheels of most robots of the league, for robots of which nobody knows them.
LEAGUE_WHEELS = Kinematics(np.radians([60.0, 135.0, 225.0, 300.0]), 0.08, 0.0285)
INERTIA = 0.7  # yaw inertia over m l^2 (TIGERs Mannheim)
GYRO_SHARE = 0.5  # of a disturbance of the turn rate, left by a loop on the gyro of gain 1
UNKNOWN_ALPHA, YAW_ALPHA = (0.91, 0.91), 0.98  # priors where nobody knows better
LAG_SHARE, FRICTION_SHARE = 0.75, 0.8  # forward, of the lag and friction known as means
MIN_LAG_S = 5e-3  # vision of 60 Hz cannot tell shorter lags from each other
# Standard deviations of gains, and of creep, lag and friction, relative to those known.
KNOWN_SIGMA, UNKNOWN_SIGMA = (0.07, 0.2, 0.35, 0.3), (0.12, 0.35, 0.5, 0.4)
ZERO_SIGMA = 0.04, 0.01, 0.02  # of creep, lag and friction where none is given, s^2/m, s, m/s
YAW_GAIN_SIGMA = 0.05
GAINS_ALIKE = 0.5  # correlation of forward and sideways
LATENCY_SIGMA = 1.2  # frames
COUPLING_SIGMA = 0.1  # rad/m
DISTURBANCE_SIGMA = 0.02, 0.02, 0.05  # m/s and rad/s
DISTURBANCE_TIME_S, PARAMETER_TIME_S = (0.5, 0.5, 1.0), 12.0  # after which they return to the prior
MAX_LATENCY_BELOW, MAX_LATENCY_ABOVE = 9, 6  # frames from the known one
ACCELERATION_M_S2, ACCELERATION_SHARE, TURN_ACCELERATION_RAD_S2 = 0.35, 0.3, 1.5  # not in the law
INNOVATION_FRAMES, MAX_INNOVATION, MAX_NOISE_SCALE = 10, 50.0, 30.0
TRUSTED_INNOVATION = 1.5  # up to which parameters are learned at full rate
EVIDENT_M_S = 0.1  # below it, dry friction may hold a robot, and its parameters do not show
STEADY_M_S2 = 2.0  # above it, wheels may slide, and gains do not show
MAX_BRAKING_M_S2 = 9.81
# A robot is unresponsive if its motion is less than this share of the commanded one for a while.
RESPONSE_FRAMES, MIN_RESPONSE, SILENT_FRAMES = 8, 0.4, 5
SLOW_M_S = 0.05  # below which dry friction is in proportion to the speed
DIFFERENCE = 1e-5  # of states, for the Jacobian


class RobotEkf:
    """States and parameters of n robots, estimated from vision and the commands sent.

    Args:
        told: the nominal model.
        n: robots.
        noise: standard deviation of vision, per axis of a pose, m, m, rad.
        learns: whether disturbance and parameters are estimated, or held at the nominal model.

    Attributes:
        state: pose, velocity and disturbance in the world frame, couplings, inverse gains, latency,
            creep, lag, friction, (n, 18).
        covariance: of these, (n, 18, 18).
        innovation: running mean of normalized innovations squared, (n,); 1 for one that keeps to
            the law.
        memory_frames: commands that must be stored.
    """

    def __init__(
        self, model: TeamModel, n: int, noise: tuple[float, float, float], learns: bool = True
    ) -> None:
        self.period, self.model, self.learns = model.period, model, learns
        wheels = model.geometry or LEAGUE_WHEELS
        directions, self.arm = wheels.matrix[:, :2], wheels.arm
        forward, sideways = (directions**2).mean(0)
        ratio = forward / sideways  # how much more a robot gives way sideways
        turning = GYRO_SHARE * INERTIA * forward
        aside = model.creep_sideways_s2_m
        creep_ratio = aside / model.creep_s2_m if aside and model.creep_s2_m else ratio
        self._lag_ratios = np.array([1.0, ratio, turning])
        self._creep_ratios = np.array([1.0, creep_ratio, turning])
        mean_direction = np.abs(directions[:, 0]).mean()
        self._friction_ratios = np.array(
            [1.0, ratio, GYRO_SHARE / self.arm * forward / mean_direction]
        )
        self._compliance = WheelCompliance(wheels, GYRO_SHARE if model.geometry else 0.0)

        self.prior = np.zeros(SIZE)
        self.prior[INVERSE_GAIN] = 1 / np.array([*(model.alpha or UNKNOWN_ALPHA), YAW_ALPHA])
        self.prior[LATENCY:] = (
            model.delay_frames,
            model.creep_s2_m,
            max(LAG_SHARE * model.lag_s, MIN_LAG_S),
            FRICTION_SHARE * model.drag_m_s,
        )
        sigma, alike = np.zeros(SIZE), np.eye(SIZE)
        alike[11, 12] = alike[12, 11] = GAINS_ALIKE
        if learns:
            gain, *relative = KNOWN_SIGMA if model.alpha else UNKNOWN_SIGMA
            given = model.creep_s2_m, model.lag_s, model.drag_m_s
            sigma[DISTURBANCE] = DISTURBANCE_SIGMA
            sigma[INVERSE_GAIN] = gain, gain, YAW_GAIN_SIGMA
            sigma[COUPLING], sigma[LATENCY] = COUPLING_SIGMA, LATENCY_SIGMA
            sigma[CREEP:] = np.where(np.equal(given, 0), ZERO_SIGMA, relative * self.prior[CREEP:])
        below, above = (
            model.delay_frames - MAX_LATENCY_BELOW,
            model.delay_frames + MAX_LATENCY_ABOVE,
        )
        self._low = np.minimum([-1, -1, *3 * [0.8], max(below, 0), 0, MIN_LAG_S, 0], self.prior[9:])
        self._high = np.maximum([1, 1, *3 * [1.9], above, 0.2, 0.1, 0.15], self.prior[9:])
        times = np.array([*DISTURBANCE_TIME_S, *9 * [PARAMETER_TIME_S]])
        self._keep = np.append(np.ones(6), np.exp(-self.period / times))
        self._prior_covariance = alike * np.outer(sigma, sigma)
        renewed = np.sqrt(1 - self._keep**2)
        self._renewed = self._prior_covariance * np.outer(renewed, renewed)
        self._noise = np.diag(np.maximum(noise, [1e-4, 1e-4, 1e-3])) ** 2
        one = DIFFERENCE * np.eye(SIZE)
        self._changes = np.concatenate([0 * one[:1], one, -one])[
            :, None
        ]  # of states, for the Jacobian
        self.memory_frames = above + 8
        self.state, self.covariance = np.zeros((n, SIZE)), np.zeros((n, SIZE, SIZE))
        self.mean_nis = np.ones(n)
        self._commanded, self._answered = np.zeros((2, n))  # squares of speeds, running means
        self._silent = np.zeros(n)  # frames without a response
        self._started = False

    @property
    def latency(self) -> Array:
        """Time from when a command is sent until it begins to act, (n,) frames."""
        return self.state[:, LATENCY]

    def time_constants(self, state: Array, travel: Array) -> Array:
        """Return the time constants (..., n, 3) of robots whose wheels travel at speeds (..., n, 3), s."""
        gain = state[..., INVERSE_GAIN]
        creep = gain * self._creep_ratios * state[..., CREEP, None]
        creep[..., 2] *= gain[..., 0] ** 2
        return self._lag_ratios * state[..., LAG, None] / gain + creep * travel

    def step(self, state: Array, command: Array, duration: Array | float) -> Array:
        """Return the states (..., n, 18) after commands (..., n, 3), world frame, acting for durations (..., n), s."""
        duration = np.asarray(duration, float)[..., None]
        heading = state[..., 2] + state[..., 5] * duration[..., 0] / 2
        gain = state[..., INVERSE_GAIN]
        velocity = world_to_body(state[..., VELOCITY], heading)
        target = world_to_body(command + state[..., DISTURBANCE], heading)
        late = self.time_constants(state, self._travel(velocity))
        acceleration = (target / gain - velocity) / late
        target[..., 2] += self._turned(state, velocity, acceleration, target - velocity)
        decay = np.exp(-duration / late)
        free = velocity + (1 - decay) * (target / gain - velocity)
        final = (target - self._friction(state, free)) / gain
        excess = velocity - final
        result = state.copy()
        result[..., POSE] += body_to_world(duration * final + excess * (1 - decay) * late, heading)
        result[..., VELOCITY] = body_to_world(final + excess * decay, heading)
        return result

    def invert(self, before: Array, after: Array, heading: Array) -> Array:
        """Return the commands (..., n, 3) that lead from velocities to others in a frame, without disturbance.

        It inverts `step`, but for friction, which is that at the mean velocity.

        Args:
            before: velocities at the beginning of the frame (..., n, 3), world frame.
            after: at its end, same.
            heading: in its middle, (..., n) rad.
        """
        state, gain = self.state, self.state[:, INVERSE_GAIN]
        before, after = world_to_body(before, heading), world_to_body(after, heading)
        decay = np.exp(-self.period / self.time_constants(state, self._travel(before)))
        command = (after - decay * before) / (1 - decay) * gain + self._friction(
            state, (before + after) / 2
        )
        shortfall, acceleration = command - before, (after - before) / self.period
        command[..., 2] -= self._turned(state, before, acceleration, shortfall)
        return body_to_world(command, heading)

    def observe(self, observation: Observation) -> None:
        """Go through the steps of a frame, and correct the states by its vision after the last one."""
        if not self._started:
            self._started = True
            self.state[:] = self.prior
            self.state[:, POSE] = observation.pose
            self.covariance[:] = self._prior_covariance
            self.covariance[:, POSE, POSE] = self._noise
        *before, last = observation.filter_steps or (FilterStep.to_present(len(self.state)),)
        for step in before:
            self._update(None, observation.sent_commands, step)
        self._update(observation.measured_pose, observation.sent_commands, last)

    def predict(self, observation: Observation) -> Array:
        """Return the states (n, 18) when the command of this frame begins to act."""
        latency = self.latency + (
            observation.filter_steps[-1].frames_behind if observation.filter_steps else 0.0
        )
        count = int(np.ceil(latency.max()))
        state = self.state
        shares = observation.sent_commands.get_pending_fractions(latency[:, None], count)[..., 0]
        for command, share in zip(observation.sent_commands.get_latest(count), shares, strict=True):
            after = self.step(state, command, share * self.period)
            state = np.where(share[:, None] > 0, after, state)
        return state

    def _travel(self, velocity: Array) -> Array:
        """Return how fast wheels travel for each axis (..., n, 3): driving, driving, and turning too, m/s."""
        speed = np.hypot(velocity[..., 0], velocity[..., 1])
        return np.stack([speed, speed, np.hypot(speed, self.arm * velocity[..., 2])], axis=-1)

    def _turned(
        self, state: Array, velocity: Array, acceleration: Array, shortfall: Array
    ) -> Array:
        """Return the turn rates (..., n) by which driving turns robots; see `Compliance.turned`."""
        turned = self._compliance.compute_turn_rate(
            velocity, acceleration, shortfall, state[..., LAG], state[..., CREEP]
        )
        return turned - (state[..., COUPLING] * shortfall[..., :2]).sum(-1)

    def _friction(self, state: Array, velocity: Array) -> Array:
        """Return the speeds (..., n, 3) that dry friction costs robots that go at these velocities."""
        direction = velocity * [1.0, 1.0, self.arm] / np.maximum(self._travel(velocity), SLOW_M_S)
        return np.asarray(self._friction_ratios * state[..., FRICTION, None] * direction)

    def _update(self, measured: Array | None, sent: CommandHistory, step: FilterStep) -> None:
        """Go on by a step; correct the states by poses (n, 3), which vision reports for the last step only."""
        state, period = self.state, self.period
        latency = (self.latency + step.frames_behind)[:, None]
        latencies = np.maximum(latency + np.array([0, -1, 1])[:, None, None], 0)
        command, sooner, later = sent.get_delayed(latencies)
        per_frame = (later - sooner) / (
            latencies[2] - latencies[1]
        )  # how the command that acts depends on the latency
        ends = self.step(
            state + self._changes, command + self._changes[..., LATENCY, None] * per_frame, period
        )
        after, above, below = ends[0], ends[1 : SIZE + 1], ends[SIZE + 1 :]
        transition = np.moveaxis((above - below) / (2 * DIFFERENCE), 0, -1)

        speed = np.hypot(state[:, 3], state[:, 4])
        # How much poses and velocities may teach. Less where innovations are large: of gains,
        # latency, creep, lag and friction, by the square but for the gain of turning. Less where
        # their own axis is slow, so that dry friction may hold it: of all these but that gain. Less
        # at high acceleration, where wheels may slide: of the gains of driving.
        speeds = np.stack(2 * [speed, speed, self.arm * np.abs(state[:, 5])], 1)
        shown = np.minimum(speeds / EVIDENT_M_S, 1) ** 2
        change = np.hypot(*(after[:, 3:5] - state[:, 3:5]).T)
        trust = np.minimum(TRUSTED_INNOVATION / self.mean_nis, 1)[:, None, None]
        transition[:, :6, 11:] *= trust
        transition[:, :6, [11, 12, *range(LATENCY, SIZE)]] *= shown[..., None] * trust
        transition[:, :6, 11:13] /= 1 + (change[:, None, None] / (STEADY_M_S2 * period)) ** 2
        transition *= self._keep[:, None]
        predicted = self._keep * after + (1 - self._keep) * self.prior
        covariance = transition @ self.covariance @ transition.swapaxes(1, 2)
        responsive = (self._silent < SILENT_FRAMES)[:, None, None]
        covariance[:, :6, 6:] *= responsive
        covariance[:, 6:, :6] *= responsive
        scale = np.clip(self.mean_nis, 1, MAX_NOISE_SCALE)
        unknown = (ACCELERATION_M_S2 * period) ** 2 + (ACCELERATION_SHARE * change) ** 2
        covariance[:, [3, 4], [3, 4]] += (scale * unknown)[:, None]
        covariance[:, 5, 5] += scale * (TURN_ACCELERATION_RAD_S2 * period) ** 2
        covariance += self._renewed
        covariance[:, TURNED, TURNED] += (np.sqrt(scale[:, None, None]) - 1) * self._renewed[
            TURNED, TURNED
        ]
        self.state = np.where(step.frozen[:, None], state, predicted)
        self.covariance = np.where(step.frozen[:, None, None], self.covariance, covariance)
        if measured is not None:
            self._correct(measured, step.capture_offset[:, None], command)

    def _correct(self, measured: Array, after: Array, command: Array) -> None:
        """Correct the states by poses (n, 3) that were seen a time `after` (n, 1) later, s."""
        state, covariance = self.state, self.covariance
        error = measured - state[:, POSE] - after * state[:, VELOCITY]
        error[:, 2] = wrap_angle(error[:, 2])
        seen = ~np.isnan(error[:, 0])
        error[~seen] = 0.0
        with_seen = covariance[:, :, POSE] + after[..., None] * covariance[:, :, VELOCITY]
        inverse = np.linalg.inv(
            with_seen[:, POSE] + after[..., None] * with_seen[:, VELOCITY] + self._noise
        )
        square = (error * (inverse @ error[..., None])[..., 0]).sum(1) / 3
        gain = with_seen @ inverse * seen[:, None, None]
        corrected = state + (gain @ error[..., None])[..., 0]
        spread = covariance - gain @ with_seen.swapaxes(1, 2)
        distance = np.hypot(error[:, 0], error[:, 1])
        for i in np.flatnonzero(
            (square > MAX_INNOVATION) & (distance > MAX_BRAKING_M_S2 * self.period**2)
        ):
            # No motion leads there: the robot was put there, or the camera was moved.
            corrected[i], spread[i] = state[i], covariance[i]
            corrected[i, :2] += error[i, :2]
            spread[i, :2], spread[i, :, :2] = 0.0, 0.0
            spread[i, :2, :2] = self._noise[:2, :2]
            spread[i, [3, 4], [3, 4]] += (distance[i] / self.period) ** 2
        corrected[:, 9:] = np.clip(corrected[:, 9:], self._low, self._high)
        self.state, self.covariance = corrected, (spread + spread.swapaxes(1, 2)) / 2
        now = np.minimum(square, MAX_INNOVATION)
        self.mean_nis = np.where(
            seen, self.mean_nis + (now - self.mean_nis) / INNOVATION_FRAMES, self.mean_nis
        )
        rims = np.array([1.0, 1.0, self.arm])
        commanded, moving = command * rims, self.state[:, VELOCITY] * rims
        self._commanded += ((commanded**2).sum(1) - self._commanded) / RESPONSE_FRAMES
        self._answered += ((commanded * moving).sum(1) - self._answered) / RESPONSE_FRAMES
        silent = (self._commanded > EVIDENT_M_S**2) & (
            self._answered < MIN_RESPONSE * self._commanded
        )
        self._silent = np.where(silent, self._silent + 1, 0)

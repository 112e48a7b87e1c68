"""Baseline controllers: proportional (p), Smith predictor (smith), linear quadratic (lqr).

They assume the same nominal robot: dead time, a first-order lag, and nothing else.
"""

import math

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.delay_compensation import CommandHistory
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import Reference

# Usable braking, as a fraction of the limit of commanded acceleration. The carpet may give less,
# and a command acts late.
BRAKING_FRACTION = 0.25


def compute_pose_error(target: Array, pose: Array) -> Array:
    """Return `target` minus `pose`, both (n, 3), with the heading error in (-pi, pi]."""
    error = target - pose
    error[:, 2] = wrap_angle(error[:, 2])
    return error


class NominalRobot:
    """Model of n robots that follow their commands after a dead time, with a first-order lag.

    Per axis x' = v, v' = (u(t - k_d T) - v) / lag. Each command u is held for a frame, so that the
    discrete model is exact:

        x(k+1) = x(k) + coast v(k) + (T - coast) u(k - k_d),   coast = lag (1 - decay)
        v(k+1) = decay v(k) + (1 - decay) u(k - k_d),          decay = exp(-T / lag)

    Args:
        model: The team's knowledge of the robots and the loop.
        n: Number of robots.

    Attributes:
        velocity_decay, coast_time_s: `decay` and `coast` above; both are zero without a lag.
        velocity: v(k), (n, 3).
        displacement: x(k) - x(k-1), (n, 3).
    """

    def __init__(self, model: TeamModel, n: int) -> None:
        self._period, self._delay_frames = model.period, model.delay_frames
        self.velocity_decay = math.exp(-model.period / model.lag_s) if model.lag_s else 0.0
        self.coast_time_s = model.lag_s * (1 - self.velocity_decay)
        self.velocity, self.displacement = np.zeros((2, n, 3))

    def advance(self, sent: CommandHistory) -> None:
        """Advance to this frame, with the commands that acted in the previous frame."""
        command = sent.get_latest(1, skip=self._delay_frames)[0]
        self.displacement, self.velocity = self._step(self.velocity, command)

    def predict(self, pose: Array, commands_in_flight: Array) -> tuple[Array, Array]:
        """Return poses and velocities (n, 3) at the end of the dead time.

        Args:
            pose: Present poses (n, 3).
            commands_in_flight: Commands that have not acted yet, (k_d, n, 3), oldest first.
        """
        velocity = self.velocity
        for command in commands_in_flight:
            displacement, velocity = self._step(velocity, command)
            pose = pose + displacement
        return pose, velocity

    def _step(self, velocity: Array, command: Array) -> tuple[Array, Array]:
        """Return the displacement in a frame, and the velocity at its end."""
        displacement = self.coast_time_s * velocity + (self._period - self.coast_time_s) * command
        return displacement, self.velocity_decay * velocity + (1 - self.velocity_decay) * command


def compute_simc_gain(latency_s: float) -> float:
    """Return the proportional gain K = 1 / (2 latency), 1/s, for an integrator with a latency.

    This is the SIMC rule for tight control, tau_c = theta (S. Skogestad, Simple analytic rules for
    model reduction and PID controller tuning, J. Process Control 13, 2003). The phase margin is 61
    degrees, the gain margin pi.
    """
    return 1 / (2 * latency_s)


def compute_lqr_gain(
    transition: Array, input_vector: Array, state_weight: Array, command_weight: float
) -> Array:
    """Return the gain K (m,) of u = -K x that minimizes the sum of x' Q x + r u^2 over all frames.

    Args:
        transition: A (m, m) of x(k+1) = A x(k) + B u(k).
        input_vector: B (m,).
        state_weight: Q (m, m).
        command_weight: r.
    """
    # Importing scipy.linalg takes longer than all other imports together.
    from scipy.linalg import solve_discrete_are

    b = input_vector[:, None]
    cost = solve_discrete_are(transition, b, state_weight, np.array([[command_weight]]))
    return np.linalg.solve(command_weight + b.T @ cost @ b, b.T @ cost @ transition)[0]


class Proportional(Controller):
    """p: proportional control with velocity feedforward, gain by the SIMC rule.

    Like FLC it compares the present pose with the present reference. The latency of the gain
    includes one more frame: half a frame for the mean hold time of a command, and half a frame for
    the resolution of the dead time.
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.gain = compute_simc_gain((model.latency_frames + 1) * model.period)

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.predicted_pose = observation.pose
        target, feedforward = self.reference.at(frame, observation.pose)
        return feedforward + self.gain * compute_pose_error(target, observation.pose)


class SmithPredictor(Controller):
    """smith: Smith predictor with proportional control of the nominal robot.

    The feedback is the model without dead time, plus the measurement, minus the model with dead
    time (O. J. M. Smith, Closer control of loops with dead time, Chem. Eng. Progress 53, 1957).
    The robot integrates its commands, so that the two models differ by the effect of the commands
    in flight. The feedforward is that of the time when the robot responds.

    The gain follows the SIMC rule for the remaining latency: the lag and one frame, see
    `Proportional`. A Smith predictor of an integrating plant has a steady-state error under a
    constant disturbance, such as drag (K. Watanabe and M. Ito, IEEE Trans. Automatic Control 26,
    1981).
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.gain = compute_simc_gain(model.lag_s + model.period)
        self.robot = NominalRobot(model, n)

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.robot.advance(observation.sent_commands)
        self.predicted_pose, _ = self.robot.predict(
            observation.pose, observation.commands_in_flight
        )
        target, feedforward = self.reference.at(
            frame + self.model.latency_frames, self.predicted_pose
        )
        # Extrapolate the target from the end of the latency back to the end of the dead time.
        target = target - self.model.lag_s * feedforward
        return feedforward + self.gain * compute_pose_error(target, self.predicted_pose)


class Lqr(Controller):
    """lqr: linear quadratic regulator with dead time, lag, preview and disturbance estimate.

    Per axis the state is the error of position and velocity, and the commands in flight. Their
    effect cannot be changed. The optimal gain is therefore the gain for a robot without dead time,
    applied to the state predicted at the end of the dead time (D. L. Kleinman, IEEE Trans.
    Automatic Control 14, 1969).

    The weights follow Bryson's rule: a position error of `error_range_m` costs as much as a
    correction of `speed_range_m_s`. The heading has the same ratio, as the displacement of a point
    on the robot. The reference is previewed by dead time and lag. It yields command, position and
    velocity of a robot that follows it exactly, for a constant acceleration over the lag.

    The deviation of the robot from the model is treated as a constant disturbance of its velocity.
    Without it, drag and alpha would cause a steady-state error. The time constant of the estimate
    is the latency plus one frame.

    The estimate is limited to `speed_range_m_s`, the largest correction of the fuzzy controllers,
    and to that over `error_range_m` for the turn rate. Wheels that slide, a robot that is off, or
    a jump of the pose exceed it. No command compensates for these, and the estimate would wind up.

    The returning speed is limited to one from which the robot can brake within the error. The
    quadratic cost does not know the limit of acceleration and would overshoot.
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.robot = robot = NominalRobot(model, n)
        self.gain = compute_lqr_gain(
            np.array([[1.0, robot.coast_time_s], [0.0, robot.velocity_decay]]),
            np.array([model.period - robot.coast_time_s, 1 - robot.velocity_decay]),
            np.diag([model.error_range_m**-2, 0.0]),
            model.speed_range_m_s**-2,
        )
        self.disturbance = np.zeros((n, 3))
        self._braking = BRAKING_FRACTION * np.array(
            [*2 * [model.limits.acceleration], model.limits.turn_acceleration]
        )
        self._max_disturbance = model.speed_range_m_s * np.array(
            [1.0, 1.0, 1 / model.error_range_m]
        )
        self._last_pose: Array | None = None
        self._last_feedforward: Array | None = None

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.robot.advance(observation.sent_commands)
        self._estimate_disturbance(observation.pose)
        position, velocity = self.robot.predict(observation.pose, observation.commands_in_flight)
        position = position + self.model.delay_frames * self.model.period * self.disturbance
        velocity = velocity + self.disturbance
        self.predicted_pose = position + self.model.lag_s * velocity
        desired_pose, desired_velocity, feedforward = self._nominal_state_on_reference(frame)
        error = compute_pose_error(desired_pose, position)
        distances = np.column_stack([*2 * [np.hypot(*error.T[:2])], np.abs(error[:, 2])])
        max_speed = np.sqrt(2 * self._braking * distances)
        max_gain = max_speed / np.maximum(distances, 1e-9)
        position_correction = error * np.minimum(self.gain[0], max_gain)
        velocity_correction = self.gain[1] * (desired_velocity - velocity)
        return feedforward - self.disturbance + (position_correction + velocity_correction)

    def _estimate_disturbance(self, pose: Array) -> None:
        """Update the velocity disturbance by the motion that the model does not explain.

        Args:
            pose: Present poses (n, 3).
        """
        last_pose = pose if self._last_pose is None else self._last_pose
        self._last_pose = pose
        unexplained = compute_pose_error(pose, last_pose) - self.robot.displacement
        deviation = unexplained / self.model.period
        self.disturbance = self.disturbance + (deviation - self.disturbance) / (
            self.model.latency_frames + 2
        )
        self.disturbance = np.clip(self.disturbance, -self._max_disturbance, self._max_disturbance)

    def _nominal_state_on_reference(self, frame: int) -> tuple[Array, Array, Array]:
        """Return pose, velocity and command (n, 3) at the end of the dead time.

        They are those of a nominal robot that follows the reference exactly.
        """
        period, lag = self.model.period, self.model.lag_s
        target, feedforward = self.reference.at(
            frame + self.model.latency_frames, self.predicted_pose
        )
        last_feedforward = feedforward if self._last_feedforward is None else self._last_feedforward
        self._last_feedforward = feedforward
        acceleration = (feedforward - last_feedforward) / period
        pose = target - lag * feedforward + lag * (lag + period) / 2 * acceleration
        velocity = feedforward - period / (1 - self.robot.velocity_decay) * acceleration
        return pose, velocity, feedforward

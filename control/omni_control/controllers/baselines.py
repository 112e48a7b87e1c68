"""Baseline controllers: proportional (p), Smith predictor (smith), linear quadratic (lqr).

All use the same nominal robot: dead time and a first-order lag. lqr adds a disturbance estimate.
"""

import math

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.delay_compensation import CommandHistory
from omni_control.kinematics import Array, compute_pose_error
from omni_control.reference import Reference

# Assumed deceleration of a braking robot, as a fraction of the limit of commanded acceleration.
# Wheels may slide at less than the limit, and commands act after the latency.
BRAKING_FRACTION = 0.25


class NominalRobot:
    """Model of n robots that follow their commands after a dead time, with a first-order lag.

    Per axis x' = v, v' = (u(t - k_d T) - v) / lag. Each command u is held for a frame, so that the
    discrete model is exact. If k_d is an integer:

        x(k+1) = x(k) + coast v(k) + (T - coast) u(k - k_d),   coast = lag (1 - decay)
        v(k+1) = decay v(k) + (1 - decay) u(k - k_d),          decay = exp(-T / lag)

    Args:
        model: The team's knowledge of the robots and the loop.
        n: Number of robots.

    Attributes:
        velocity_decay: `decay` above, the ratio of the velocities v(k+1) and v(k) at zero command.
        coast_time_s: `coast` above, the displacement in a frame at zero command, divided by v(k).
            Both are zero without a lag.
        velocity: v(k), (n, 3).
        displacement: x(k) - x(k-1), (n, 3).
    """

    def __init__(self, model: TeamModel, n: int) -> None:
        self._period, self._delay_frames = model.period, model.delay_frames
        self._lag_s = model.lag_s
        self.velocity_decay = math.exp(-model.period / model.lag_s) if model.lag_s else 0.0
        self.coast_time_s = model.lag_s * (1 - self.velocity_decay)
        self.velocity, self.displacement = np.zeros((2, n, 3))

    def advance(self, sent: CommandHistory) -> None:
        """Advance by a frame to the present, with the commands that acted in the previous frame."""
        whole_frames, fraction = int(self._delay_frames), self._delay_frames % 1
        command = sent.get_latest(1, skip=whole_frames)[0]
        self.displacement = np.zeros_like(self.velocity)
        if fraction:
            older = sent.get_latest(1, skip=whole_frames + 1)[0]
            self.displacement, self.velocity = self._step(self.velocity, older, fraction)
        displacement, self.velocity = self._step(self.velocity, command, 1 - fraction)
        self.displacement = self.displacement + displacement

    def predict(self, pose: Array, sent: CommandHistory) -> tuple[Array, Array]:
        """Return poses and velocities (n, 3) at the end of the dead time.

        Args:
            pose: Present poses (n, 3).
            sent: Sent commands.
        """
        velocity = self.velocity
        commands = sent.get_latest(math.ceil(self._delay_frames))
        for i, command in enumerate(commands):
            fraction = min(self._delay_frames - (len(commands) - 1 - i), 1)
            displacement, velocity = self._step(velocity, command, fraction)
            pose = pose + displacement
        return pose, velocity

    def _step(self, velocity: Array, command: Array, fraction: float) -> tuple[Array, Array]:
        """Return the displacement (n, 3) in a fraction of a frame, and the velocity at its end."""
        decay, coast_time_s, period = self.velocity_decay, self.coast_time_s, self._period
        if fraction < 1:
            period = fraction * period
            decay = math.exp(-period / self._lag_s) if self._lag_s else 0.0
            coast_time_s = self._lag_s * (1 - decay)
        displacement = coast_time_s * velocity + (period - coast_time_s) * command
        return displacement, decay * velocity + (1 - decay) * command


def compute_simc_gain(latency_s: float) -> float:
    """Return the proportional gain K = 1 / (2 latency), 1/s, for an integrator with a latency.

    This is the SIMC rule for tight control, tau_c = theta (S. Skogestad, Simple analytic rules for
    model reduction and PID controller tuning, J. Process Control 13, 2003). The lag is lumped into
    the dead time theta = latency. The phase margin is then 61 degrees, the gain margin pi.
    """
    return 1 / (2 * latency_s)


def compute_lqr_gain(
    transition: Array, input_vector: Array, state_weight: Array, command_weight: float
) -> Array:
    """Return the gain K (m,) of u = -K x that minimizes the sum of x' Q x + r u^2.

    The sum is over infinitely many frames.

    Args:
        transition: A (m, m) of x(k+1) = A x(k) + B u(k).
        input_vector: B (m,).
        state_weight: Q (m, m).
        command_weight: r.
    """
    # Importing scipy.linalg takes longer than all other imports together.
    from scipy.linalg import solve_discrete_are

    b = input_vector[:, None]
    cost_to_go = solve_discrete_are(transition, b, state_weight, np.array([[command_weight]]))
    return np.linalg.solve(command_weight + b.T @ cost_to_go @ b, b.T @ cost_to_go @ transition)[0]


class Proportional(Controller):
    """p: proportional control with velocity feedforward, gain by the SIMC rule.

    Like the paper's FLC (`Flc`) it compares the present pose, `predicted_pose`, with the present
    reference. The gain is that for the nominal latency plus one frame: half a frame because a
    command is held for a frame, and half a frame for the rounding of the dead time to frames.
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

    The fed-back pose is the measured pose plus the difference between the outputs of the models
    without and with dead time (O. J. M. Smith, Closer control of loops with dead time, Chem. Eng.
    Progress 53, 1957). For an integrating robot this difference is the effect of the commands in
    flight. The fed-back pose is therefore `predicted_pose`, that at the end of the dead time. The
    feedforward is the velocity of the reference at the end of the latency, when the robot responds.

    The gain follows the SIMC rule for the latency that is not predicted: the lag and one frame (see
    `Proportional`). A Smith predictor of an integrating plant has a steady-state error under a
    constant disturbance, such as friction (K. Watanabe and M. Ito, IEEE Trans. Automatic Control
    26, 1981).
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.gain = compute_simc_gain(model.lag_s + model.period)
        self.nominal = NominalRobot(model, n)

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.nominal.advance(observation.sent_commands)
        self.predicted_pose, _ = self.nominal.predict(observation.pose, observation.sent_commands)
        target, feedforward = self.reference.at(
            frame + self.model.latency_frames, self.predicted_pose
        )
        # Extrapolate the target from the end of the latency back to the end of the dead time.
        target = target - self.model.lag_s * feedforward
        return feedforward + self.gain * compute_pose_error(target, self.predicted_pose)


class Lqr(Controller):
    """lqr: linear quadratic regulator with dead time, lag, preview and disturbance estimate.

    **Gain.** Per axis the state is the error of position and velocity, and the commands in flight.
    The effect of the commands in flight cannot be changed. The optimal gain is therefore the gain
    for a robot without dead time, applied to the state predicted for the end of the dead time
    (D. L. Kleinman, IEEE Trans. Automatic Control 14, 1969).

    The weights follow Bryson's rule: a position error of `error_range_m` costs as much as a
    correction of `speed_range_m_s`. The heading has the same gain: for the displacement of a point
    on the robot, the ratio of both costs is the same at any distance from the center.

    **Reference.** It is previewed by the latency. The feedforward and the desired state are the
    command and the state of a nominal robot that follows the reference exactly.
    `predicted_pose` is the pose at the end of the latency.

    **Disturbance.** Motion that the model does not explain is treated as a constant disturbance of
    the velocity. Without this estimate, friction and alpha would cause a steady-state error. The
    time constant of the estimate is the latency plus one frame.

    The estimate is limited to `speed_range_m_s`, and for the turn rate to
    `speed_range_m_s / error_range_m`. It would exceed these limits if wheels slide, if a robot is
    off, or if its pose jumps. No command compensates for these, and the estimate would wind up.

    **Braking.** The position feedback is limited to the speed from which the robot can stop within
    the remaining error: v <= sqrt(2 a d). The quadratic cost does not contain the limit of
    acceleration. Without this limit the robot would overshoot.
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.nominal = nominal = NominalRobot(model, n)
        self.gain = compute_lqr_gain(
            np.array([[1.0, nominal.coast_time_s], [0.0, nominal.velocity_decay]]),
            np.array([model.period - nominal.coast_time_s, 1 - nominal.velocity_decay]),
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
        self.nominal.advance(observation.sent_commands)
        self._estimate_disturbance(observation.pose)
        pose, velocity = self.nominal.predict(observation.pose, observation.sent_commands)
        pose = pose + self.model.delay_frames * self.model.period * self.disturbance
        velocity = velocity + self.disturbance
        self.predicted_pose = pose + self.model.lag_s * velocity
        desired_pose, desired_velocity, feedforward = self._compute_desired_state(frame)
        error = compute_pose_error(desired_pose, pose)
        # d of the docstring: the distance for x and y, and the absolute heading error.
        error_magnitude = np.column_stack([*2 * [np.hypot(*error.T[:2])], np.abs(error[:, 2])])
        max_speed = np.sqrt(2 * self._braking * error_magnitude)
        max_gain = max_speed / np.maximum(error_magnitude, 1e-9)
        pose_feedback = error * np.minimum(self.gain[0], max_gain)
        velocity_feedback = self.gain[1] * (desired_velocity - velocity)
        return feedforward - self.disturbance + (pose_feedback + velocity_feedback)

    def _estimate_disturbance(self, pose: Array) -> None:
        """Filter the velocity by which the robots deviate from the model.

        Args:
            pose: Present poses (n, 3).
        """
        last_pose = pose if self._last_pose is None else self._last_pose
        self._last_pose = pose
        unexplained_displacement = compute_pose_error(pose, last_pose) - self.nominal.displacement
        deviation = unexplained_displacement / self.model.period
        self.disturbance = self.disturbance + (deviation - self.disturbance) / (
            self.model.latency_frames + 2
        )
        self.disturbance = np.clip(self.disturbance, -self._max_disturbance, self._max_disturbance)

    def _compute_desired_state(self, frame: int) -> tuple[Array, Array, Array]:
        """Return pose, velocity and command (n, 3) of a nominal robot that follows the reference.

        The pose and the velocity are those at the end of the dead time, when the command acts. At
        the end of the latency, t + lag, the reference has the pose x, the mean velocity u until the
        next frame, which is the feedforward command, and the acceleration a. Thus

            x(t) = x - lag (u - a T / 2) + lag^2 a / 2 = x - lag u + lag (lag + T) a / 2

        The velocity of the nominal robot follows commands that change by a T per frame with a
        constant difference: v = u - a T / (1 - decay).
        """
        period, lag = self.model.period, self.model.lag_s
        target, feedforward = self.reference.at(
            frame + self.model.latency_frames, self.predicted_pose
        )
        last_feedforward = feedforward if self._last_feedforward is None else self._last_feedforward
        self._last_feedforward = feedforward
        acceleration = (feedforward - last_feedforward) / period
        pose = target - lag * feedforward + lag * (lag + period) / 2 * acceleration
        velocity = feedforward - period / (1 - self.nominal.velocity_decay) * acceleration
        return pose, velocity, feedforward

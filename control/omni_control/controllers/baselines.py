"""Classics to compare with: proportional control, the Smith predictor, and a linear quadratic regulator.

All believe in the same nominal robot: dead time, a lag of first order, and nothing else.
"""

import math

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.delay_compensation import CommandsInFlight
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import Reference

# Of the acceleration that may be commanded: carpets may give less, and commands take their time to
# act
BRAKE = 0.25


def pose_error(target: Array, pose: Array) -> Array:
    """What is missing to `target` from `pose`, both (n, 3), the heading the short way."""
    error = target - pose
    error[:, 2] = wrap_angle(error[:, 2])
    return error


class NominalRobot:
    """Model of n robots that obey their commands, after a dead time and with the lag of their wheel loops.

    Per axis x' = v, v' = (u(t - k_d T) - v) / lag, and each command u holds for a frame, so that
    exactly

        x(k+1) = x(k) + slide v(k) + (T - slide) u(k - k_d),   slide = lag (1 - keep)
        v(k+1) = keep v(k) + (1 - keep) u(k - k_d),            keep = exp(-T / lag)

    Args:
        told: what is known of the loop.
        n: robots.

    Attributes:
        keep, slide: see above; both are zero without a lag.
        velocity: v(k), (n, 3).
        moved: x(k) - x(k-1), (n, 3).
    """

    def __init__(self, model: TeamModel, n: int) -> None:
        self._period, self._delay = model.period, model.delay_frames
        self.keep = math.exp(-model.period / model.lag_s) if model.lag_s else 0.0
        self.slide = model.lag_s * (1 - self.keep)
        self.velocity, self.moved = np.zeros((2, n, 3))

    def advance(self, sent: CommandsInFlight) -> None:
        """Go on by the frame just past, in which the commands acted that were sent k_d frames before the newest."""
        self.moved, self.velocity = self._move(self.velocity, sent.last(1, skip=self._delay)[0])

    def at_the_end_of_the_dead_time(self, pose: Array, in_flight: Array) -> tuple[Array, Array]:
        """Poses and velocities (n, 3) to which commands in flight (k_d, n, 3) lead robots that are at `pose` now."""
        velocity = self.velocity
        for command in in_flight:
            moved, velocity = self._move(velocity, command)
            pose = pose + moved
        return pose, velocity

    def _move(self, velocity: Array, command: Array) -> tuple[Array, Array]:
        """Displacement in a frame, and the velocity at its end."""
        moved = self.slide * velocity + (self._period - self.slide) * command
        return moved, self.keep * velocity + (1 - self.keep) * command


def simc_gain(latency_s: float) -> float:
    """Proportional gain K = 1 / (2 latency), 1/s, for an integrator behind `latency_s`.

    The SIMC rule for tight control, tau_c = theta (S. Skogestad, Simple analytic rules for model
    reduction and PID controller tuning, J. Process Control 13, 2003): a phase margin of 61 degrees
    and a gain margin of pi.
    """
    return 1 / (2 * latency_s)


class Proportional(Controller):
    """p: proportional control with the reference velocity as feed-forward, its gain by the SIMC rule.

    Like FLC it compares the pose of now with the reference of now. To the latency the gain is for
    counts a frame more: half of one is how long a command is held on average, and half of one how
    well a dead time is known in frames.
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.gain = simc_gain((model.latency_frames + 1) * model.period)

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.predicted_pose = observation.pose
        target, feed_forward = self.reference.at(frame, observation.pose)
        return feed_forward + self.gain * pose_error(target, observation.pose)


class Smith(Controller):
    """smith: Smith predictor, proportional control of a nominal robot without dead time, corrected by vision.

    What is fed back is the model without dead time plus what vision saw less the model with it (O.
    J. M. Smith, Closer control of loops with dead time, Chem. Eng. Progress 53, 1957). The robot
    integrates, so that both models differ by what the commands in flight add. The feed-forward is
    that of the time when the robot answers.

    The gain is by the SIMC rule for the lag and a frame, which are left of the latency; see
    `Proportional`. As known of Smith's predictor for a plant that integrates, it does not remove
    the error by a lasting disturbance, such as drag (K. Watanabe and M. Ito, IEEE Trans. Automatic
    Control 26, 1981).
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.gain = simc_gain(model.lag_s + model.period)
        self.robot = NominalRobot(model, n)

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.robot.advance(observation.sent_commands)
        self.predicted_pose, _ = self.robot.at_the_end_of_the_dead_time(
            observation.pose, observation.commands_in_flight
        )
        target, feed_forward = self.reference.at(
            frame + self.model.latency_frames, self.predicted_pose
        )
        # From the end of the lag back to the end of the dead time
        target = target - self.model.lag_s * feed_forward
        return feed_forward + self.gain * pose_error(target, self.predicted_pose)


def lqr_gain(transition: Array, effect: Array, state_weight: Array, command_weight: float) -> Array:
    """Gain K (m,) of u = -K x that minimises the sum of x' Q x + r u^2 over all frames.

    Args:
        transition: A (m, m) of x(k+1) = A x(k) + B u(k).
        effect: B (m,).
        state_weight: Q (m, m).
        command_weight: r.
    """
    from scipy.linalg import (
        solve_discrete_are,  # here, since it takes longer to import than all else together
    )

    b = effect[:, None]
    cost = solve_discrete_are(transition, b, state_weight, np.array([[command_weight]]))
    return np.linalg.solve(command_weight + b.T @ cost @ b, b.T @ cost @ transition)[0]


class Lqr(Controller):
    """lqr: linear quadratic regulator on the model with dead time and lag, with preview and disturbance estimation.

    Per axis the state is the error of position and velocity, and the commands in flight. Nothing
    can be done about what these will cause, so that the optimal gain on this state is the gain for
    a robot without dead time, applied to the state predicted at the end of it (D. L. Kleinman, IEEE
    Trans. Automatic Control 14, 1969).

    Weights are Bryson's: a position error of `error_range_m` is as bad as a correction of
    `speed_range_m_s`. The heading has the same ratio, since it is the displacement of a point on
    the robot. Previewed by dead time and lag, the reference gives the command, position and
    velocity of a robot that follows it exactly; its acceleration is taken to be constant over the
    lag.

    What a robot does besides counts as a constant disturbance of its velocity, without which drag
    and alpha would leave a lasting error. Its estimate takes as long as a command to show, and a
    frame more, to follow.

    No disturbance is believed to be more than `speed_range_m_s`, as much as the fuzzy controllers
    correct at most, or, turning, that over `error_range_m`. Wheels that slide, a robot that is off
    or a pose that jumps depart by more, for which no command makes up, and the estimate would wind
    up.

    Of the optimal command, the way back to the reference is not faster than robots can brake within
    the error: the optimum knows no limit of acceleration, beyond which it swings.
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        self.robot = robot = NominalRobot(model, n)
        self.gain = lqr_gain(
            np.array([[1.0, robot.slide], [0.0, robot.keep]]),
            np.array([model.period - robot.slide, 1 - robot.keep]),
            np.diag([model.error_range_m**-2, 0.0]),
            model.speed_range_m_s**-2,
        )
        self.disturbance = np.zeros((n, 3))
        self._brake = BRAKE * np.array(
            [*2 * [model.limits.acceleration], model.limits.turn_acceleration]
        )
        self._most = model.speed_range_m_s * np.array([1.0, 1.0, 1 / model.error_range_m])
        self._pose: Array | None = None
        self._feed_forward: Array | None = None

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.robot.advance(observation.sent_commands)
        self._disturb(observation.pose)
        position, velocity = self.robot.at_the_end_of_the_dead_time(
            observation.pose, observation.commands_in_flight
        )
        position = position + self.model.delay_frames * self.model.period * self.disturbance
        velocity = velocity + self.disturbance
        self.predicted_pose = position + self.model.lag_s * velocity
        at, speed, feed_forward = self._wanted(frame)
        error = pose_error(at, position)
        sizes = np.column_stack([*2 * [np.hypot(*error.T[:2])], np.abs(error[:, 2])])
        brake = np.sqrt(2 * self._brake * sizes)
        back = error * np.minimum(self.gain[0], brake / np.maximum(sizes, 1e-9))
        return feed_forward - self.disturbance + (back + self.gain[1] * (speed - velocity))

    def _disturb(self, pose: Array) -> None:
        """Estimate the disturbance from what robots that are at `pose` (n, 3) now did more than the model."""
        before, self._pose = pose if self._pose is None else self._pose, pose
        besides = (pose_error(pose, before) - self.robot.moved) / self.model.period
        self.disturbance = self.disturbance + (besides - self.disturbance) / (
            self.model.latency_frames + 2
        )
        self.disturbance = np.clip(self.disturbance, -self._most, self._most)

    def _wanted(self, frame: int) -> tuple[Array, Array, Array]:
        """Pose, velocity and command (n, 3) of a nominal robot on the reference, at the end of the dead time."""
        period, lag = self.model.period, self.model.lag_s
        later, feed_forward = self.reference.at(
            frame + self.model.latency_frames, self.predicted_pose
        )
        before, self._feed_forward = (
            feed_forward if self._feed_forward is None else self._feed_forward,
            feed_forward,
        )
        acceleration = (feed_forward - before) / period
        pose = later - lag * feed_forward + lag * (lag + period) / 2 * acceleration
        return pose, feed_forward - period / (1 - self.robot.keep) * acceleration, feed_forward

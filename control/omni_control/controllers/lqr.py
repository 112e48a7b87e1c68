"""Linear quadratic regulator on the nominal model of a robot."""

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.controllers.baselines import NominalRobot, compute_pose_error
from omni_control.kinematics import Array
from omni_control.reference import Reference

# Of the acceleration that may be commanded: carpets may give less, and commands take their time to
# act
BRAKE = 0.25


def compute_lqr_gain(
    transition: Array, effect: Array, state_weight: Array, command_weight: float
) -> Array:
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
        self.gain = compute_lqr_gain(
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
        error = compute_pose_error(at, position)
        sizes = np.column_stack([*2 * [np.hypot(*error.T[:2])], np.abs(error[:, 2])])
        brake = np.sqrt(2 * self._brake * sizes)
        back = error * np.minimum(self.gain[0], brake / np.maximum(sizes, 1e-9))
        return feed_forward - self.disturbance + (back + self.gain[1] * (speed - velocity))

    def _disturb(self, pose: Array) -> None:
        """Estimate the disturbance from what robots that are at `pose` (n, 3) now did more than the model."""
        before, self._pose = pose if self._pose is None else self._pose, pose
        besides = (compute_pose_error(pose, before) - self.robot.moved) / self.model.period
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

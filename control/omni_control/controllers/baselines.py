"""Classics to compare with: proportional control, the Smith predictor, and a linear quadratic regulator.

All believe in the same nominal robot: dead time, a lag of first order, and nothing else.
"""

import math

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.delay_compensation import CommandHistory
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import Reference


def compute_pose_error(target: Array, pose: Array) -> Array:
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

    def advance(self, sent: CommandHistory) -> None:
        """Go on by the frame just past, in which the commands acted that were sent k_d frames before the newest."""
        self.moved, self.velocity = self._move(
            self.velocity, sent.get_latest(1, skip=self._delay)[0]
        )

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


def compute_simc_gain(latency_s: float) -> float:
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
        self.gain = compute_simc_gain((model.latency_frames + 1) * model.period)

    def command(self, frame: int, observation: Observation) -> Array:
        """See `Controller`."""
        self.predicted_pose = observation.pose
        target, feed_forward = self.reference.at(frame, observation.pose)
        return feed_forward + self.gain * compute_pose_error(target, observation.pose)


class SmithPredictor(Controller):
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
        self.gain = compute_simc_gain(model.lag_s + model.period)
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
        target = (
            target - self.model.lag_s * feed_forward
        )  # from the end of the lag back to the end of the dead time
        return feed_forward + self.gain * compute_pose_error(target, self.predicted_pose)

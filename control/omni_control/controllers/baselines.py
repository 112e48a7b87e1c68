"""Baseline controllers: proportional control, alone and with a Smith predictor.

Both assume the same nominal robot: dead time, a first-order lag, and nothing else.
"""

import math

import numpy as np

from omni_control.controllers.base import Controller, Observation, TeamModel
from omni_control.delay_compensation import CommandHistory
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import Reference


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

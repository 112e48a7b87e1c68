"""The robot as a team's computer believes it to be: dead time, a lag of first order, and nothing else."""

import math

import numpy as np

from omni_control.controllers.base import Told
from omni_control.delay import CommandsInFlight
from omni_control.kinematics import Array, wrap_angle


def pose_error(target: Array, pose: Array) -> Array:
    """What is missing to `target` from `pose`, both (n, 3), the heading the short way."""
    error = target - pose
    error[:, 2] = wrap_angle(error[:, 2])
    return error


class NominalRobot:
    """Model of n robots that obey their commands, after a dead time and with the lag of their wheel loops.

    Per axis x' = v, v' = (u(t - k_d T) - v) / lag, and each command u holds for a frame, so that exactly

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

    def __init__(self, told: Told, n: int) -> None:
        self._period, self._delay = told.period, told.delay_frames
        self.keep = math.exp(-told.period / told.lag_s) if told.lag_s else 0.0
        self.slide = told.lag_s * (1 - self.keep)
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

"""The robot as a team's computer believes it to be: dead time, a lag of first order, and nothing else."""

import math

from omni_control.delay import CommandsInFlight
from omni_control.kinematics import Array, wrap_angle
from omni_control.tracker import TrackerSettings


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
        settings: what is known of the loop.
        n: robots.

    Attributes:
        keep, slide: see above; both are zero without a lag.
        sent: commands sent, as many as may still act.
        velocity: v(k), (n, 3).
    """

    def __init__(self, settings: TrackerSettings, n: int) -> None:
        self._period, self._delay = settings.period, settings.delay_frames
        self.keep = math.exp(-settings.period / settings.lag_s) if settings.lag_s else 0.0
        self.slide = settings.lag_s * (1 - self.keep)
        self.sent = CommandsInFlight(n, math.ceil(settings.latency_frames) + 1)
        self.velocity = self.sent.last(1)[0].copy()

    def push(self, command: Array) -> None:
        """Add the commands (n, 3) that were sent in the frame just past; those sent k_d frames before acted in it."""
        self.sent.push(command)
        self.velocity = self._respond(self.velocity, self.sent.last(1, skip=self._delay)[0])

    def at_the_end_of_the_dead_time(self, pose: Array) -> tuple[Array, Array]:
        """Poses and velocities (n, 3) to which the commands in flight lead robots that are at `pose` (n, 3) now."""
        velocity = self.velocity
        for command in self.sent.last(self._delay):
            pose = pose + self.slide * velocity + (self._period - self.slide) * command
            velocity = self._respond(velocity, command)
        return pose, velocity

    def _respond(self, velocity: Array, command: Array) -> Array:
        return self.keep * velocity + (1 - self.keep) * command

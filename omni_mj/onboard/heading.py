"""What a robot holds for its heading: the gyro, put right by vision."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.link.radio import longest
from omni_mj.scenarios.settings import Settings, column


class HeadingEstimate:
    """Heading of n robots: the gyro integrated, its bias and drift corrected by vision's heading.

    Vision's heading arrives with a command, as late as that: it is compared with what the robot itself held for its
    heading when the command was sent.

    Args:
        settings: one per robot.
        heading: at the start, (n,) rad.
        period: time between corrections, s.
        room: where to keep headings and biases, and what share of an error goes into each, (n,) all four. [in arrays
            of its own]

    Attributes:
        heading: rad, (n,).
        bias: of the gyros, rad/s, (n,).
        past: a ring of what was held for the headings, (frames, n) rad.
        frame: calls of `correct` so far; a compiled loop counts what it does in their place.
    """

    def __init__(
        self,
        settings: Sequence[Settings],
        heading: Array,
        period: float,
        room: tuple[Array, Array, Array, Array] | None = None,
    ) -> None:
        self.heading, self.bias, self._heading_share, self._bias_share = room or np.zeros((4, len(heading)))
        self.heading[:] = heading
        firmware = [s.firmware for s in settings]
        self._heading_share[:] = column(firmware, "heading_gain")[:, 0] * period
        self._bias_share[:] = column(firmware, "bias_gain")[:, 0] * period
        self._robots = np.arange(len(heading))
        self.frame = 0
        self.remember(max(longest(s.radio, s.fault) for s in settings))

    def remember(self, frames: int) -> None:
        """Begin anew to keep what was held for the headings, for so many frames."""
        self.past = np.tile(self.heading, (frames + 1, 1))

    def place(self, robot: int, heading: float) -> None:
        """Forget what was: a robot has been put down with a heading (rad) that it is told."""
        self.heading[robot] = self.past[:, robot] = heading
        self.bias[robot] = 0.0

    def turn(self, rate: Array, timestep: Array | float) -> None:
        """Turn for `timestep` (s; one, or (n,)) at what the gyro shows less its bias, `rate` (n,) in rad/s."""
        self.heading += rate * timestep

    def correct(self, seen: Array, age: np.ndarray) -> None:
        """Compare with vision's heading (n,) that arrived in this frame, sent `age` (n,) frames ago, if one did."""
        self.past[self.frame % len(self.past)] = self.heading
        then = self.past[(self.frame - age) % len(self.past), self._robots]
        error = wrap_angle(seen - then)
        error = np.where(np.isnan(error), 0.0, error)
        correction = self._heading_share * error
        self.heading += correction
        self.past += correction  # what is corrected once is not corrected again
        self.bias -= self._bias_share * error
        self.frame += 1

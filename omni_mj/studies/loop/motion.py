"""What robots do while their loop is measured: stand or drive on, jump on demand, and be disturbed by sines."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S

SPEED_M_S, ACCELERATION_M_S2 = 1.0, 2.0  # forward, of robots that drive
# A constant speed tells a controller that identifies the robot nothing of its latency, so that robots weave about it:
# by this much forward and to the left. An eighth of a second's lateness is then worth 3 cm.
WEAVE_M_S, WEAVE_FRAMES = 0.25, 480
# Half a period of the weave: what its speeding up does to the first of two periods, its slowing down undoes in the
# second, and no other sine of the sum shows in its place.
PERIOD_FRAMES, PERIODS = WEAVE_FRAMES // 2, 2
TONES = np.array([1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24])  # sines: how often in a period
FREQUENCIES = 2 * np.pi * TONES / (PERIOD_FRAMES * PERIOD_S)  # rad/s: 1.6 to 38
RMS_M_S = 0.02  # of the sum of sines


class Case(NamedTuple):
    """One way in which the loop is measured.

    Attributes:
        drives: whether the robot drives forward, or stands.
        axis: along which it is disturbed, and stepped: 0 forward, 1 to the left.
    """

    drives: bool
    axis: int


CASES = {
    "rest, forward": Case(False, 0),
    "rest, sideways": Case(False, 1),
    "driving, along": Case(True, 0),
    "driving, across": Case(True, 1),
}


def multisine(seed: int, strength: int, frames: int) -> Array:
    """Return the sum of sines for a strength of one, the last of `frames` ending a period: (frames,), m/s.

    Args:
        seed: of the row.
        strength: 1, 2, ...: each has phases of its own, so that what one strength gets wrong another does otherwise.
        frames: how many.
    """
    phases = np.random.default_rng([seed, strength]).uniform(0, 2 * np.pi, len(TONES))
    turns = np.arange(-frames, 0)[:, None] * TONES / PERIOD_FRAMES
    total: Array = np.cos(2 * np.pi * turns + phases).sum(1)
    return RMS_M_S * np.sqrt(2 / len(TONES)) * total


def way(frame: Array) -> Array:
    """Return how far driving has led robots by `frame` (..., m, 3), without a jump; the same shape, m and rad."""
    time, faster = PERIOD_S * np.maximum(frame, 0), SPEED_M_S / ACCELERATION_M_S2
    forward = SPEED_M_S * (np.minimum(time, faster) ** 2 / (2 * faster) + np.maximum(time - faster, 0))
    rate = 2 * math.pi / (PERIOD_S * WEAVE_FRAMES)
    woven = WEAVE_M_S / rate * (1 - np.cos(rate * time))
    return np.array([1.0, 0.0, 0.0]) * forward + np.array([1.0, 1.0, 0.0]) * woven


class Motion(NamedTuple):
    """A reference for n robots that all look along x.

    Its poses may jump, while its twists remain those of the motion: what is added to a pose at once, no velocity leads
    to. Nobody knows of a jump beforehand, however far a controller looks ahead.

    Attributes:
        drives: 1 for each robot that drives, else 0, (n, 1).
        jump: what is added to the poses of all frames from now on, (n, 3).
        rows: of the robots that are meant, of those that these arrays have.
    """

    drives: Array
    jump: Array
    rows: np.ndarray | slice = slice(None)

    @classmethod
    def of_cases(cls, cases: Sequence[Case]) -> "Motion":
        """Return that of robots in these cases."""
        return cls(np.array([[float(case.drives)] for case in cases]), np.zeros((len(cases), 3)))

    def of(self, rows: np.ndarray) -> "Motion":
        """Return that of some of the robots, which jump with these."""
        return Motion(self.drives, self.jump, rows)

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """See `Reference`."""
        poses, twists = self.preview(frame, pose, 1)
        return poses[0], twists[0]

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """See `Reference`."""
        first = np.asarray(frame, float)
        first = first[:, None] if first.ndim == 1 else first
        start = np.broadcast_to(first, pose.shape) + np.arange(float(count))[:, None, None]
        here, later = (self.drives[self.rows] * way(frames) for frames in (start, start + 1))
        return here + self.jump[self.rows], (later - here) / PERIOD_S

"""What robots are to do while their loop is measured: stand or drive on, and on demand be a little elsewhere."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S

SPEED_M_S = 1.0  # forward, of robots that drive
ACCELERATION_M_S2 = 2.0  # up to it
# A constant speed tells a controller that identifies the robot nothing of its latency, so that robots weave about it:
# by this much forward and to the left. An eighth of a second's lateness is then worth 3 cm.
WEAVE_M_S = 0.25
WEAVE_FRAMES = 480  # of a period


@dataclass(frozen=True)
class Case:
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


class Motion:
    """A reference for n robots that all look along x.

    Its poses may jump, while its twists remain those of the motion: what is added to a pose at once, no velocity leads
    to. Nobody knows of a jump beforehand, however far a controller looks ahead.

    Args:
        cases: of each robot.

    Attributes:
        jump: what is added to the poses of all frames from now on, (n, 3).
    """

    def __init__(self, cases: Sequence[Case]) -> None:
        self._drives = np.array([[float(case.drives)] for case in cases])
        self.jump = np.zeros((len(cases), 3))

    def of(self, rows: np.ndarray) -> "Part":
        """That of some of the robots."""
        return Part(self, rows)

    def way(self, frame: Array) -> Array:
        """How far driving has led robots by `frame` (..., m, 3), without a jump; the same shape, m and rad."""
        time, faster = PERIOD_S * np.maximum(frame, 0), SPEED_M_S / ACCELERATION_M_S2
        forward = SPEED_M_S * (np.minimum(time, faster) ** 2 / (2 * faster) + np.maximum(time - faster, 0))
        rate = 2 * math.pi / (PERIOD_S * WEAVE_FRAMES)
        woven = WEAVE_M_S / rate * (1 - np.cos(rate * time))
        return np.array([1.0, 0.0, 0.0]) * forward + np.array([1.0, 1.0, 0.0]) * woven


class Part:
    """The motion of some robots; a `Reference`."""

    def __init__(self, motion: Motion, rows: np.ndarray) -> None:
        self._motion, self._rows = motion, rows

    def at(self, frame: float | Array, pose: Array) -> tuple[Array, Array]:
        """See `Reference`."""
        poses, twists = self.preview(frame, pose, 1)
        return poses[0], twists[0]

    def preview(self, frame: float | Array, pose: Array, count: int) -> tuple[Array, Array]:
        """See `Reference`."""
        first = np.asarray(frame, float)
        first = first[:, None] if first.ndim == 1 else first
        start = np.broadcast_to(first, pose.shape) + np.arange(float(count))[:, None, None]
        drives, motion = self._motion._drives[self._rows], self._motion
        here, later = (drives * motion.way(frames) for frames in (start, start + 1))
        return here + motion.jump[self._rows], (later - here) / PERIOD_S

"""What a loop makes of a reference that jumps: how fast, how far beyond, for how long."""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S

RISE = 0.1, 0.9  # of the step
WITHIN_M, WITHIN = 0.005, 0.02  # it has settled, coarsely; and finely, a share of the step
STEADY = FRAME_RATE_HZ // 2  # frames at the end whose mean is what it comes to


@dataclass(frozen=True)
class Step:
    """The figures of a step response; not a number for what does not happen while it is watched.

    Attributes:
        rise: from a tenth to nine tenths, s.
        overshoot: how far beyond, share of the step.
        within_5_mm, within_2_percent: time after which the error stays so small, s.
        left: error at the end, mean of the last half second, m.
    """

    rise: float
    overshoot: float
    within_5_mm: float
    within_2_percent: float
    left: float


def measure(moved: Array, step: float) -> Step:
    """Find them.

    Args:
        moved: way in answer to it in each frame, the first being that in which the reference jumps, (frames,) m.
        step: by which it jumps, m.
    """
    if not np.isfinite(moved).all():
        return Step(*[float("nan")] * 5)
    share, error = moved / step, np.abs(moved - step)
    start, end = (_reaches(share, each) for each in RISE)
    return Step(
        rise=end - start,
        overshoot=max(float(share.max()) - 1, 0.0),
        within_5_mm=_stays(error, WITHIN_M),
        within_2_percent=_stays(error, WITHIN * abs(step)),
        left=float(step - moved[-STEADY:].mean()),
    )


def _reaches(share: Array, level: float) -> float:
    """When it does first, between frames, s; the first frame is below."""
    above = np.flatnonzero(share >= level)
    if not above.size:
        return float("nan")
    after = int(above[0])
    return PERIOD_S * (after - float((share[after] - level) / (share[after] - share[after - 1]))) if after else 0.0


def _stays(error: Array, bound: float) -> float:
    """When it begins to stay within the bound, s."""
    beyond = np.flatnonzero(error > bound)
    after = int(beyond[-1]) + 1 if beyond.size else 0
    return PERIOD_S * after if after < len(error) else float("nan")

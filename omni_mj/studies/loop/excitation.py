"""What is added to commands to measure a loop: sines of many frequencies at once, each in whole periods."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.loop.motion import WEAVE_FRAMES

# Half a period of the weave: what its speeding up does to the first of two periods, its slowing down undoes in the
# second, and no other sine of the sum shows in its place.
PERIOD_FRAMES = WEAVE_FRAMES // 2
PERIODS = 2
TONES = np.array([1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24])  # sines: how often in a period
FREQUENCIES = 2 * np.pi * TONES / (PERIOD_FRAMES * PERIOD_S)  # rad/s: 1.6 to 38
RMS_M_S = 0.02  # of the sum


def multisine(seed: int, strength: int, frames: int) -> Array:
    """The sum, for a strength of one, the last of `frames` ending a period: (frames,), m/s.

    Args:
        seed: of the row.
        strength: 1, 2, ...: each has phases of its own, so that what one strength gets wrong another does otherwise.
        frames: how many.
    """
    phases = np.random.default_rng([seed, strength]).uniform(0, 2 * np.pi, len(TONES))
    turns = np.arange(-frames, 0)[:, None] * TONES / PERIOD_FRAMES
    total: Array = np.cos(2 * np.pi * turns + phases).sum(1)
    return RMS_M_S * np.sqrt(2 / len(TONES)) * total

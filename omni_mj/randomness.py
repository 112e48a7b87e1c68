"""Random numbers that depend on a robot's own seed only, not on the batch it runs in."""

from collections.abc import Callable
from enum import IntEnum

import numpy as np

from omni_control.kinematics import Array


class Stream(IntEnum):
    """What a seed's random numbers are for; each has its own independent stream."""

    VISION_NOISE = 0
    VISION_MISSES = 1
    ALPHA = 2
    DISTURBANCE = 3
    GYRO_BIAS = 4
    GYRO_NOISE = 5
    RADIO_JITTER = 6


def draw(seeds: list[int], stream: Stream, sample: Callable[[np.random.Generator], Array]) -> Array:
    """Draw `sample` (frames, k) once per distinct seed and return it per robot, (frames, n, k)."""
    tables = {seed: sample(np.random.default_rng([int(stream), seed])) for seed in set(seeds)}
    return np.stack([tables[seed] for seed in seeds], axis=1)

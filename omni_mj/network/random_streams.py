"""Streams of random numbers that depend only on a row's seed, not on the batch it runs in."""

from collections.abc import Sequence
from enum import IntEnum
from typing import Literal

import numpy as np

from omni_control.kinematics import Array

BLOCK_LENGTH = 256  # values drawn at a time; the numbers do not depend on it

Seed = tuple[int, ...]  # of a row, see `Row.noise_seed`


class Stream(IntEnum):
    """Purpose of random numbers. Each purpose has an independent stream per seed."""

    VISION_NOISE = 0
    VISION_MISSES = 1
    ALPHA = 2
    DISTURBANCE = 3
    GYRO_BIAS = 4
    GYRO_NOISE = 5
    RADIO_JITTER = 6
    VARIATION = 7
    RADIO_LOSSES = 8
    CAMERA_LOSSES = 9
    CAMERA_JITTER = 10
    CAMERA_CLOCK = 11
    RADIO_FAULTS = 12
    RADIO_BURSTS = 13
    CAMERA_FAULTS = 14
    CAMERA_LATE = 15
    ENCODER_FAULTS = 16
    RADIO_PHASE = 17
    RADIO_AIR = 18
    CAMERA_DROPOUTS = 19
    CAMERA_PROCESSING = 20
    CAMERA_CALIBRATION = 21


class Noise:
    """A stream of random numbers for each of n rows. Rows with the same seed get the same.

    Args:
        seeds: Seed of each row.
        stream: Purpose of the numbers.
        size: Number of values per row and step, k.
        distribution: Method of numpy's generator: uniform in [0, 1), or normal.
    """

    def __init__(
        self,
        seeds: Sequence[Seed],
        stream: Stream,
        size: int = 1,
        distribution: Literal["random", "standard_normal"] = "random",
    ) -> None:
        indices = {seed: index for index, seed in enumerate(dict.fromkeys(seeds))}
        self._generator_of_row = [indices[seed] for seed in seeds]
        self._generators = [np.random.default_rng([stream, *seed]) for seed in indices]
        self._size, self._distribution, self._position = size, distribution, BLOCK_LENGTH

    def next(self) -> Array:
        """Return the next values of each row, (n, k)."""
        if self._position == BLOCK_LENGTH:
            shape = BLOCK_LENGTH, self._size
            blocks = [getattr(rng, self._distribution)(shape) for rng in self._generators]
            self._block = np.stack([blocks[index] for index in self._generator_of_row], axis=1)
            self._position = 0
        self._position += 1
        return self._block[self._position - 1]


def continue_bursts(
    is_burst: bool | np.ndarray,
    mean_steps: float | Array,
    fraction: float | Array,
    uniform: float | Array,
) -> np.ndarray:
    """Return the next states of Markov chains with bursts of geometrically distributed lengths.

    This is the channel of Gilbert (1960) and Elliott (1963). With the probabilities of entry and
    exit per step, the mean length is 1 / exit, and the fraction is entry / (entry + exit).

    Args:
        is_burst: Whether each chain is in a burst.
        mean_steps: Mean length of a burst, steps.
        fraction: Fraction of the steps that are in bursts, in the long run.
        uniform: Random number of each chain, uniform in [0, 1).
    """
    exit_probability = 1 / mean_steps
    entry_probability = exit_probability * fraction / (1 - fraction)
    return np.where(is_burst, uniform >= exit_probability, uniform < entry_probability)

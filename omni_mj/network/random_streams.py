"""Streams of random numbers that depend only on a row's seed, not on the batch it runs in."""

from collections.abc import Callable, Sequence
from enum import IntEnum

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


class Noise:
    """A stream of random numbers for each of n rows. Rows with the same seed get the same.

    Args:
        seeds: Seed of each row.
        stream: Purpose of the numbers.
        sample: Draws `count` successive values (count, k) from a generator. Two draws must yield
            the same values as one draw of their total length.
    """

    def __init__(
        self,
        seeds: Sequence[Seed],
        stream: Stream,
        sample: Callable[[np.random.Generator, int], Array],
    ) -> None:
        indices = {seed: index for index, seed in enumerate(dict.fromkeys(seeds))}
        self._generator_of_row = [indices[seed] for seed in seeds]
        self._generators = [np.random.default_rng([int(stream), *seed]) for seed in indices]
        self._sample, self._position = sample, BLOCK_LENGTH

    def next(self) -> Array:
        """Return the next value of each row, (n, k)."""
        if self._position == BLOCK_LENGTH:
            blocks = [self._sample(rng, BLOCK_LENGTH) for rng in self._generators]
            self._block = np.stack([blocks[index] for index in self._generator_of_row], axis=1)
            self._position = 0
        self._position += 1
        return self._block[self._position - 1]


def make_uniform_noise(seeds: Sequence[Seed], stream: Stream, size: int = 1) -> Noise:
    """Return a stream of uniform numbers in [0, 1), `size` of them per row and step."""
    return Noise(seeds, stream, lambda rng, count: rng.random((count, size)))

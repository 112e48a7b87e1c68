"""Random numbers as long as asked, which depend on a row's own seed only, not on the batch it runs in."""

from collections.abc import Callable, Sequence
from enum import IntEnum

import numpy as np

from omni_control.kinematics import Array

BLOCK = 256  # drawn at a time; the numbers are the same whatever it is

Seed = tuple[int, ...]  # of a row; see `Row.noise_seed`


class Stream(IntEnum):
    """What a seed's random numbers are for; each has its own independent stream."""

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
    """A stream of random numbers for each of n rows; rows with the same seed get the same.

    Args:
        seeds: one per row.
        stream: what the numbers are for.
        sample: draws a number of successive values from a generator, (count, k); drawing twice must
            give what drawing once as many does.
    """

    def __init__(
        self,
        seeds: Sequence[Seed],
        stream: Stream,
        sample: Callable[[np.random.Generator, int], Array],
    ) -> None:
        numbers = {seed: number for number, seed in enumerate(dict.fromkeys(seeds))}
        self._rows = [numbers[seed] for seed in seeds]
        self._generators = [np.random.default_rng([int(stream), *seed]) for seed in numbers]
        self._sample, self._used = sample, BLOCK

    def next(self) -> Array:
        """The next value of each row, (n, k)."""
        if self._used == BLOCK:
            drawn = [self._sample(rng, BLOCK) for rng in self._generators]
            self._block, self._used = np.stack([drawn[number] for number in self._rows], axis=1), 0
        self._used += 1
        return self._block[self._used - 1]


def make_uniform_noise(seeds: Sequence[Seed], stream: Stream, count: int = 1) -> Noise:
    """Return the stream of so many numbers from 0 to 1 a time."""
    return Noise(seeds, stream, lambda rng, length: rng.random((length, count)))

"""Streams of noise: as long as asked, the same numbers as when drawn at once, a seed's own."""

import numpy as np
from numpy.typing import NDArray

from omni_mj.link.noise import BLOCK, Noise, Stream

FRAMES = 2 * BLOCK + 30


def drawn(seeds: list[tuple[int, ...]], stream: Stream = Stream.VISION_NOISE) -> NDArray:
    noise = Noise(seeds, stream, lambda rng, count: rng.standard_normal((count, 3)))
    return np.array([noise.next() for _ in range(FRAMES)])


def test_what_is_drawn_in_blocks_is_what_is_drawn_at_once() -> None:
    for stream in (Stream.VISION_NOISE, Stream.GYRO_NOISE):
        once = np.random.default_rng([int(stream), 7]).standard_normal((FRAMES, 3))
        np.testing.assert_array_equal(drawn([(7,)], stream)[:, 0], once)


def test_rows_of_one_seed_share_their_numbers_and_no_other_does() -> None:
    seeds = [(3,), (4,), (3,), (3, 1), (4, 1)]
    together = drawn(seeds)
    for row, seed in enumerate(seeds):
        np.testing.assert_array_equal(together[:, [row]], drawn([seed]))
    for other in (1, 3, 4):
        assert (together[:, 0] != together[:, other]).all()
    assert (drawn([(3,)]) != drawn([(3,)], Stream.GYRO_NOISE)).all()

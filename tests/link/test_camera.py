"""The camera: its noise and misses as statistics, its seeds, its headings."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from omni_mj.link.camera import Camera
from omni_mj.scenarios.settings import VisionSettings

FRAMES = 20_000
SIGMAS = 5  # of the estimate's own spread: a right camera fails one such test in 1.7 million
NOISY = VisionSettings(position_noise_m=0.0013, heading_noise_rad=0.01, miss_probability=0.0)
EXACT = VisionSettings(position_noise_m=0.0, heading_noise_rad=0.0, miss_probability=0.0)


def watch(
    vision: VisionSettings, seeds: list[int], frames: int, pose: NDArray | None = None
) -> tuple[NDArray, NDArray]:
    """What a camera sees of robots that stand still: poses (frames, n, 3) and whether (frames, n)."""
    camera = Camera([vision] * len(seeds), [(seed,) for seed in seeds])
    pose = np.zeros((len(seeds), 3)) if pose is None else pose
    measured, seen = zip(*(camera(pose) for _ in range(frames)), strict=True)
    return np.array(measured), np.array(seen)


@pytest.fixture(scope="module")
def noise() -> NDArray:
    """Noise of one robot, (frames, 3), in standard deviations."""
    measured, _ = watch(NOISY, [0], FRAMES)
    return measured[:, 0] / [0.0013, 0.0013, 0.01]


def test_noise_has_the_mean_and_deviation_asked_for(noise: NDArray) -> None:
    # Spread of the mean of n normal numbers: 1 / sqrt(n); of their standard deviation: 1 / sqrt(2 n).
    np.testing.assert_allclose(noise.mean(0), 0.0, atol=SIGMAS / math.sqrt(FRAMES))
    np.testing.assert_allclose(noise.std(0), 1.0, atol=SIGMAS / math.sqrt(2 * FRAMES))


def test_noise_is_normal(noise: NDArray) -> None:
    for axis in noise.T:
        # Kolmogorov-Smirnov against the standard normal; the level is that of five sigmas.
        assert stats.kstest(axis, "norm").pvalue > 6e-7


def test_noise_is_white_and_independent_per_axis(noise: NDArray) -> None:
    # The correlation of independent samples spreads by 1 / sqrt(n).
    bound = SIGMAS / math.sqrt(FRAMES)
    for lag in (1, 2, 10):
        assert np.abs((noise[lag:] * noise[:-lag]).mean(0)).max() < bound
    assert np.abs(np.corrcoef(noise.T)[np.triu_indices(3, 1)]).max() < bound


def side_by_side(visions: list[VisionSettings]) -> tuple[NDArray, NDArray]:
    """What one camera sees of robots that are seen differently, all with the same seed."""
    camera = Camera(visions, [(3,)] * len(visions))
    measured, seen = zip(*(camera(np.zeros((len(visions), 3))) for _ in range(FRAMES)), strict=True)
    return np.array(measured), np.array(seen)


def test_misses_happen_as_often_as_asked_for() -> None:
    probabilities = [0.0, 0.02, 0.3, 0.9]
    measured, seen = side_by_side([VisionSettings(miss_probability=p) for p in probabilities])
    for row, probability in enumerate(probabilities):
        # A binomial share spreads by sqrt(p (1 - p) / n); the first frame is always seen, 1 / n of them all.
        spread = math.sqrt(probability * (1 - probability) / FRAMES)
        assert 1 - seen[:, row].mean() == pytest.approx(probability, abs=SIGMAS * spread + 1 / FRAMES)
    assert np.isnan(measured[~seen]).all()
    assert np.isfinite(measured[seen]).all()


def test_every_robot_is_seen_in_the_first_frame() -> None:
    _, seen = watch(VisionSettings(miss_probability=0.9), list(range(50)), 1)
    assert seen.all()


def test_gaps_are_as_long_as_asked_for_unless_they_overlap() -> None:
    """A gap of `miss_frames` begins wherever a camera of single misses misses: with others it makes one longer gap."""
    lengths = [1, 2, 10, 60]
    measured, seen = side_by_side([VisionSettings(miss_probability=0.02, miss_frames=length) for length in lengths])
    single = seen[:, 0]
    for row, length in enumerate(lengths):
        expected = np.array([single[max(0, k - length + 1) : k + 1].all() for k in range(FRAMES)])
        np.testing.assert_array_equal(seen[:, row], expected)
    assert np.isnan(measured[~seen]).all()
    assert np.isfinite(measured[seen]).all()


def test_longer_gaps_hide_the_share_that_they_should() -> None:
    """Seen are the frames in which, and in the `miss_frames` - 1 before which, no gap began: (1 - p)^miss_frames."""
    cases = [(0.002, 10), (0.02, 10), (0.3, 3), (0.001, 60)]
    _, seen = side_by_side([VisionSettings(miss_probability=p, miss_frames=length) for p, length in cases])
    for row, (probability, length) in enumerate(cases):
        # Frames within two lengths of each other are related: there are at least n / (2 miss_frames) independent ones.
        share = (1 - probability) ** length
        spread = math.sqrt(share * (1 - share) * 2 * length / FRAMES)
        assert seen[:, row].mean() == pytest.approx(share, abs=SIGMAS * spread)


def test_every_robot_is_seen_in_the_first_frame_however_long_its_gaps_are() -> None:
    """Also of a gap longer than the run, which may begin in any frame but the first."""
    _, seen = watch(VisionSettings(miss_probability=0.05, miss_frames=600), list(range(50)), 60)
    assert seen[0].all()
    assert (np.diff(seen.astype(int), axis=0) <= 0).all()  # no gap ends within the run
    assert not seen[-1].all()


def test_misses_do_not_change_the_noise() -> None:
    always, _ = watch(VisionSettings(miss_probability=0.0), [5], 200)
    sometimes, seen = watch(VisionSettings(miss_probability=0.5), [5], 200)
    np.testing.assert_array_equal(sometimes[seen], always[seen])


def test_noise_depends_on_the_robots_own_seed_only() -> None:
    batch, _ = watch(NOISY, [7, 8, 7], 50)
    alone, _ = watch(NOISY, [7], 50)
    np.testing.assert_array_equal(batch[:, [0]], alone)
    np.testing.assert_array_equal(batch[:, [2]], alone)  # same seed, same noise
    assert (batch[:, 1] != batch[:, 0]).all()


def test_neighbouring_seeds_are_unrelated() -> None:
    measured, _ = watch(NOISY, list(range(10)), 4000)
    related = np.corrcoef(measured[:, :, 0].T)[np.triu_indices(10, 1)]
    assert np.abs(related).max() < SIGMAS / math.sqrt(4000)  # spread of the correlation of independent samples


def test_a_longer_run_begins_like_a_shorter_one() -> None:
    vision = VisionSettings(miss_probability=0.2)
    short, long = watch(vision, [1, 2], 40)[0], watch(vision, [1, 2], 90)[0]
    np.testing.assert_array_equal(short, long[:40])


@hypothesis_settings(deadline=None, max_examples=60, derandomize=True)
@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(-100, 100))
def test_a_perfect_camera_shows_the_pose_with_its_heading_wrapped(x: float, y: float, heading: float) -> None:
    pose = np.array([[x, y, heading]])
    (measured,), (seen,) = watch(EXACT, [0], 1, pose)
    assert seen.all()
    assert measured[0, :2].tolist() == [x, y]
    # Rounding of the turns taken off: 100 rad have 1.4e-14 between neighbouring numbers.
    assert -math.pi - 1e-13 <= measured[0, 2] <= math.pi + 1e-13
    assert math.remainder(measured[0, 2] - heading, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_array_equal(pose, [[x, y, heading]])  # the truth is only looked at


def test_noise_cannot_push_a_heading_past_half_a_turn() -> None:
    measured, _ = watch(NOISY, [0], 500, np.array([[0.0, 0.0, math.pi]]))
    headings = measured[:, 0, 2]
    assert np.abs(headings).max() <= math.pi
    # Half of the noise goes either way: both ends of the range occur (all 500 on one side: probability 2^-499).
    assert headings.min() < -3
    assert headings.max() > 3

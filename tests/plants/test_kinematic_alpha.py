"""The law of alpha on the kinematic plant: uniform within its bounds, with the memory asked for."""

import math

import numpy as np
import pytest
from benches.plant import FRAME_S, SIGMAS, rows, with_settings
from numpy.typing import NDArray
from scipy import stats

from omni_mj.config.settings import Settings
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.kinematic import KinematicPlant


def alphas(settings: list[Settings], seeds: list[int], frames: int) -> NDArray:
    """Alpha (frames, n, 3) to the last bit: the twist of robots that are told to move at 1."""
    n = len(seeds)
    plant = KinematicPlant(rows(settings, seeds), np.zeros((n, 3)))
    result = np.empty((frames, n, 3))
    for frame in range(frames):
        plant.advance(ReceivedCommand.without_delay(np.ones((n, 3))))
        result[frame] = plant.twist()
    return result


def remembering(time_s: float, **bounds: float) -> Settings:
    return with_settings(kinematic={"alpha_correlation_time_s": time_s, **bounds})


@pytest.mark.parametrize("time_s", [0.1, 10.0])
def test_a_remembering_alpha_is_uniform_in_every_frame_and_forgets_exponentially(
    time_s: float,
) -> None:
    seeds, frames, lag = list(range(1500)), 9, 4
    alpha = alphas([remembering(time_s)] * len(seeds), seeds, frames)
    first, later = alpha[0], alpha[lag]
    for sample in (first, later, alpha[-1]):
        # Independent over seeds and axes. Kolmogorov-Smirnov; the level is that of five sigmas.
        assert stats.kstest(sample.ravel(), stats.uniform(0.7, 0.3).cdf).pvalue > 6e-7
    # Two normal numbers with correlation r have quantiles with correlation 6/pi asin(r/2) (Pearson,
    # 1907), and those of a first-order process r = exp(-t / time). A sample's correlation spreads
    # by less than 1 / sqrt(samples).
    expected = 6 / math.pi * math.asin(math.exp(-lag * FRAME_S / time_s) / 2)
    measured = np.corrcoef(first.ravel(), later.ravel())[0, 1]
    assert measured == pytest.approx(expected, abs=SIGMAS / math.sqrt(first.size))
    across = np.corrcoef(first.T)[np.triu_indices(3, 1)]
    assert np.abs(across).max() < SIGMAS / math.sqrt(len(seeds))


def test_an_alpha_that_never_forgets_is_one_constant_per_seed_and_axis() -> None:
    alpha = alphas([remembering(1e6)] * 3, [1, 2, 3], 60)
    # Over the second the normal numbers wander by sqrt(2 t / time) = 1.4e-3 (one sigma), alpha by
    # less than 0.3 / 2.5 of that.
    assert np.ptp(alpha, axis=0).max() < SIGMAS * 1.4e-3 * 0.3 / 2.5
    assert np.ptp(alpha[0], axis=0).min() > 0.01
    assert np.ptp(alpha[0], axis=1).min() > 0.01


def test_alpha_depends_on_the_seed_alone_whatever_the_batch_and_the_length() -> None:
    settings = [remembering(0.0), remembering(0.5), remembering(10.0), remembering(0.5)]
    seeds = [7, 8, 7, 8]
    together = alphas(settings, seeds, 50)
    np.testing.assert_array_equal(together[:, 1], together[:, 3])
    for row in range(3):
        alone = alphas([settings[row]], [seeds[row]], 80)
        np.testing.assert_array_equal(alone[:50, 0], together[:, row])
    assert (alphas([remembering(0.5)], [9], 50)[:, 0] != together[:, 1]).all()

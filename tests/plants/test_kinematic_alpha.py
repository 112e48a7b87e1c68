"""Alpha on the kinematic plant: uniform within its bounds, with the set correlation time."""

import math

import numpy as np
import pytest
from benches.plant import FRAME_S, SIGMAS, receive_at_once, rows, with_settings
from numpy.typing import NDArray
from scipy import stats

from omni_mj.config.settings import Settings
from omni_mj.plants.kinematic_plant import KinematicPlant


def alphas(settings: list[Settings], seeds: list[int], frames: int) -> NDArray:
    """Return alpha (frames, n, 3), which is the twist for commands of 1."""
    n = len(seeds)
    plant = KinematicPlant(rows(settings, seeds), np.zeros((n, 3)))
    result = np.empty((frames, n, 3))
    for frame in range(frames):
        plant.advance(receive_at_once(np.ones((n, 3))))
        result[frame] = plant.twist()
    return result


def correlated(time_s: float, **bounds: float) -> Settings:
    return with_settings(kinematic={"alpha_correlation_time_s": time_s, **bounds})


@pytest.mark.parametrize("time_s", [0.1, 10.0])
def test_a_correlated_alpha_is_uniform_in_every_frame_with_exponential_correlation(
    time_s: float,
) -> None:
    seeds, frames, lag = list(range(1500)), 9, 4
    alpha = alphas([correlated(time_s)] * len(seeds), seeds, frames)
    sample_0, sample_lag = alpha[0], alpha[lag]
    for sample in (sample_0, sample_lag, alpha[-1]):
        # Independent over seeds and axes. Kolmogorov-Smirnov; the level is that of five sigmas.
        assert stats.kstest(sample.ravel(), stats.uniform(0.7, 0.3).cdf).pvalue > 6e-7
    # Two normal numbers with correlation r have quantiles with correlation 6/pi asin(r/2) (Pearson,
    # 1907), and those of a first-order process r = exp(-t / time). A sample's correlation spreads
    # by less than 1 / sqrt(samples).
    expected = 6 / math.pi * math.asin(math.exp(-lag * FRAME_S / time_s) / 2)
    measured = np.corrcoef(sample_0.ravel(), sample_lag.ravel())[0, 1]
    assert measured == pytest.approx(expected, abs=SIGMAS / math.sqrt(sample_0.size))
    axis_correlation = np.corrcoef(sample_0.T)[np.triu_indices(3, 1)]
    assert np.abs(axis_correlation).max() < SIGMAS / math.sqrt(len(seeds))


def test_an_alpha_of_infinite_correlation_time_is_constant_per_seed_and_axis() -> None:
    alpha = alphas([correlated(1e6)] * 3, [1, 2, 3], 60)
    # Over the second the normal numbers wander by sqrt(2 t / time) = 1.4e-3 (one sigma), alpha by
    # less than 0.3 / 2.5 of that.
    assert np.ptp(alpha, axis=0).max() < SIGMAS * 1.4e-3 * 0.3 / 2.5
    assert np.ptp(alpha[0], axis=0).min() > 0.01
    assert np.ptp(alpha[0], axis=1).min() > 0.01


def test_alpha_depends_on_the_seed_only_and_not_on_batch_and_length() -> None:
    settings = [correlated(0.0), correlated(0.5), correlated(10.0), correlated(0.5)]
    seeds = [7, 8, 7, 8]
    batch = alphas(settings, seeds, 50)
    np.testing.assert_array_equal(batch[:, 1], batch[:, 3])
    for row in range(3):
        single = alphas([settings[row]], [seeds[row]], 80)
        np.testing.assert_array_equal(single[:50, 0], batch[:, row])
    assert (alphas([correlated(0.5)], [9], 50)[:, 0] != batch[:, 1]).all()

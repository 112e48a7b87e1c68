"""Statistics over seeds against scipy's own distributions."""

import math

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from omni_mj.measure.statistics import confidence, paired, spread


@settings(deadline=None, derandomize=True)
@given(
    arrays(float, array_shapes(min_dims=1, max_dims=3, min_side=2, max_side=9), elements=st.floats(-10, 10, width=32))
)
def test_confidence_is_the_interval_of_students_t(values: np.ndarray) -> None:
    """scipy.stats computes the same from its own distribution; a rounding error of 1e-9 of the values is allowed."""
    mean, half = confidence(values)
    n = values.shape[-1]
    wanted = scipy.stats.t.ppf(0.975, n - 1) * scipy.stats.sem(values, axis=-1)
    np.testing.assert_allclose(mean, values.sum(-1) / n, atol=1e-9)
    np.testing.assert_allclose(half, wanted, rtol=1e-9, atol=1e-9)


def test_confidence_covers_the_true_mean_in_95_of_100_experiments() -> None:
    """Of 20000 experiments with five normal samples; the share's own standard deviation is 0.15 %, 5 of it allowed."""
    samples = np.random.default_rng(0).normal(3.0, 2.0, (20_000, 5))
    mean, half = confidence(samples)
    assert abs((np.abs(mean - 3.0) < half).mean() - 0.95) < 5 * math.sqrt(0.95 * 0.05 / 20_000)


def test_one_sample_has_a_mean_but_no_interval() -> None:
    mean, half = confidence(np.array([[2.0], [3.0]]))
    assert mean.tolist() == [2.0, 3.0]
    assert np.isnan(half).all()


def test_a_spread_leaves_out_what_is_unknown_and_counts_what_failed() -> None:
    """Unknown is not a number; what failed is without bound: a median stands one of three, a mean does not."""
    keys = "seeds", "median", "min", "max", "mean", "plus_minus"
    half = scipy.stats.t.ppf(0.975, 1) * scipy.stats.sem([1.0, 3.0])
    for given_values, wanted in {
        (1.0, math.nan, 3.0): ([1.0, None, 3.0], 2.0, 1.0, 3.0, 2.0, pytest.approx(half)),
        (1.0, math.inf, 3.0): ([1.0, None, 3.0], 3.0, 1.0, None, None, None),
        (1.0, math.inf): ([1.0, None], None, 1.0, None, None, None),
        (math.inf, math.inf): ([None, None], None, None, None, None, None),
        (2.0,): ([2.0], 2.0, 2.0, 2.0, 2.0, None),
        (math.nan,): ([None], None, None, None, None, None),
    }.items():
        assert spread(np.array(given_values)) == dict(zip(keys, wanted, strict=True)), given_values


def test_pairs_are_compared_seed_by_seed() -> None:
    """scipy's test of related samples gives the interval; it sees a shift that two separate intervals would hide."""
    theirs = np.array([0.010, 0.030, 0.050, 0.070])
    for shift in (0.0005, 0.003):
        ours = theirs - shift + 0.001 * np.array([0.4, -1.0, 0.7, -0.1])
        difference, half, beyond = paired(spread(ours), spread(theirs))
        assert difference is not None
        assert half is not None
        interval = scipy.stats.ttest_rel(ours, theirs).confidence_interval(0.95)
        assert (difference - half, difference + half) == pytest.approx(tuple(interval), abs=1e-12)
        assert beyond is bool(interval.high < 0) is (shift == 0.003)
    one = spread(np.array([1.0])), spread(np.array([3.0]))
    assert paired(*one) == (-2.0, None, None)
    failed = spread(np.array([1.0, math.inf])), spread(np.array([3.0, 4.0]))
    assert paired(*failed) == (None, None, None)

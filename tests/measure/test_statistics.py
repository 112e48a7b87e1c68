"""Statistics over seeds against scipy's own distributions."""

import math
from itertools import combinations

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from omni_mj.measure.statistics import confidence, holm, paired, precise, spread


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


def test_a_spread_counts_what_failed_or_never_settled() -> None:
    """Which is without bound: a median stands one of three, a mean does not. What is not a number is not known, and
    then nothing is: a mean of the others would be the survivors'."""
    keys = "seeds", "median", "min", "max", "mean", "plus_minus"
    half = scipy.stats.t.ppf(0.975, 1) * scipy.stats.sem([1.0, 3.0])
    for given_values, wanted in {
        (1.0, 3.0): ([1.0, 3.0], 2.0, 1.0, 3.0, 2.0, pytest.approx(half)),
        (1.0, math.nan, 3.0): ([1.0, None, 3.0], None, None, None, None, None),
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
        difference, half, p = paired(spread(ours), spread(theirs))
        assert difference is not None
        assert half is not None
        test = scipy.stats.ttest_rel(ours, theirs)
        interval = test.confidence_interval(0.95)
        assert (difference - half, difference + half) == pytest.approx(tuple(interval), abs=1e-12)
        assert p == pytest.approx(test.pvalue, rel=1e-9)
        assert (p < 0.05) is bool(interval.high < 0) is (shift == 0.003)
    one = spread(np.array([1.0])), spread(np.array([3.0]))
    assert paired(*one) == (-2.0, None, None)
    failed = spread(np.array([1.0, math.inf])), spread(np.array([3.0, 4.0]))
    assert paired(*failed) == (None, None, None)
    same, more = spread(np.array([1.0, 2.0])), spread(np.array([2.0, 3.0]))
    assert paired(same, same) == (0.0, 0.0, 1.0)
    assert paired(same, more) == (-1.0, 0.0, 0.0)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.lists(st.floats(0, 1), max_size=7))
def test_holm_is_the_closure_of_bonferroni(p: list[float]) -> None:
    """Of a closed test: one of several is rejected where every set it is in is, by the set's least p times its size."""
    sets = [each for size in range(1, len(p) + 1) for each in combinations(range(len(p)), size)]
    of_set = {each: min(1.0, len(each) * min(p[i] for i in each)) for each in sets}
    wanted = [max(value for each, value in of_set.items() if i in each) for i in range(len(p))]
    assert holm(np.array(p)).tolist() == pytest.approx(wanted, rel=1e-12)


def test_holm_lets_few_studies_of_equals_claim_anything() -> None:
    """Of 4000 studies of ten pairs of equals with ten seeds, 5 % have a claim if it is corrected (its own standard
    deviation is 0.35 %, 4 of it allowed), 40 % if it is not: 1 - 0.95^10."""
    differences = np.random.default_rng(3).normal(size=(4000, 10, 10))
    p = scipy.stats.ttest_1samp(differences, 0, axis=-1).pvalue
    claims = np.array([(holm(each) <= 0.05).any() for each in p])
    assert abs(claims.mean() - 0.05) < 4 * math.sqrt(0.05 * 0.95 / 4000)
    assert (p <= 0.05).any(-1).mean() == pytest.approx(1 - 0.95**10, abs=0.03)


def test_stopping_when_it_is_precise_enough_hardly_spoils_an_interval() -> None:
    """Of 3000 experiments with normal errors whose spread is a tenth of their mean, up to 20 seeds in blocks of 5, the
    worst that `precise` tells of: 92.5 % of the intervals hold the mean (standard deviation 0.5 %, 4 of it allowed)."""
    covered = []
    for values in np.random.default_rng(2).normal(1.0, 0.1, (3000, 20)):
        found = next(each for n in (5, 10, 15, 20) if precise([each := spread(values[:n])], 0.05) or n == 20)
        covered.append(abs(found["mean"] - 1.0) < found["plus_minus"])
    assert abs(np.mean(covered) - 0.925) < 4 * math.sqrt(0.925 * 0.075 / 3000)


def test_means_are_known_well_enough_when_the_widest_interval_is() -> None:
    """Half of it against the mean; zero is known, and what failed never will be."""
    wide, narrow = spread(np.array([1.0, 2.0, 3.0])), spread(np.array([2.0, 2.001, 2.002]))
    share = scipy.stats.t.ppf(0.975, 2) * scipy.stats.sem([1.0, 2.0, 3.0]) / 2.0
    for spreads, wanted in (([wide], share), ([wide, narrow], share), ([narrow], share * 0.001 * 2.0 / 2.001)):
        assert precise(spreads, wanted * 1.001)
        assert not precise(spreads, wanted * 0.999)
    assert precise([spread(np.zeros(3)), spread(np.array([1.0, math.inf]))], 0.0)
    assert not precise([spread(np.array([1.0]))], 1.0), "one seed says nothing of the others"

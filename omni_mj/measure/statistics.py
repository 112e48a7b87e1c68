"""Statistics over seeds: spreads, confidence intervals, paired differences, and many of these at once."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from omni_control.kinematics import Array

CONFIDENCE = 0.95
Spread = dict[str, Any]


def confidence(values: Array) -> tuple[Array, Array]:
    """Mean over the last axis, and half the width of its 95 % confidence interval by Student's t.

    Args:
        values: independent samples (..., samples), at least one.

    Returns:
        Two arrays (...); not a number for the half width of a single sample.
    """
    n = values.shape[-1]
    mean: Array = values.mean(-1)
    if n == 1:
        return mean, np.full_like(mean, np.nan)
    from scipy.special import stdtrit  # late: runs of one seed do without

    return mean, stdtrit(n - 1, (1 + CONFIDENCE) / 2) * values.std(-1, ddof=1) / np.sqrt(n)


def spread(values: Array) -> Spread:
    """Each seed's value, and median, least, greatest, mean and half the mean's interval (plus_minus).

    Args:
        values: (seeds,); infinite for a seed that failed or never settled, which all statistics count: of three such
            seeds two still have a median, but no mean. Not a number for a seed of which nothing is known: then nothing
            is known of all of them.

    Returns:
        Numbers, or None where there is none that is finite. One seed has no interval.
    """
    with np.errstate(invalid="ignore"):  # infinite less infinite
        mean, half = confidence(values)
        median = np.median(values)
    numbers = {"median": median, "min": values.min(), "max": values.max(), "mean": mean, "plus_minus": half}
    return {"seeds": [plain(value) for value in values]} | {name: plain(value) for name, value in numbers.items()}


def paired(ours: Spread, theirs: Spread) -> tuple[float | None, float | None, float | None]:
    """How two controllers' errors differ seed by seed, which takes out what the seeds' noise does to both.

    Args:
        ours: spread of the one over the seeds.
        theirs: that of the other over the same seeds.

    Returns:
        The mean of ours less theirs, half its 95 % interval, and how probable a difference at least so large is where
        there is none but by chance (p, two-sided, by Student's t); None for what cannot be said, since a seed has no
        value or is the only one.
    """
    if None in ours["seeds"] or None in theirs["seeds"]:
        return None, None, None
    difference = np.array(ours["seeds"]) - np.array(theirs["seeds"])
    mean, half = (float(value) for value in confidence(difference))
    if len(difference) == 1:
        return mean, None, None
    if half == 0:  # the same in every seed
        return mean, 0.0, float(mean == 0)
    from scipy.stats import ttest_1samp

    return mean, half, float(ttest_1samp(difference, 0.0).pvalue)


def holm(p: Array) -> Array:
    """Holm's p, adjusted for their number: those at most 5 % are, but for 5 % of all studies, all no chance.

    S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6, 1979. It
    needs no independence of the tests, which here share seeds and a subject.

    Args:
        p: of m tests, (m,).

    Returns:
        (m,): the least times m, the next times m - 1 and so on, none less than the one before it, nor above 1.
    """
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(np.arange(len(p), 0, -1) * p[order]), 1.0)
    return adjusted


def precise(spreads: Iterable[Spread], share: float) -> bool:
    """Whether half the interval of each mean is at most a share of the mean, leaving out those that have no mean.

    Seeds that are added until this is so make intervals a little too narrow: of normal errors whose spread is 2 to 30 %
    of their mean, with blocks of 5 up to 20 seeds and a share of 5 %, the nominal 95 % cover the truth in 92.5 to 95 %
    of all studies, and two equals are told apart in 5 to 6 % in place of 5 %.
    """
    known = [each for each in spreads if each["mean"] is not None]
    return all(each["plus_minus"] is not None and each["plus_minus"] <= share * abs(each["mean"]) for each in known)


def plain(value: Any) -> float | None:
    """A number as JSON has it: None for one that is not finite."""
    return float(value) if np.isfinite(value) else None

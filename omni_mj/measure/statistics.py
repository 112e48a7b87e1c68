"""Statistics over seeds: spreads, confidence intervals, paired differences."""

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
    from scipy.special import stdtrit

    n = values.shape[-1]
    mean: Array = values.mean(-1)
    if n == 1:
        return mean, np.full_like(mean, np.nan)
    return mean, stdtrit(n - 1, (1 + CONFIDENCE) / 2) * values.std(-1, ddof=1) / np.sqrt(n)


def spread(values: Array) -> Spread:
    """Each seed's value, and median, least, greatest, mean and half the mean's interval (plus_minus).

    Args:
        values: (seeds,); not a number for a seed that has none, which the statistics leave out, and infinite for one
            that failed, which they count: three seeds of which one failed still have a median, but no mean.

    Returns:
        Numbers, or None where there is none that is finite. One seed has no interval.
    """
    known = values[~np.isnan(values)]
    found: dict[str, Any] = {"seeds": [plain(value) for value in values]}
    if not known.size:
        return found | dict.fromkeys(("median", "min", "max", "mean", "plus_minus"))
    # Infinite values make the half width infinite or not a number: neither is one.
    with np.errstate(invalid="ignore"):
        mean, half = confidence(known)
        median = np.median(known)
    numbers = {"median": median, "min": known.min(), "max": known.max(), "mean": mean, "plus_minus": half}
    return found | {name: plain(value) for name, value in numbers.items()}


def paired(ours: Spread, theirs: Spread) -> tuple[float | None, float | None, bool | None]:
    """How two controllers' errors differ seed by seed, which takes out what the seeds' noise does to both.

    Args:
        ours: spread of the one over the seeds.
        theirs: that of the other over the same seeds.

    Returns:
        The mean of ours less theirs, half its 95 % interval, and whether that leaves out zero; None for what cannot be
        said, since a seed has no value or is the only one.
    """
    if None in ours["seeds"] or None in theirs["seeds"]:
        return None, None, None
    difference, half = confidence(np.array(ours["seeds"]) - np.array(theirs["seeds"]))
    if np.isnan(half):
        return float(difference), None, None
    return float(difference), float(half), bool(abs(difference) > half)


def plain(value: Any) -> float | None:
    """A number as JSON has it: None for one that is not finite."""
    return float(value) if np.isfinite(value) else None

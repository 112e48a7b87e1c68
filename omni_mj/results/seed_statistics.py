"""Statistics over seeds: median, extremes, mean and confidence interval of a metric."""

from typing import Any

import numpy as np

from omni_control.kinematics import Array

CONFIDENCE = 0.95
SeedStatistics = dict[str, Any]  # result of `seed_statistics`


def confidence_interval(values: Array) -> tuple[Array, Array]:
    """Return the mean over the last axis, and half the width of its 95 % confidence interval.

    The interval follows from Student's t distribution.

    Args:
        values: Independent samples, shape (..., samples), at least one.

    Returns:
        Two arrays of shape (...). The half width of a single sample is NaN.
    """
    n = values.shape[-1]
    mean: Array = values.mean(-1)
    if n == 1:
        return mean, np.full_like(mean, np.nan)
    from scipy.special import stdtrit  # imported here, because runs of one seed do not need it

    return mean, stdtrit(n - 1, (1 + CONFIDENCE) / 2) * values.std(-1, ddof=1) / np.sqrt(n)


def seed_statistics(values: Array) -> SeedStatistics:
    """Return each seed's value, and statistics over the seeds.

    Args:
        values: Shape (seeds,). Infinite for a seed that failed or never settled: three seeds with
            one such value have a median but no mean. With a seed that has NaN, all statistics are
            None.

    Returns:
        `per_seed`, `median`, `min`, `max`, `mean`, `ci95_half_width`. Numbers that are not finite
            are None, and so is the interval of a single seed.
    """
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        mean, half_width = confidence_interval(values)
        median = np.median(values)
    statistics = {
        "median": median,
        "min": values.min(),
        "max": values.max(),
        "mean": mean,
        "ci95_half_width": half_width,
    }
    per_seed = [finite_or_none(value) for value in values]
    return {"per_seed": per_seed} | {
        name: finite_or_none(value) for name, value in statistics.items()
    }


def finite_or_none(value: Any) -> float | None:
    """Return a number as float, or None if it is not finite, for JSON."""
    return float(value) if np.isfinite(value) else None

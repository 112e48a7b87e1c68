"""Statistics over seeds: median, extremes, mean and confidence interval of a metric."""

from typing import Any

import numpy as np

from omni_control.kinematics import Array

CONFIDENCE = 0.95
SeedStatistics = dict[str, Any]  # result of `summarize_seeds`


def mean_confidence_interval(values: Array) -> tuple[Array, Array]:
    """Return the mean over the last axis, and half the width of its 95 % confidence interval.

    The interval follows from Student's t distribution.

    Args:
        values: Independent samples, shape (..., samples), at least one.

    Returns:
        Two arrays of shape (...). The half width of a single sample is NaN.
    """
    n = values.shape[-1]
    mean = values.mean(-1)
    if n == 1:
        return mean, np.full_like(mean, np.nan)
    from scipy.special import stdtrit  # imported here, because runs of one seed do not need it

    return mean, stdtrit(n - 1, (1 + CONFIDENCE) / 2) * values.std(-1, ddof=1) / np.sqrt(n)


def summarize_seeds(values: Array) -> SeedStatistics:
    """Return the value of each seed, and statistics over the seeds.

    Args:
        values: Shape (seeds,). Infinite for a seed that failed or never settled: three seeds with
            one such value have a median but no mean. If a seed has NaN, all statistics are None.

    Returns:
        `per_seed`, `median`, `min`, `max`, `mean`, `ci95_half_width`. Numbers that are not finite
            are None, and so is the interval of a single seed.
    """
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        mean, half_width = mean_confidence_interval(values)
        statistics = {
            "median": np.median(values),
            "min": values.min(),
            "max": values.max(),
            "mean": mean,
            "ci95_half_width": half_width,
        }
    return {
        "per_seed": list(map(finite_or_none, values)),
        **{name: finite_or_none(value) for name, value in statistics.items()},
    }


def finite_or_none(value: Any) -> float | None:
    """Return a number as float, or None if it is not finite, for JSON."""
    return float(value) if np.isfinite(value) else None

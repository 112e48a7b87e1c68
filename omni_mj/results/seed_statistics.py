"""Statistics over seeds: median, extremes, mean and confidence interval of a metric."""

from collections.abc import Mapping
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
        median = np.median(values)
    return finite_or_none(
        {
            "per_seed": values,
            "median": median,
            "min": values.min(),
            "max": values.max(),
            "mean": mean,
            "ci95_half_width": half_width,
        }
    )


def finite_or_none(values: Any) -> Any:
    """Return numbers as plain values for JSON, with None in place of those that are not finite.

    Args:
        values: A number, an array, or a mapping to numbers and arrays.

    Returns:
        A float, a nested list, or a dictionary.
    """
    if isinstance(values, Mapping):
        return {name: finite_or_none(value) for name, value in values.items()}
    if np.ndim(values):
        return [finite_or_none(value) for value in values]
    return float(values) if np.isfinite(values) else None

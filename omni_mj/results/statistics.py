"""Statistics over seeds: means, confidence intervals, paired tests, verdicts on a controller."""

from collections.abc import Collection, Mapping
from math import inf
from typing import Any

import numpy as np

from omni_control.kinematics import Array

CONFIDENCE = 0.95
SIGNIFICANCE_LEVEL = 1 - CONFIDENCE
# Statistics of the position error that verdicts are about.
STATISTIC_LABELS = {"max": "maximum", "mean": "mean"}
SeedStatistics = dict[str, Any]
Results = Mapping[str, Any]  # controller -> its results in a summary
Entry = Mapping[str, Any]  # of one scenario in a summary

DEFINITIONS = {
    "verdict": (
        "Comparison of the subject's position error, mean over the seeds, with that of every other"
        " controller that is not privileged. A controller with a failed seed has no mean, and is"
        " worse than all that have one"
    ),
    "p": (
        "Two-sided p-value of Student's paired t-test: each seed's noise is the same for all"
        " controllers, so that two are compared by their differences seed by seed."
        f" ci95_half_width_m is half the width of the {100 * CONFIDENCE:g} % interval of the mean"
        " difference. Neither is corrected for the number of verdicts. A single seed or a failed"
        " seed gives none"
    ),
    "p_adjusted": (
        "p by Holm's method over all verdicts that have one: all completed scenarios, all"
        " competitors, maximum and mean error. significant: whether it is at most"
        f" {100 * SIGNIFICANCE_LEVEL:g} %, which limits the probability that any significant"
        " difference is due to chance"
    ),
    "privileged": (
        "Controller that is given the true state in place of vision. It does not compete, and its"
        " error is no bound for other controllers; omni-mj limit finds such a bound"
    ),
}


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
        values: Shape (seeds,). Infinite for a seed that failed or never settled: of three seeds
            with one such value, there is a median but no mean. NaN for a seed without a value,
            which leaves no statistics.

    Returns:
        `per_seed`, `median`, `min`, `max`, `mean`, `ci95_half_width`; None for values that are not
            finite. A single seed has no interval.
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
    """Return a number for JSON: None if it is not finite."""
    return float(value) if np.isfinite(value) else None


def paired_difference(
    ours: SeedStatistics, theirs: SeedStatistics
) -> tuple[float | None, float | None, float | None]:
    """Compare two controllers seed by seed, which removes the effect of the seeds' noise.

    Args:
        ours: Statistics of the first controller.
        theirs: Statistics of the second controller over the same seeds.

    Returns:
        Mean of ours minus theirs, half the width of its 95 % confidence interval, and the p-value
            of the paired t-test, two-sided. None for what is undefined, because a seed has no
            value or there is only one.
    """
    if None in ours["per_seed"] or None in theirs["per_seed"]:
        return None, None, None
    difference = np.array(ours["per_seed"]) - np.array(theirs["per_seed"])
    mean, half_width = (float(value) for value in confidence_interval(difference))
    if len(difference) == 1:
        return mean, None, None
    if half_width == 0:  # equal differences in all seeds
        return mean, 0.0, float(mean == 0)
    from scipy.stats import ttest_1samp

    return mean, half_width, float(ttest_1samp(difference, 0.0).pvalue)


def holm_adjusted(p: Array) -> Array:
    """Return p-values adjusted for the number of tests by Holm's method.

    S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of
    Statistics 6, 1979. The tests need not be independent. Here they share seeds and a subject.

    Args:
        p: p-values of m tests, shape (m,).

    Returns:
        Shape (m,): the smallest times m, the next times m - 1 and so on; each at least as large as
            the previous one, and at most 1.
    """
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(np.arange(len(p), 0, -1) * p[order]), 1.0)
    return adjusted


def mean_position_error(result: Mapping[str, Any], statistic: str) -> float:
    """Return a controller's position error, mean over the seeds, m; infinite if a seed failed.

    Args:
        result: Results of the controller in a summary.
        statistic: Statistic over the frames, "max" or "mean".
    """
    mean: float | None = result["error_m"]["position"][statistic]["mean"]
    return inf if mean is None else mean


def judge_subject(
    entries: Mapping[str, Entry], privileged: Collection[str], subject: str | None
) -> dict[str, dict[str, Any] | None]:
    """Compare the subject with every other competitor in every completed scenario.

    Args:
        entries: Scenario -> its entry in a summary.
        privileged: Controllers that do not compete.
        subject: Controller to judge.

    Returns:
        Scenario -> verdict, or None if the subject or all others were not run. A verdict has the
            keys `subject` and `errors`; the latter has the keys `max` and `mean`, each with
            `against` (competitor -> ratio, paired difference, p-values, significance),
            `best_competitor`, `beats` and `loses_to`. Equal errors count as a loss.
    """
    verdicts: dict[str, dict[str, Any] | None] = dict.fromkeys(entries)
    tests: list[dict[str, Any]] = []
    for name, entry in entries.items():
        results = entry["results"]
        competitors = [name for name in results if name != subject and name not in privileged]
        if subject in results and competitors and entry["status"] == "done":
            errors = {
                statistic: _judge_statistic(results, str(subject), competitors, statistic)
                for statistic in STATISTIC_LABELS
            }
            verdicts[name] = {"subject": subject, "errors": errors}
            comparisons = [
                comparison for error in errors.values() for comparison in error["against"].values()
            ]
            tests += [comparison for comparison in comparisons if comparison["p"] is not None]
    adjusted = holm_adjusted(np.array([test["p"] for test in tests]))
    for test, p in zip(tests, adjusted, strict=True):
        test |= {"p_adjusted": float(p), "significant": bool(p <= SIGNIFICANCE_LEVEL)}
    return verdicts


def _judge_statistic(
    results: Results, subject: str, competitors: list[str], statistic: str
) -> dict[str, Any]:
    """Return the verdict on one statistic, before the p-values are adjusted."""
    errors = {name: mean_position_error(results[name], statistic) for name in results}
    against = {}
    for competitor in competitors:
        ours, theirs = (
            results[name]["error_m"]["position"][statistic] for name in (subject, competitor)
        )
        difference, half_width, p = paired_difference(ours, theirs)
        has_ratio = 0 < errors[competitor] < inf
        against[competitor] = {
            "ratio": finite_or_none(errors[subject] / errors[competitor]) if has_ratio else None,
            "difference_m": difference,
            "ci95_half_width_m": half_width,
            "p": p,
            "p_adjusted": None,
            "significant": None,
        }
    finished = [competitor for competitor in competitors if errors[competitor] < inf]
    loses_to = [competitor for competitor in competitors if errors[competitor] <= errors[subject]]
    return {
        "against": against,
        "best_competitor": min(finished, key=errors.__getitem__, default=None),
        "beats": [competitor for competitor in competitors if competitor not in loses_to],
        "loses_to": loses_to,
    }

"""Paired comparison of controllers seed by seed: differences, t-tests, verdicts."""

from collections.abc import Collection, Mapping
from math import inf
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.results.seed_statistics import (
    CONFIDENCE,
    SeedStatistics,
    finite_or_none,
    mean_confidence_interval,
)

SIGNIFICANCE_LEVEL = 1 - CONFIDENCE
ROUNDING_M = 1e-9  # smaller errors are rounding, of which no percentage is computed
# Statistics of the position error that verdicts are about.
STATISTIC_LABELS = {"max": "maximum", "mean": "mean"}


def paired_difference(
    ours: SeedStatistics, theirs: SeedStatistics
) -> tuple[float | None, float | None, float | None]:
    """Compare two controllers seed by seed, which removes the effect of the seeds' noise.

    Args:
        ours: Statistics of the first controller.
        theirs: Statistics of the second controller over the same seeds.

    Returns:
        Mean of ours minus theirs, half the width of its 95 % confidence interval, and the two-sided
            p-value of the paired t-test. All are None if a seed has no value; the last two if
            there is only one seed.
    """
    if None in ours["per_seed"] or None in theirs["per_seed"]:
        return None, None, None
    difference = np.array(ours["per_seed"]) - np.array(theirs["per_seed"])
    mean, half_width = (float(value) for value in mean_confidence_interval(difference))
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
        Shape (m,): the smallest p-value times m, the next times m - 1 and so on. In this order
            each is at least as large as the previous one, and at most 1.
    """
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(np.arange(len(p), 0, -1) * p[order]), 1.0)
    return adjusted


def mean_position_error(result: Mapping[str, Any], statistic: str) -> float:
    """Return a controller's position error, m, mean over the seeds; infinite if a seed failed.

    Args:
        result: Results of the controller in a summary.
        statistic: Statistic over the frames, "max" or "mean".
    """
    mean: float | None = result["error_m"]["position"][statistic]["mean"]
    return inf if mean is None else mean


def judge_subject(
    entries: Mapping[str, Mapping[str, Any]], privileged: Collection[str], subject: str | None
) -> dict[str, dict[str, Any] | None]:
    """Compare the subject with every other competitor in every completed scenario.

    Args:
        entries: Scenario -> its entry in a summary.
        privileged: Controllers that do not compete.
        subject: Controller to judge.

    Returns:
        Scenario -> verdict, or None if the subject or all others were not run. A verdict has the
            keys `subject` and `errors`. The errors have the keys `max` and `mean`, each with
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
            tests += [
                comparison
                for error in errors.values()
                for comparison in error["against"].values()
                if comparison["p"] is not None
            ]
    adjusted = holm_adjusted(np.array([test["p"] for test in tests]))
    for test, p in zip(tests, adjusted, strict=True):
        test |= {"p_adjusted": float(p), "significant": bool(p <= SIGNIFICANCE_LEVEL)}
    return verdicts


def _judge_statistic(
    results: Mapping[str, Any], subject: str, competitors: list[str], statistic: str
) -> dict[str, Any]:
    """Return the verdict on one statistic, before the p-values are adjusted.

    Args:
        results: Controller -> its results in a summary.
        subject: Controller to judge.
        competitors: Controllers to compare it with.
        statistic: Statistic over the frames, "max" or "mean".
    """
    errors = {name: mean_position_error(results[name], statistic) for name in results}
    against = {}
    for competitor in competitors:
        ours, theirs = (
            results[name]["error_m"]["position"][statistic] for name in (subject, competitor)
        )
        difference, half_width, p = paired_difference(ours, theirs)
        has_ratio = ROUNDING_M < errors[competitor] < inf
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

"""Statistics over seeds: spreads, confidence intervals, paired differences, and verdicts on a controller."""

from collections.abc import Collection, Mapping
from math import inf
from typing import Any

import numpy as np

from omni_control.kinematics import Array

CONFIDENCE = 0.95
SIGNIFICANCE_LEVEL = 1 - CONFIDENCE
STATISTIC_LABELS = {
    "max": "maximum",
    "mean": "mean",
}  # of the error in the plane, by which verdicts are
SeedStatistics = dict[str, Any]
Results = Mapping[str, Any]
Entry = Mapping[str, Any]

DEFINITIONS = {
    "verdict": (
        "by the means over the seeds of the error in the plane, against every other controller that is not privileged; a"
        " controller of which a seed failed has no mean, and is behind all that have one"
    ),
    "p": (
        "each seed's noise is the same for all controllers, so that two of them are compared by their differences seed"
        " by seed: p is that of Student's test of the mean difference, two-sided, and ci95_half_width half its"
        f" {100 * CONFIDENCE:g} % interval, neither corrected for the number of verdicts; one seed, or one that failed,"
        " gives none"
    ),
    "p_adjusted": (
        "p by Holm's method over the family of all verdicts that have one: all scenarios that were done, all rivals,"
        " maximum and mean error. significant is whether it is at most"
        f" {100 * SIGNIFICANCE_LEVEL:g} %: so likely is it at most that any difference beyond chance is by chance after all"
    ),
    "privileged": (
        "a controller that is given the true state in place of vision: no competitor; what it reaches is no limit of"
        " what is possible, which omni-mj limit finds"
    ),
}


def confidence_interval(values: Array) -> tuple[Array, Array]:
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


def seed_statistics(values: Array) -> SeedStatistics:
    """Each seed's value, and median, least, greatest, mean and half the mean's interval (ci95_half_width).

    Args:
        values: (seeds,); infinite for a seed that failed or never settled, which all statistics
            count: of three such seeds two still have a median, but no mean. Not a number for a seed
            of which nothing is known: then nothing is known of all of them.

    Returns:
        Numbers, or None where there is none that is finite. One seed has no interval.
    """
    with np.errstate(invalid="ignore"):  # infinite less infinite
        mean, half = confidence_interval(values)
        median = np.median(values)
    numbers = {
        "median": median,
        "min": values.min(),
        "max": values.max(),
        "mean": mean,
        "ci95_half_width": half,
    }
    return {"per_seed": [finite_or_none(value) for value in values]} | {
        name: finite_or_none(value) for name, value in numbers.items()
    }


def finite_or_none(value: Any) -> float | None:
    """A number as JSON has it: None for one that is not finite."""
    return float(value) if np.isfinite(value) else None


def paired_difference(
    ours: SeedStatistics, theirs: SeedStatistics
) -> tuple[float | None, float | None, float | None]:
    """How two controllers' errors differ seed by seed, which takes out what the seeds' noise does to both.

    Args:
        ours: spread of the one over the seeds.
        theirs: that of the other over the same seeds.

    Returns:
        The mean of ours less theirs, half its 95 % interval, and how probable a difference at least
        so large is where there is none but by chance (p, two-sided, by Student's t); None for what
        cannot be said, since a seed has no value or is the only one.
    """
    if None in ours["per_seed"] or None in theirs["per_seed"]:
        return None, None, None
    difference = np.array(ours["per_seed"]) - np.array(theirs["per_seed"])
    mean, half = (float(value) for value in confidence_interval(difference))
    if len(difference) == 1:
        return mean, None, None
    if half == 0:  # the same in every seed
        return mean, 0.0, float(mean == 0)
    from scipy.stats import ttest_1samp

    return mean, half, float(ttest_1samp(difference, 0.0).pvalue)


def holm_adjusted(p: Array) -> Array:
    """Holm's p, adjusted for their number: those at most 5 % are, but for 5 % of all studies, all no chance.

    S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of
    Statistics 6, 1979. It needs no independence of the tests, which here share seeds and a subject.

    Args:
        p: of m tests, (m,).

    Returns:
        (m,): the least times m, the next times m - 1 and so on, none less than the one before it,
            nor above 1.
    """
    order = np.argsort(p, kind="stable")
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(np.arange(len(p), 0, -1) * p[order]), 1.0)
    return adjusted


def mean_position_error(result: Mapping[str, Any], statistic: str) -> float:
    """Return a controller's error in the plane, m, mean over the seeds; infinite if one of them failed."""
    mean: float | None = result["error_m"]["position"][statistic]["mean"]
    return inf if mean is None else mean


def judge_subject(
    entries: Mapping[str, Entry], privileged: Collection[str], subject: str | None
) -> dict[str, dict[str, Any] | None]:
    """How the subject fares against every other competitor, in every scenario that was run to its end.

    Args:
        entries: scenario -> its entry in a summary.
        privileged: controllers that are no competitors.
        subject: whose verdict is asked for, any controller's.

    Returns:
        Scenario -> verdict, None where the subject, or everybody else, was not run. Otherwise `of`,
        the subject, and `errors`, for max and mean each: `against` (other -> ratio, paired
        difference, its p, also adjusted for the number of all verdicts, and whether it is beyond
        chance), `best` (the best of the others), `beats` and `loses_to` (names; as good as is not
        beaten).
    """
    found: dict[str, dict[str, Any] | None] = dict.fromkeys(entries)
    pairs: list[dict[str, Any]] = []
    for name, entry in entries.items():
        results = entry["results"]
        rivals = [rival for rival in results if rival != subject and rival not in privileged]
        if subject in results and rivals and entry["status"] == "done":
            errors = {
                statistic: _judge(results, str(subject), rivals, statistic)
                for statistic in STATISTIC_LABELS
            }
            found[name] = {"subject": subject, "errors": errors}
            pairs += [
                pair
                for error in errors.values()
                for pair in error["against"].values()
                if pair["p"] is not None
            ]
    for pair, p in zip(pairs, holm_adjusted(np.array([pair["p"] for pair in pairs])), strict=True):
        pair |= {"p_adjusted": float(p), "significant": bool(p <= SIGNIFICANCE_LEVEL)}
    return found


def _judge(results: Results, subject: str, rivals: list[str], statistic: str) -> dict[str, Any]:
    """Return the verdict on the subject by one statistic, before the correction for the number of verdicts."""
    means, against = {name: mean_position_error(results[name], statistic) for name in results}, {}
    for rival in rivals:
        ours, theirs = (
            results[name]["error_m"]["position"][statistic] for name in (subject, rival)
        )
        difference, half, p = paired_difference(ours, theirs)
        ratio = finite_or_none(means[subject] / means[rival]) if 0 < means[rival] < inf else None
        against[rival] = {
            "ratio": ratio, "difference_m": difference, "ci95_half_width_m": half, "p": p, "p_adjusted": None,
            "significant": None,
        }  # fmt: skip
    lost = [rival for rival in rivals if means[rival] <= means[subject]]
    return {
        "against": against,
        "best_competitor": min(
            (rival for rival in rivals if means[rival] < inf), key=means.__getitem__, default=None
        ),
        "beats": [rival for rival in rivals if rival not in lost],
        "loses_to": lost,
    }

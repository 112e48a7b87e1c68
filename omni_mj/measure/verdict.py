"""Verdicts on one controller, the subject: whom it beats, whom it does not, and by how much."""

from collections.abc import Iterable, Mapping
from math import inf
from typing import Any

from omni_mj.measure.statistics import CONFIDENCE, Spread, paired

ERRORS = {"max": "maximum", "mean": "mean"}  # of the distance in the plane
Results = Mapping[str, Any]

DEFINITIONS = {
    "verdict": (
        "by the means over the seeds of the error in the plane, against every other controller that is no limit; a"
        " controller of which a seed failed has no mean, and is behind all that have one"
    ),
    "paired": (
        "each seed's noise is the same for all controllers, so that two of them are compared by their differences seed"
        f" by seed; within chance: the {100 * CONFIDENCE:g} % interval of the mean difference holds zero, or one seed"
        " gives no interval"
    ),
    "limit": "a controller that is given the true state: what could be reached at best, not a competitor",
}


def best(results: Results, names: Iterable[str], statistic: str) -> str | None:
    """Which of `names` has the lowest error in the plane, of those that have any; `statistic` is max or mean."""
    means = {name: mean(results[name], statistic) for name in names if name in results}
    return min((name for name in means if means[name] < inf), key=lambda name: means[name], default=None)


def error(result: Mapping[str, Any], statistic: str) -> Spread:
    """A controller's error in the plane over the seeds."""
    found: Spread = result["error_m"]["distance"][statistic]
    return found


def mean(result: Mapping[str, Any], statistic: str) -> float:
    """Mean over the seeds of the error in the plane, m; infinite where one of them failed."""
    value = error(result, statistic)["mean"]
    return inf if value is None else value


def verdict(results: Results, limits: Iterable[str], subject: str | None) -> dict[str, Any] | None:
    """How the subject fares against every other competitor.

    Args:
        results: of a scenario, as in a summary.
        limits: controllers that are no competitors.
        subject: whose verdict is asked for, any controller's.

    Returns:
        None where the subject, or everybody else, was not run. Otherwise `of`, the subject; `errors`, for max and mean
        each: `against` (other -> ratio, paired difference and whether it is beyond chance), `best` (the best of the
        others), `beats` and `loses_to` (names; as good as is not beaten); and `why_not`, a sentence for each error and
        competitor that is not beaten.
    """
    limits = list(limits)
    rivals = [name for name in results if name != subject and name not in limits]
    if subject not in results or not rivals:
        return None
    errors: dict[str, Any] = {}
    why_not = []
    for statistic in ERRORS:
        ours = mean(results[subject], statistic)
        against = {name: _pair(results[subject], results[name], statistic) for name in rivals}
        lost = [name for name in rivals if mean(results[name], statistic) <= ours]
        errors[statistic] = {
            "against": against,
            "best": best(results, rivals, statistic),
            "beats": [name for name in rivals if name not in lost],
            "loses_to": lost,
        }
        why_not += [_why_not(results, subject, name, statistic, against[name], limits) for name in lost]
    return {"of": subject, "errors": errors, "why_not": why_not}


def _pair(ours: Mapping[str, Any], theirs: Mapping[str, Any], statistic: str) -> dict[str, Any]:
    difference, half, beyond = paired(error(ours, statistic), error(theirs, statistic))
    a, b = mean(ours, statistic), mean(theirs, statistic)
    ratio = a / b if 0 < b < inf and a < inf else None
    return {"ratio": ratio, "difference_m": difference, "plus_minus_m": half, "beyond_chance": beyond}


def _why_not(
    results: Results, subject: str, rival: str, statistic: str, pair: Mapping[str, Any], limits: Iterable[str]
) -> str:
    """In words: by how much the rival is better, when the errors are greatest, and what could be reached at best."""
    ours, theirs = (_words(results[name], statistic) for name in (subject, rival))
    text = f"{ERRORS[statistic]} error {ours}, that of {rival} {theirs}"
    if pair["difference_m"] is not None and not pair["beyond_chance"]:
        text += ", a difference within chance"
    when, others = (results[name]["greatest_at_s"]["median"] for name in (subject, rival))
    known = mean(results[subject], statistic) < inf and mean(results[rival], statistic) < inf
    if statistic == "max" and known:
        text += f"; reached {when:.2f} s after the start, that of {rival} {others:.2f} s (median over the seeds)"
    for name in limits:
        if name in results:
            text += f"; {name}, a limit: {_words(results[name], statistic)}"
    return text


def _words(result: Mapping[str, Any], statistic: str) -> str:
    value = error(result, statistic)["mean"]
    seeds = len(error(result, statistic)["seeds"])
    return f"unknown ({result['failed']} of {seeds} failed)" if value is None else f"{100 * value:.2f} cm"

"""Verdicts on one controller, the subject: whom it beats, whom it does not, by how much, and whether by chance."""

from collections.abc import Iterable, Iterator, Mapping
from math import inf
from typing import Any

import numpy as np

from omni_mj.measure.statistics import CONFIDENCE, Spread, holm, paired

ERRORS = {"max": "maximum", "mean": "mean"}  # of the distance in the plane
CHANCE = 1 - CONFIDENCE
Results = Mapping[str, Any]
Entry = Mapping[str, Any]

DEFINITIONS = {
    "verdict": (
        "by the means over the seeds of the error in the plane, against every other controller that is not informed; a"
        " controller of which a seed failed has no mean, and is behind all that have one"
    ),
    "p": (
        "each seed's noise is the same for all controllers, so that two of them are compared by their differences seed"
        " by seed: p is that of Student's test of the mean difference, two-sided, and plus_minus half its"
        f" {100 * CONFIDENCE:g} % interval, neither corrected for the number of verdicts; one seed, or one that failed,"
        " gives none"
    ),
    "p_adjusted": (
        "p by Holm's method over the family of all verdicts that have one: all scenarios that were done, all rivals,"
        " maximum and mean error. beyond_chance is whether it is at most"
        f" {100 * CHANCE:g} %: so likely is it at most that any difference beyond chance is by chance after all"
    ),
    "informed": (
        "a controller that is given the true state in place of vision: no competitor; what it reaches is no limit of"
        " what is possible, which is given as limit where it is known"
    ),
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


def errors_of(results: Results, informed: Iterable[str]) -> list[Spread]:
    """The errors by which competitors are judged; those of the informed where there is nobody else."""
    names = [name for name in results if name not in set(informed)] or list(results)
    return [error(results[name], statistic) for name in names for statistic in ERRORS]


def verdicts(
    entries: Mapping[str, Entry], informed: Iterable[str], subject: str | None
) -> dict[str, dict[str, Any] | None]:
    """How the subject fares against every other competitor, in every scenario that was run to its end.

    Args:
        entries: scenario -> its entry in a summary.
        informed: controllers that are no competitors.
        subject: whose verdict is asked for, any controller's.

    Returns:
        Scenario -> verdict, None where the subject, or everybody else, was not run. Otherwise `of`, the subject;
        `errors`, for max and mean each: `against` (other -> ratio, paired difference, its p, also adjusted for the
        number of all verdicts, and whether it is beyond chance), `best` (the best of the others), `beats` and
        `loses_to` (names; as good as is not beaten); and `why_not`, a sentence for each error and competitor that is
        not beaten.
    """
    out_of_competition = {subject, *informed}
    found: dict[str, dict[str, Any] | None] = {}
    for name, entry in entries.items():
        results = entry["results"]
        rivals = [rival for rival in results if rival not in out_of_competition]
        found[name] = None
        if subject is not None and subject in results and rivals and entry["status"] == "done":
            errors = {statistic: _judged(results, subject, rivals, statistic) for statistic in ERRORS}
            found[name] = {"of": subject, "errors": errors}
    judged = {name: verdict for name, verdict in found.items() if verdict}
    pairs = [
        pair
        for verdict in judged.values()
        for error in verdict["errors"].values()
        for pair in error["against"].values()
        if pair["p"] is not None
    ]
    for pair, p in zip(pairs, holm(np.array([pair["p"] for pair in pairs])), strict=True):
        pair |= {"p_adjusted": float(p), "beyond_chance": bool(p <= CHANCE)}
    for name, verdict in judged.items():
        verdict["why_not"] = list(_why_not(entries[name]["results"], verdict))
    return found


def _judged(results: Results, subject: str, rivals: list[str], statistic: str) -> dict[str, Any]:
    """Return the verdict on the subject by one statistic, before the correction for the number of verdicts."""
    means, against = {name: mean(results[name], statistic) for name in results}, {}
    for rival in rivals:
        difference, half, p = paired(error(results[subject], statistic), error(results[rival], statistic))
        ratio = means[subject] / means[rival] if means[rival] else inf
        against[rival] = {
            "ratio": ratio if 0 < means[rival] < inf and ratio < inf else None,
            "difference_m": difference, "plus_minus_m": half, "p": p, "p_adjusted": None, "beyond_chance": None,
        }  # fmt: skip
    lost = [rival for rival in rivals if means[rival] <= means[subject]]
    return {
        "against": against,
        "best": best(results, rivals, statistic),
        "beats": [rival for rival in rivals if rival not in lost],
        "loses_to": lost,
    }


def _why_not(results: Results, verdict: Mapping[str, Any]) -> Iterator[str]:
    """Yield in words by how much each rival that is not beaten is better, and whether by chance."""
    for statistic, errors in verdict["errors"].items():
        for rival in errors["loses_to"]:
            ours, theirs = (_words(results[name], statistic) for name in (verdict["of"], rival))
            pair = errors["against"][rival]
            is_chance = pair["difference_m"] is not None and not pair["beyond_chance"]
            text = f"{ERRORS[statistic]} error {ours}, that of {rival} {theirs}"
            yield text + ", a difference within chance" * is_chance


def _words(result: Mapping[str, Any], statistic: str) -> str:
    value = error(result, statistic)
    if value["mean"] is None:
        return f"unknown ({result['failed']} of {len(value['seeds'])} failed)"
    return f"{100 * value['mean']:.2f} cm"

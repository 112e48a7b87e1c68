"""The numbers of `omni-mj compare`: what a scenario says of each controller, and of one against the others."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure import metrics
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.log import Trajectory

SUBJECT = "adaptive-comp-flc"
BASELINES = ("flc", "comp-flc", "p")  # which the subject shall beat
CONTENDERS = ("smith", "lqr")  # of which the better one's error it shall not exceed by more than MARGIN
MARGIN = 0.25
ERRORS = {"max": "maximum", "mean": "mean"}


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"


DEFINITIONS = {
    "error": (
        "distance in the plane (position), or along one axis (x, y), between the true pose and the timed reference,"
        " which is the same for all controllers; maximum and mean over all frames of a seed"
    ),
    "effort": (
        "root mean square over the frames of the change of the sent translational command per second, in m/s^2; what"
        " following the reference without any error needs is part of it"
    ),
    "settle": (
        "time from the end of the reference's last move until the position error stays below"
        f" {100 * metrics.SETTLED_M:g} cm to the end of the run; mean over the seeds that settle, 'not' if none does"
    ),
    "plus_minus": (
        f"half the {100 * metrics.CONFIDENCE:g} % confidence interval of the mean over the seeds, by Student's t; for"
        " one seed there is none"
    ),
    "paired": (
        "each seed's noise is the same for all controllers, so that two of them are compared by their differences seed"
        f" by seed; within chance: the {100 * metrics.CONFIDENCE:g} % interval of the mean difference holds zero, or"
        " one seed gives no interval"
    ),
    "beats": (
        f"{SUBJECT}'s error, by the means over the seeds, is below that of {_listed(BASELINES)}, or of those that were"
        " run"
    ),
    "within": (
        f"{SUBJECT}'s error, by the means over the seeds, is at most {100 * MARGIN:g} % above the lower of"
        f" {_listed(CONTENDERS)}, or of the one that was run"
    ),
    "limit": "a controller that is given the true state: what could be reached at best, not a competitor",
    "greatest_at": "time at which the maximum position error of a seed is reached",
}


def results(trajectory: Trajectory) -> dict[str, Any]:
    """Per controller its errors, effort and time to settle: each seed's, their mean, and half its interval."""
    along = metrics.absolute_errors(trajectory)
    position = metrics.position_errors(trajectory)
    errors = {"position": position} | {axis: along[..., j] for j, axis in enumerate(metrics.AXES)}
    effort = metrics.control_effort(trajectory.channel("command")[..., :2])
    settle = metrics.settling_times(trajectory.channel("ref")[:, 0, 0], position)
    greatest_at = position.argmax(0) * PERIOD_S
    return {
        controller: {
            "error_m": {
                name: {"max": _spread(error[:, i].max(0)), "mean": _spread(error[:, i].mean(0))}
                for name, error in errors.items()
            },
            "effort_m_s2": _spread(effort[i]),
            "settle_s": _spread(settle[i]),
            "greatest_at_s": _spread(greatest_at[i]),
        }
        for i, controller in enumerate(trajectory.controllers)
    }


def best(found: Mapping[str, Any], names: Iterable[str], statistic: str) -> str | None:
    """Who of `names` has the lowest error, if any of them was run; `statistic` is max or mean."""
    present = [name for name in names if name in found]
    return min(present, key=lambda name: _error(found[name], statistic)["mean"], default=None)


def verdict(found: Mapping[str, Any], limits: Iterable[str]) -> dict[str, Any] | None:
    """How the subject fares against baselines and contenders.

    Args:
        found: what `results` returned.
        limits: controllers that are no competitors.

    Returns:
        None where the subject, or everybody else, was not run. Otherwise `errors`, for max and mean each: `against`
        (other -> ratio, paired difference and whether it is beyond chance), `beats` (all baselines that were run, or
        None), `contender` (the better of them, or None) and `within` (None without one); and `why_not`, a sentence for
        each error and rival by which a goal was missed.
    """
    rivals = [name for name in (*BASELINES, *CONTENDERS) if name in found]
    if SUBJECT not in found or not rivals:
        return None
    errors: dict[str, Any] = {}
    why_not = []
    for statistic in ERRORS:
        against = {name: _pair(found[SUBJECT], found[name], statistic) for name in rivals}
        baselines = [name for name in BASELINES if name in against]
        contender = best(found, CONTENDERS, statistic)
        mean = {name: _error(found[name], statistic)["mean"] for name in (SUBJECT, *rivals)}
        lost = [name for name in baselines if mean[name] <= mean[SUBJECT]]
        within = mean[SUBJECT] <= (1 + MARGIN) * mean[contender] if contender else None
        errors[statistic] = {
            "against": against,
            "beats": not lost if baselines else None,
            "contender": contender,
            "within": within,
        }
        missed = lost + ([contender] if contender and not within else [])
        why_not += [_why_not(found, name, statistic, against[name], limits) for name in missed]
    return {"of": SUBJECT, "errors": errors, "why_not": why_not}


def _spread(values: Array) -> dict[str, Any]:
    """Each seed's value, with None for what is not a number, and mean and half interval of the others."""
    known = values[~np.isnan(values)]
    mean, half = metrics.confidence(known) if known.size else (np.nan, np.nan)
    return {"seeds": [_plain(v) for v in values], "mean": _plain(mean), "plus_minus": _plain(half)}


def _plain(value: Any) -> float | None:
    return None if np.isnan(value) else float(value)


def _error(result: Mapping[str, Any], statistic: str) -> dict[str, Any]:
    return result["error_m"]["position"][statistic]


def _pair(ours: Mapping[str, Any], theirs: Mapping[str, Any], statistic: str) -> dict[str, Any]:
    a, b = (_error(result, statistic) for result in (ours, theirs))
    difference, half = metrics.confidence(np.array(a["seeds"]) - np.array(b["seeds"]))
    return {
        "ratio": a["mean"] / b["mean"] if b["mean"] else None,
        "difference_m": float(difference),
        "plus_minus_m": _plain(half),
        "beyond_chance": None if np.isnan(half) else bool(abs(difference) > half),
    }


def _why_not(
    found: Mapping[str, Any], rival: str, statistic: str, pair: Mapping[str, Any], limits: Iterable[str]
) -> str:
    """In words: by how much the rival is better, when the errors are greatest, and what could be reached at best."""
    ours, theirs = (100 * _error(found[name], statistic)["mean"] for name in (SUBJECT, rival))
    text = f"{ERRORS[statistic]} error {ours:.2f} cm, that of {rival} {theirs:.2f} cm"
    if not pair["beyond_chance"]:
        text += ", a difference within chance"
    if statistic == "max":
        when, others = (float(np.median(found[name]["greatest_at_s"]["seeds"])) for name in (SUBJECT, rival))
        text += f"; reached {when:.2f} s after the start, that of {rival} {others:.2f} s (median over the seeds)"
    for name in limits:
        text += f"; {name}, a limit: {100 * _error(found[name], statistic)['mean']:.2f} cm"
    return text

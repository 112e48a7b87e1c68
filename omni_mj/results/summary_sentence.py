"""The result of a study in one sentence: which controller was best, by how much, and why.

The terminal and the report open with this sentence. It is computed from summary.json alone.
"""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from omni_mj.io.printable_text import format_count
from omni_mj.results.paired_comparison import ROUNDING_M, STATISTIC_LABELS, paired_difference

Results = Mapping[str, Mapping[str, Any]]  # controller -> its results in summary.json

# A component of the position error explains an error, or a difference of errors, if it has at least
# this fraction of its mean square. The mean squares of both components add up to that of the
# position error.
MAIN_FRACTION = 0.6
EXPLANATIONS = {
    "along_track": "by better timing: along-track error",
    "cross_track": "by keeping closer to the path: cross-track error",
}
LOCATIONS = {"along_track": "along the path", "cross_track": "across the path"}


def summary_sentence(summary: Mapping[str, Any]) -> str:
    """Return one sentence that says which controller was best, by how much, and why.

    Controllers are ranked by the mean position error, averaged over the seeds, and over several
    scenarios also by the maximum. A controller with a failed seed has no rank. Controllers that are
    given the true state do not compete.

    Args:
        summary: Content of summary.json, with one or several scenarios.

    Returns:
        The sentence with its full stop, or "" if no scenario has results.
    """
    scenarios = [
        _competitors(entry["results"], summary["privileged"])
        for entry in summary["scenarios"].values()
        if entry["results"]
    ]
    if not scenarios:
        return ""
    if len(scenarios) > 1:
        return _count_wins(scenarios)
    (results,) = scenarios
    ranking = _rank(results)
    failures = [
        f"{name} failed in {result['n_failed']} of {_count_seeds(result)}"
        for name, result in results.items()
        if result["n_failed"]
    ]
    if len(ranking) > 1:
        text = _compare_best(results, ranking[0], ranking[1])
    elif ranking:
        text = _describe_only(ranking[0], results[ranking[0]])
    else:
        text = "No controller finished all seeds"
    return "; ".join([text, *failures]) + "."


def _competitors(results: Results, privileged: list[str]) -> Results:
    """Return the results of the controllers that compete; of all if none does."""
    competing = {name: result for name, result in results.items() if name not in privileged}
    return competing or results


def _rank(results: Results, statistic: str = "mean") -> list[str]:
    """Return the controllers that finished all seeds, best first."""
    finished = [name for name, result in results.items() if not result["n_failed"]]
    return sorted(finished, key=lambda name: _error_m(results[name], statistic=statistic))


def _count_wins(scenarios: list[Results]) -> str:
    """Return in how many scenarios the most successful controller was best, by mean and maximum."""
    clauses = []
    for statistic, label in STATISTIC_LABELS.items():
        wins = Counter(name for results in scenarios for name in _rank(results, statistic)[:1])
        clauses += [
            f"{name} has the smallest {label} position error in {n_wins} of {len(scenarios)}"
            for name, n_wins in wins.most_common(1)
        ]
    if not clauses:
        return "No controller finished all seeds of a scenario."
    return "; ".join(clauses) + " scenarios (averages over the seeds)."


def _describe_only(name: str, result: Mapping[str, Any]) -> str:
    """Return the error of the only ranked controller, and its main component."""
    text = f"{name} follows the reference with a mean position error of {_cm(result)}"
    total = _error_m(result, statistic="rms") ** 2
    for axis, location in LOCATIONS.items():
        if total > 0 and _error_m(result, axis, "rms") ** 2 >= MAIN_FRACTION * total:
            return f"{text}, mainly {location}"
    return text


def _compare_best(results: Results, best: str, second: str) -> str:
    """Return by how much, and why, the best controller beats the second best."""
    ours, theirs = results[best], results[second]
    difference, half_width, _ = paired_difference(
        theirs["error_m"]["position"]["mean"], ours["error_m"]["position"]["mean"]
    )
    if difference is None or abs(difference) <= ROUNDING_M:
        return f"{best} and {second} have the same mean position error, {_cm(ours)}"
    if _error_cm(ours) == _error_cm(theirs):
        return f"{best} and {second} have almost the same mean position error, {_cm(ours)}"
    if half_width is not None and difference <= half_width:
        return (
            f"{best} ({_cm(ours)}) and {second} ({_cm(theirs)}) do not differ significantly in "
            f"mean position error over {_count_seeds(ours)}"
        )
    percent = 100 * difference / _error_m(theirs)
    text = (
        f"{best} is best: its mean position error of {_cm(ours)} is {percent:.0f} % below that of "
        f"{second}"
    )
    total = _error_m(theirs, statistic="rms") ** 2 - _error_m(ours, statistic="rms") ** 2
    for axis, explanation in EXPLANATIONS.items():
        gain = _error_m(theirs, axis, "rms") ** 2 - _error_m(ours, axis, "rms") ** 2
        # A component whose mean is printed as equal or larger explains nothing to a reader.
        is_smaller = _error_cm(ours, axis) < _error_cm(theirs, axis)
        if is_smaller and total > 0 and gain >= MAIN_FRACTION * total:
            return f"{text}, mainly {explanation} {_cm(ours, axis)} instead of {_cm(theirs, axis)}"
    return text


def _error_m(result: Mapping[str, Any], axis: str = "position", statistic: str = "mean") -> float:
    """Return an error, mean over the seeds, m."""
    return float(result["error_m"][axis][statistic]["mean"])


def _error_cm(result: Mapping[str, Any], axis: str = "position") -> float:
    """Return the mean error as it is printed, cm."""
    return round(100 * _error_m(result, axis), 2)


def _cm(result: Mapping[str, Any], axis: str = "position") -> str:
    """Return the mean error as text in centimeters."""
    return f"{_error_cm(result, axis):.2f} cm"


def _count_seeds(result: Mapping[str, Any]) -> str:
    """Return the number of seeds as text, such as "5 seeds"."""
    return format_count(len(result["settle_s"]["per_seed"]), "seed")

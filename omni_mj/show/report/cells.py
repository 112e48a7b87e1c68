"""What stands in a report's tables: numbers with units, changes, bars, what differs between runs."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omni_mj.measure import causes, limits
from omni_mj.show.report.reading import Run

STATISTICS = {"max": "Maximum error", "p99": "99th percentile of the error", "mean": "Mean error"}
MAIN = ("max", "mean")  # of which the paper reports, and verdicts are given
DASH, MINUS = "\N{EN DASH}", "\N{MINUS SIGN}"
UNITS = {"_v": "V", "_a": "A", "_c": "°C", "_w": "W", "_j": "J", "_s": "s", "_m": "m", "_m_s": "m/s", "_percent": "%"}


@dataclass(frozen=True)
class Axis:
    """A direction of errors: its name, how that is said after "error", where a result has them, the unit shown."""

    name: str
    phrase: str
    part: str
    unit: str
    factor: float


AXES = {
    "x": Axis("x", "in x", "error_m", "cm", 100.0),
    "y": Axis("y", "in y", "error_m", "cm", 100.0),
    "distance": Axis("in the plane", "in the plane", "error_m", "cm", 100.0),
    "along": Axis("along the path", "along the path", "error_m", "cm", 100.0),
    "across": Axis("across the path", "across the path", "error_m", "cm", 100.0),
    "heading": Axis("heading", "of heading", "error_rad", "deg", 180 / math.pi),
}


@dataclass(frozen=True)
class Cell:
    """One statistic of one controller along one axis.

    Attributes:
        axis: along which.
        statistic: its key in the summary.
        error: spread over the seeds, m or rad.
        share: the median as a share of the greatest that any controller has.
        reduction: in per cent, of this median against the first controller's; None for the first.
        paper, paper_reduction: the same in the paper, or None.
    """

    axis: Axis
    statistic: str
    error: dict[str, Any]
    share: float
    reduction: float | None
    paper: float | None
    paper_reduction: float | None


def errors(entry: Mapping[str, Any]) -> dict[str, dict[str, dict[str, Cell]]]:
    """Axis -> controller -> statistic -> cell, of a scenario's entry."""
    results, paper = entry["results"], entry["paper"] or {}
    axes = AXES if results else {}
    return {name: {c: {s: _cell(results, paper, c, name, s) for s in STATISTICS} for c in results} for name in axes}


def matrix(runs: Sequence[Run], statistic: str) -> tuple[list[str], list[tuple[Run, list[dict[str, Any] | None]]]]:
    """Errors in the plane: the controllers and known limits, and for each run their spreads, None for what it lacks."""
    names = list(dict.fromkeys(name for run in runs for name in run.entry["results"] or run.controllers))
    names += dict.fromkeys(name for run in runs for name in limits.of(run.entry))
    rows = []
    for run in runs:
        errors = {name: result["error_m"] for name, result in run.entry["results"].items()} | limits.of(run.entry)
        rows.append((run, [errors[name]["distance"][statistic] if name in errors else None for name in names]))
    return names, rows


def best(run: Run, statistic: str, axis: str = "distance") -> str | None:
    """The controller with the least mean of an error over the seeds, of those that do not know the truth."""
    part = AXES[axis].part
    means = {
        name: result[part][axis][statistic]["mean"]
        for name, result in run.entry["results"].items()
        if name not in run.informed
    }
    return min((name for name in means if means[name] is not None), key=lambda name: means[name], default=None)


def peaks(results: Mapping[str, Any]) -> dict[str, dict[str, float | None]]:
    """What a summary says of controllers' extremes, if anything, labelled with its unit -> controller -> value."""
    keys = [key for key in next(iter(results.values()), {}) if key.startswith("peak_")]
    found = {_with_unit(key): {name: result.get(key) for name, result in results.items()} for key in keys}
    return {label: values for label, values in found.items() if any(v is not None for v in values.values())}


def reasons(results: Mapping[str, Any]) -> dict[str, dict[str, float | None]]:
    """What a summary says of why controllers stray, as far as any is known: its name -> controller -> median."""
    found = {
        label: {name: result["why"][key]["median"] for name, result in results.items()}
        for key, label in causes.NAMES.items()
    }
    return {label: values for label, values in found.items() if any(v is not None for v in values.values())}


def differing(runs: Sequence[Run]) -> list[tuple[str, list[Any]]]:
    """The settings, robot and plant in which runs differ, with each one's value."""
    values = [
        {"plant": run.entry["plant"], "robot": run.entry["robot"]} | {s.name: s.value for s in run.settings}
        for run in runs
    ]
    names = dict.fromkeys(name for each in values for name in each)
    rows = [(name, [each.get(name) for each in values]) for name in names]
    return [(name, row) for name, row in rows if any(value != row[0] for value in row)]


def _cell(results: Mapping[str, Any], paper: Mapping[str, Any], controller: str, name: str, statistic: str) -> Cell:
    axis = AXES[name]
    spreads = {c: result[axis.part][name][statistic] for c, result in results.items()}
    greatest = max((spread["median"] for spread in spreads.values() if spread["median"] is not None), default=0.0)
    error = spreads[controller]
    reductions = results[controller]["reduction_percent"] or {}
    printed = {c: axes[name][statistic] for c, axes in paper.items() if statistic in axes.get(name, ())}
    base = next(iter(printed.values()), None)
    of_paper = printed.get(controller)
    first = next(iter(printed), None) == controller
    return Cell(
        axis,
        statistic,
        error,
        error["median"] / greatest if greatest and error["median"] is not None else 0.0,
        reductions.get(name, {}).get(statistic),
        of_paper,
        100 * (1 - of_paper / base) if of_paper is not None and base and not first else None,
    )


def _with_unit(key: str) -> str:
    suffix = max((s for s in UNITS if key.endswith(s)), key=len, default="")
    words = key.removesuffix(suffix).replace("_", " ")
    return f"{words.capitalize()} in {UNITS[suffix]}" if suffix else words.capitalize()


def number(value: float | None, digits: int = 2, factor: float = 1.0) -> str:
    """A number as text; a dash where there is none."""
    if value is None or math.isnan(value):
        return DASH
    return f"{factor * value:.{digits}f}".replace("-", MINUS)


def change(reduction_percent: float | None) -> str:
    """A reduction as the change it is: −35 %."""
    if reduction_percent is None or math.isnan(reduction_percent):
        return DASH
    return f"{-round(reduction_percent):+d} %".replace("-", MINUS).replace("+0", "0")


def plain(value: Any) -> str:
    """A setting's value as in a scenario file, but for the quotes of a string; a dash where a run has none."""
    return DASH if value is None else value if isinstance(value, str) else json.dumps(value)

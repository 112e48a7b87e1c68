"""Tables of results: errors and settling times, limits reached, recovery from faults."""

from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any

from omni_mj.results.metrics import EXCURSION, RECOVERED_M, RECOVERY, RECOVERY_WINDOW_S
from omni_mj.results.paired_comparison import ROUNDING_M
from omni_mj.results.saturation import DUTY, METRIC_LABELS
from omni_mj.results.seed_statistics import SeedStatistics
from omni_mj.results.text_table import (
    DASH,
    Table,
    drop_equal_columns,
    format_number,
)

PAPER_PREFIX = "paper's "  # before the names of controllers whose errors the paper reports
AXIS_COLUMNS = {  # axis -> heading, key in the summary, factor to the heading's unit
    "x": ("x, cm", "error_m", 100.0),
    "y": ("y, cm", "error_m", 100.0),
    "position": ("position, cm", "error_m", 100.0),
    "heading": ("heading, °", "error_rad", degrees(1)),
}
MIN_FRACTION = 0.05  # of the frames, from which on a limit is worth a table
Summary = Mapping[str, Any]  # content of summary.json


def results_table(summary: Summary, effort: bool = False, paper: bool = True) -> Table:
    """Return the errors and settling times of all controllers in all scenarios.

    Errors are "maximum/mean" over the frames, and medians over several seeds. Changes of the
    position error are relative to the first controller, the baseline. The paper's errors follow in
    rows of their own. Errors in x and y have columns only if the paper reports them. A column with
    equal values in all rows is left out, except for the position error.

    Args:
        summary: Content of summary.json.
        effort: Whether to add a column with the excess effort.
        paper: Whether to add the errors that the paper reports, and columns for x and y.
    """
    entries = {name: entry for name, entry in summary["scenarios"].items() if entry["results"]}
    several = len(summary["scenarios"]) > 1
    has_paper = paper and any(entry["paper"] for entry in entries.values())
    axes = [axis for axis in AXIS_COLUMNS if has_paper or axis not in ("x", "y")]
    headings = ["controller", *(AXIS_COLUMNS[axis][0] for axis in axes)]
    if effort:
        headings.append("excess effort, m/s²")
    headings += ["settled, s", "change, %"]
    n_columns = len(headings)
    if several:
        headings = ["scenario", *headings]
    rows = []
    for name, entry in entries.items():
        lines = list(_controller_rows(summary, entry, axes, effort))
        if has_paper:
            lines += _paper_rows(entry, axes)
        for i, line in enumerate(lines):
            line += [""] * (n_columns - len(line))
            rows.append(["" if i else name, *line] if several else line)
    name = "Controllers compared" if several else next(iter(summary["scenarios"]))
    plants = dict.fromkeys(describe_plant(entry) for entry in summary["scenarios"].values())
    title = f"{name}, {' and '.join(plants)}{describe_seeds(summary)}; maximum/mean errors"
    n_labels = 2 if several else 1
    position = AXIS_COLUMNS["position"][0]
    return drop_equal_columns(Table(title, headings, rows, n_labels), kept_headings=[position])


def saturation_table(summary: Summary) -> Table | None:
    """Return the position error of each controller, and how often it reached each limit.

    Returns:
        Table in % of the frames. None if limits were hardly reached, or if there are several
            scenarios.
    """
    entries = [entry for entry in summary["scenarios"].values() if entry["results"]]
    if len(entries) != 1:
        return None
    results = entries[0]["results"]
    largest = {
        name: max(result["saturation"][name]["median"] or 0.0 for result in results.values())
        for name in METRIC_LABELS
    }
    names = [name for name, fraction in largest.items() if fraction > 0]
    if max(largest[name] for name in METRIC_LABELS if name != DUTY) < MIN_FRACTION:
        return None
    rows = []
    for controller, result in results.items():
        percentages = [
            format_number(result["saturation"][name]["median"], 100, 1) for name in names
        ]
        error = _max_and_mean(result["error_m"]["position"], 100)
        rows.append([controller_label(summary, controller, result), error, *percentages])
    title = f"Limits reached{describe_seeds(summary)}: % of the frames, and mean duty cycle"
    headings = ["controller", "position, cm", *(f"{METRIC_LABELS[name]}, %" for name in names)]
    return Table(title, headings, rows, 1)


def recovery_table(summary: Summary) -> Table | None:
    """Return how the controllers recovered from each fault, or None if there were no faults."""
    rows = []
    for entry in summary["scenarios"].values():
        recoveries = [result["recovery"] for result in entry["results"].values()]
        for faults in zip(*recoveries, strict=False):
            for i, (controller, fault) in enumerate(zip(entry["results"], faults, strict=True)):
                time_s = fault[RECOVERY]["median"]
                recovered = "never" if time_s is None else format_number(time_s)
                excursion = format_number(fault[EXCURSION]["median"], 100)
                rows.append(["" if i else fault["fault"], controller, excursion, recovered])
    title = (
        f"Recovery from faults{describe_seeds(summary)}: largest position error until "
        f"{RECOVERY_WINDOW_S:g} s after the fault, and time from its start until the error stays "
        f"below {100 * RECOVERED_M:g} cm"
    )
    headings = ["fault", "controller", "largest error, cm", "recovered, s"]
    return Table(title, headings, rows, 2) if rows else None


def describe_seeds(summary: Summary) -> str:
    """Return the end of a table's title, which names the seeds."""
    seeds = summary["seeds"]
    if len(seeds) > 1:
        return f", median of {len(seeds)} seeds"
    return f", seed {seeds[0]}" if seeds else ""


def describe_plant(entry: Mapping[str, Any]) -> str:
    """Return robot and plant of a scenario's entry in a summary as text.

    The plant kinematic simulates no particular robot.
    """
    robot = "" if entry["plant"] == "kinematic" else f"{Path(entry['robot']).name} "
    return f"{robot}on the {entry['plant']} plant"


def controller_label(
    summary: Summary, controller: str, result: Mapping[str, Any] | None = None
) -> str:
    """Return a controller's name and whether it is privileged, and how many of its seeds failed."""
    remarks = ["privileged"] if controller in summary["privileged"] else []
    if result and result["n_failed"]:
        remarks.append(f"failed {result['n_failed']} of {len(result['effort_m_s2']['per_seed'])}")
    return f"{controller} ({', '.join(remarks)})" if remarks else controller


def format_mean_cm(statistics: SeedStatistics) -> str:
    """Return an error as "mean±half width" of the 95 % confidence interval, cm, or a dash."""
    if statistics["mean"] is None:
        return DASH
    half_width = format_number(statistics["ci95_half_width"], 100)
    return f"{100 * statistics['mean']:.2f}±{half_width}"


def _controller_rows(
    summary: Summary, entry: Mapping[str, Any], axes: Sequence[str], effort: bool
) -> Iterator[list[str]]:
    """Yield a row of `results_table` for each controller of a scenario."""
    baseline = next(iter(entry["results"].values()))
    for controller, result in entry["results"].items():
        row = [controller_label(summary, controller, result)]
        for axis in axes:
            _, key, factor = AXIS_COLUMNS[axis]
            row.append(_max_and_mean(result[key][axis], factor))
        if effort:
            row.append(format_number(result["excess_effort_m_s2"]["median"]))
        change = _change_percent(result, baseline) if len(entry["results"]) > 1 else ""
        yield [*row, _settling_time(result), change]


def _settling_time(result: Mapping[str, Any]) -> str:
    """Return the median settling time as text. If not all seeds settled, say how many did."""
    median, n_seeds = result["settle_s"]["median"], len(result["settle_s"]["per_seed"])
    time_s = "never" if median is None else format_number(median)
    n_settled = result["n_settled"]
    return f"{time_s} ({n_settled}/{n_seeds})" if n_settled < n_seeds > 1 else time_s


def _change_percent(result: Mapping[str, Any], baseline: Mapping[str, Any]) -> str:
    """Return the changes of the maximum and mean position error from the baseline's, as text."""
    if result is baseline:
        return "baseline"
    changes = []
    for statistic in ("max", "mean"):
        new, old = (
            compared["error_m"]["position"][statistic]["median"] for compared in (result, baseline)
        )
        has_ratio = new is not None and old is not None and old > ROUNDING_M
        changes.append(f"{100 * (new / old - 1):+.0f}" if has_ratio else DASH)
    return _join(changes)


def _max_and_mean(error: Mapping[str, Any], factor: float) -> str:
    """Return the maximum and mean of an error as text, medians over the seeds."""
    return _join([format_number(error[name]["median"], factor) for name in ("max", "mean")])


def _join(texts: list[str]) -> str:
    """Return texts with slashes between them, or a dash if all are dashes."""
    return DASH if set(texts) == {DASH} else "/".join(texts)


def _paper_rows(entry: Mapping[str, Any], axes: Sequence[str]) -> Iterator[list[str]]:
    """Yield a row of `results_table` for each controller that the paper reports."""
    for controller, errors in (entry["paper"] or {}).items():
        texts = {
            axis: f"{100 * error['max']:.2f}/{100 * error['mean']:.2f}"
            for axis, error in errors.items()
        }
        yield [PAPER_PREFIX + controller, *(texts.get(axis, "") for axis in axes)]

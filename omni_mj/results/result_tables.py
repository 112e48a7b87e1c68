"""Tables of results as strings, for the terminal, Markdown, recordings and reports."""

import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

from omni_mj.results.metrics import EXCURSION, RECOVERED_M, RECOVERY, RECOVERY_WINDOW_S
from omni_mj.results.saturation import DUTY, METRIC_LABELS
from omni_mj.results.statistics import SeedStatistics

DASH = "\N{EN DASH}"
TERMINAL_WIDTH = 80
MAX_LABEL_WIDTH = 40  # longer labels get a line of their own
PAPER_PREFIX = "paper's "  # before the names of controllers whose errors the paper reports
AXIS_COLUMNS = {  # axis -> heading, key in the summary, factor
    "x": ("x, cm", "error_m", 100.0),
    "y": ("y, cm", "error_m", 100.0),
    "position": ("position, cm", "error_m", 100.0),
    "heading": ("heading, °", "error_rad", degrees(1)),
}
MIN_FRACTION = 0.05  # fraction of frames from which on a limit is worth a table
Summary = Mapping[str, Any]
Column = tuple[str, ...]  # heading and cells


@dataclass(frozen=True)
class Table:
    """Headings and rows of strings. The first `left_columns` columns are aligned to the left."""

    title: str
    headings: list[str]
    rows: list[list[str]]
    left_columns: int


def results_table(summary: Summary, effort: bool = False, paper: bool = True) -> Table:
    """Return the errors and settling times of all controllers in all scenarios.

    Errors are "maximum/mean" over the frames; of several seeds, the medians. The paper's errors
    follow in rows of their own. Errors in x and y have columns only if the paper reports them. A
    column whose cells are all equal is left out.

    Args:
        summary: Content of summary.json.
        effort: Whether to add a column with the excess effort.
        paper: Whether to add the errors that the paper reports, and columns for x and y.
    """
    entries = {name: entry for name, entry in summary["scenarios"].items() if entry["results"]}
    several = len(summary["scenarios"]) > 1
    has_paper = paper and any(entry["paper"] for entry in entries.values())
    axes = [axis for axis in AXIS_COLUMNS if has_paper or axis not in ("x", "y")]
    baseline = next((next(iter(entry["results"])) for entry in entries.values()), "")
    headings = [*["scenario"] * several, "controller", *(AXIS_COLUMNS[axis][0] for axis in axes)]
    headings += [*["excess effort, m/s²"] * effort, "settled, s", f"vs {baseline}, %"]
    rows = []
    for name, entry in entries.items():
        lines = list(_controller_rows(summary, entry, axes, effort))
        if has_paper:
            lines += _paper_rows(entry, axes)
        for i, line in enumerate(lines):
            row = [*["" if i else name] * several, *line]
            rows.append(row + [""] * (len(headings) - len(row)))
    name = "Controllers compared" if several else next(iter(summary["scenarios"]))
    plants = dict.fromkeys(describe_plant(entry) for entry in summary["scenarios"].values())
    title = f"{name}, {' and '.join(plants)}{describe_seeds(summary)}; maximum/mean errors"
    position = AXIS_COLUMNS["position"][0]
    return drop_equal_columns(Table(title, headings, rows, 1 + several), kept_headings=[position])


def saturation_table(summary: Summary) -> Table | None:
    """Return how often each controller reached a limit, in % of the frames, beside its error.

    Returns:
        None if limits were hardly reached, or if the summary has several scenarios.
    """
    entries = [entry for entry in summary["scenarios"].values() if entry["results"]]
    if len(entries) != 1:
        return None
    results = entries[0]["results"]
    largest = {
        name: max(result["saturation"][name]["median"] or 0.0 for result in results.values())
        for name in METRIC_LABELS
    }
    if max(largest[name] for name in METRIC_LABELS if name != DUTY) < MIN_FRACTION:
        return None
    names = [name for name in METRIC_LABELS if largest[name] > 0]
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
    """Return the seeds of a table as the end of its title."""
    seeds = summary["seeds"]
    if len(seeds) > 1:
        return f", median of {len(seeds)} seeds"
    return f", seed {seeds[0]}" if seeds else ""


def describe_plant(entry: Mapping[str, Any]) -> str:
    """Return the robot, if the plant has one, and the plant of a scenario's entry in a summary."""
    robot = "" if entry["plant"] == "kinematic" else f"{Path(entry['robot']).name} "
    return f"{robot}on the {entry['plant']} plant"


def drop_equal_columns(text_table: Table, kept_headings: Collection[str] = ()) -> Table:
    """Return a table without columns that are empty or say the same of all controllers.

    Args:
        text_table: Table, whose left-aligned columns stay.
        kept_headings: Headings of columns that stay even if all their cells are equal.
    """
    columns = []
    for index, heading in enumerate(text_table.headings):
        column_cells = [row[index] for row in text_table.rows]
        values = [cell for cell in column_cells if cell not in ("", DASH)]
        is_equal = len(values) > 1 and len(set(values)) == 1
        is_informative = bool(values) and (heading in kept_headings or not is_equal)
        if index < text_table.left_columns or is_informative:
            columns.append(index)
    headings = [text_table.headings[index] for index in columns]
    rows = [[row[index] for index in columns] for row in text_table.rows]
    return Table(text_table.title, headings, rows, text_table.left_columns)


def format_table(text_table: Table, width: int = TERMINAL_WIDTH) -> str:
    """Return a table as lines of plain text that fit the terminal.

    Columns without any text are left out. If the table is too wide, units go to a second line of
    the headings. Columns that still do not fit follow in another block below. Long labels of rows
    get a line of their own.

    Args:
        text_table: Table to print. Units follow a comma in its headings.
        width: Largest number of characters in a line.
    """
    columns: list[Column] = list(zip(text_table.headings, *text_table.rows, strict=True))
    labels = columns[: text_table.left_columns]
    values = [column for column in columns[text_table.left_columns :] if any(column[1:])]
    n_headings = 1
    if _width([*labels, *values]) > width:
        n_headings = 2
        labels, values = (
            [_split_heading(column) for column in group] for group in (labels, values)
        )
    blocks: list[list[Column]] = [[]]
    for column in values:
        if blocks[-1] and _width([*labels, *blocks[-1], column]) > width:
            blocks.append([])
        blocks[-1].append(column)
    title = "\n".join(textwrap.fill(line, width) for line in text_table.title.split("\n"))
    body = "\n\n".join(_format_block(labels, block, n_headings) for block in blocks)
    return f"{title}\n{body}"


def format_markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown with one line of headings."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(map(escape_markdown_cell, line)) + " |" for line in lines)


def escape_markdown_cell(text: str) -> str:
    """Return a text without characters that would end a cell or line of a table in Markdown."""
    return " ".join(text.replace("|", "\\|").split())


def controller_label(
    summary: Summary, controller: str, result: Mapping[str, Any] | None = None
) -> str:
    """Return a controller's name with remarks: whether it is privileged, how many seeds failed."""
    remarks = ["privileged"] if controller in summary["privileged"] else []
    if result and result["n_failed"]:
        remarks.append(f"failed {result['n_failed']} of {len(result['effort_m_s2']['per_seed'])}")
    return f"{controller} ({', '.join(remarks)})" if remarks else controller


def format_number(value: float | None, factor: float = 1.0, digits: int = 2) -> str:
    """Return factor times a number, never as -0; a dash for None."""
    return DASH if value is None else f"{factor * value:z.{digits}f}"


def format_mean(spread: SeedStatistics, factor: float = 1.0) -> str:
    """Return "mean±half width" of the 95 % confidence interval over the seeds, or a dash."""
    if spread["mean"] is None:
        return DASH
    return f"{factor * spread['mean']:.2f}±{format_number(spread['ci95_half_width'], factor)}"


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
        change = "" if result is baseline else _change_percent(result, baseline)
        yield [*row, _settling_time(result), change]


def _settling_time(result: Mapping[str, Any]) -> str:
    """Return the median settling time, and how many of several seeds settled if not all did."""
    median, n_seeds = result["settle_s"]["median"], len(result["settle_s"]["per_seed"])
    time_s = "never" if median is None else format_number(median)
    n_settled = result["n_settled"]
    return f"{time_s} ({n_settled}/{n_seeds})" if n_settled < n_seeds > 1 else time_s


def _change_percent(result: Mapping[str, Any], baseline: Mapping[str, Any]) -> str:
    """Return the changes of the maximum and mean position error against the baseline."""
    changes = []
    for statistic in ("max", "mean"):
        new, old = (
            compared["error_m"]["position"][statistic]["median"] for compared in (result, baseline)
        )
        changes.append(DASH if new is None or not old else f"{100 * (new / old - 1):+.0f}")
    return "/".join(changes)


def _max_and_mean(error: Mapping[str, Any], factor: float) -> str:
    """Return the maximum and mean of an error, medians over the seeds."""
    return "/".join(format_number(error[name]["median"], factor) for name in ("max", "mean"))


def _paper_rows(entry: Mapping[str, Any], axes: Sequence[str]) -> Iterator[list[str]]:
    """Yield a row of `results_table` for each controller that the paper reports."""
    for controller, error in (entry["paper"] or {}).items():
        errors = [
            "/".join(format_number(error[axis][name], 100) for name in ("max", "mean"))
            if axis in error
            else ""
            for axis in axes
        ]
        yield [PAPER_PREFIX + controller, *errors]


def _split_heading(column: Column) -> Column:
    """Return a column whose heading has its unit in a second line."""
    quantity, _, unit = column[0].partition(", ")
    return (quantity, unit, *column[1:])


def _width(columns: Sequence[Column]) -> int:
    """Return the width of columns side by side, in characters."""
    return sum(2 + _column_width(column) for column in columns) - 2


def _column_width(column: Column) -> int:
    """Return the width of a column without its long labels, in characters."""
    return max((len(text) for text in column if len(text) <= MAX_LABEL_WIDTH), default=0)


def _format_block(labels: Sequence[Column], values: Sequence[Column], n_headings: int) -> str:
    """Return columns side by side, without the line of units if no column has one."""
    columns = [*labels, *values]
    widths = [_column_width(column) for column in columns]
    lines = []
    for label, *texts in zip(*columns, strict=True):
        if len(label) > MAX_LABEL_WIDTH:
            lines.append(textwrap.fill(label, TERMINAL_WIDTH))
            label = ""
        aligned = [
            text.ljust(width) if i < len(labels) else text.rjust(width)
            for i, (text, width) in enumerate(zip([label, *texts], widths, strict=True))
        ]
        lines.append("  ".join(aligned).rstrip())
    is_unit_line_empty = n_headings == 2 and not lines[1]
    return "\n".join(lines[:1] + lines[2:] if is_unit_line_empty else lines)

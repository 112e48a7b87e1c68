"""Tables of a sweep: a line per point and controller, and the settings that affect the errors."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_mj.files import write_text
from omni_mj.results.text_table import Table, format_markdown, format_number, format_table
from omni_mj.studies.sweep.sweep_statistics import ERROR_COLUMNS, MAX_ERROR

if TYPE_CHECKING:
    from omni_mj.studies.sweep import SweepResult

MAX_LINES = 60  # on a terminal


def format_sweep_tables(result: "SweepResult") -> str:
    """Return the tables as text; of a large sweep only the lines with the most failures."""
    points = result.summary["points"]
    if len(points) > MAX_LINES:
        points = sorted(points, key=_badness)[:MAX_LINES]
    return "\n\n".join(map(format_table, _list_tables(result, points)))


def save_sweep_table(result: "SweepResult", path: Path) -> None:
    """Write the complete tables as Markdown."""
    blocks = [
        f"{table.title}\n\n{format_markdown(table.headings, table.rows)}\n"
        for table in _list_tables(result, result.summary["points"])
    ]
    write_text(path, "\n".join(blocks))


def _list_tables(result: "SweepResult", points: list[dict[str, Any]]) -> list[Table]:
    """Return the table of points, and that of correlations if there is one."""
    return [_point_table(result, points), *_correlation_tables(result)]


def _badness(point: dict[str, Any]) -> tuple[float, float]:
    """Return a sort key: most failures first, then largest errors."""
    return -point["failure_rate"], -(point[MAX_ERROR]["p90"] or 1e9)


def _point_table(result: "SweepResult", points: list[dict[str, Any]]) -> Table:
    """Return failure rates and maximum position errors with 95 % intervals."""
    plan, names = result.plan, list(result.plan.axes)
    n_all = len(result.summary["points"])
    counts = sorted({point["n_robots"] for point in points})
    robots = " to ".join(str(count) for count in dict.fromkeys((counts[0], counts[-1])))
    title = f"{plan.scenario.name} on the {plan.scenario.plant} plant, "
    title += f"{robots} robots per line: maximum error"
    if not result.complete:
        title += f", {result.n_done} of {len(plan.shards)} shards"
    if len(points) < n_all:
        title += f"; the worst {len(points)} of {n_all} lines"
    headings = [*names, "controller", "failed, %", "95 %", "error, cm", "95 %"]
    headings += ["p90, cm"]
    return Table(title, headings, [_point_row(point, names) for point in points], len(names) + 1)


def _point_row(point: dict[str, Any], names: list[str]) -> list[str]:
    """Return the cells of a point and controller."""
    errors = {
        key: "∞" if error_m is None else f"{100 * error_m:.2f}"
        for key, error_m in point[MAX_ERROR].items()
    }
    has_interval = point[MAX_ERROR]["low"] is not None
    return [
        *(_format_value(point[name]) for name in names),
        point["controller"],
        f"{100 * point['failure_rate']:.3g}",
        f"{100 * point['failure_low']:.0f} to {100 * point['failure_high']:.0f}",
        errors["median"],
        f"{errors['low']} to {errors['high']}" if has_interval else "",
        errors["p90"],
    ]


def _format_value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _correlation_tables(result: "SweepResult") -> list[Table]:
    """Return a table of rank correlations, or none if there are no numbers to correlate."""
    rows = [
        [line["controller"], line["setting"], *(format_number(line[e]) for e in ERROR_COLUMNS)]
        for line in result.summary["correlations"]
    ]
    title = "settings that affect the position error: Spearman's rank correlation"
    return [Table(title, ["controller", "setting", "maximum", "mean"], rows, 2)] if rows else []

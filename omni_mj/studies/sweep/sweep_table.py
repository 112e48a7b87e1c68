"""Tables of a sweep: a line per point and controller, and what matters for the errors."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_mj.files import write_text
from omni_mj.results.result_tables import Table, format_number, format_table
from omni_mj.studies.sweep.sweep_statistics import SHOWN, STRAYED
from omni_mj.viz import markdown_tables

if TYPE_CHECKING:
    from omni_mj.studies.sweep import SweepResult

MAX_LINES = 60  # on a terminal


def format_sweep_tables(result: "SweepResult") -> str:
    """Return the tables as text; of a large sweep those lines where most robots fail and stray farthest."""
    cells = result.summary["cells"]
    if len(cells) > MAX_LINES:
        cells = sorted(
            cells, key=lambda cell: (-cell["failure_rate"], -(cell[STRAYED]["p90"] or 1e9))
        )[:MAX_LINES]
    return "\n\n".join(map(format_table, [_table(result, cells), *_correlations(result)]))


def save_sweep_table(result: "SweepResult", path: Path) -> None:
    """Write the whole tables as Markdown."""
    whole = [_table(result, result.summary["cells"]), *_correlations(result)]
    parts = [
        f"{table.title}\n\n{markdown_tables.markdown(table.headings, table.rows)}\n"
        for table in whole
    ]
    write_text(path, "\n".join(parts))


def _table(result: "SweepResult", cells: list[dict[str, Any]]) -> Table:
    """Return failure rates and maximum errors in the plane, medians and 90th percentiles, with 95 % intervals."""
    plan, names = result.plan, list(result.plan.axes)
    n_all = len(result.summary["cells"])
    counts = sorted({cell["robots"] for cell in cells})
    robots = " to ".join(str(count) for count in dict.fromkeys((counts[0], counts[-1])))
    title = f"{plan.scenario.name} on the {plan.scenario.plant} plant, {robots} robots a line"
    title += "" if result.complete else f", {result.done} of {len(plan.shards)} shards"
    title += f"; the worst {len(cells)} of {n_all} lines" if len(cells) < n_all else ""
    headings = [
        *names,
        "controller",
        "failed, %",
        "95 %",
        "max error, cm",
        "95 %",
        "90th percentile",
    ]
    return Table(title, headings, [_line(cell, names) for cell in cells], len(names) + 1)


def _correlations(result: "SweepResult") -> list[Table]:
    """Return a table of what matters for the errors, if anything is known to."""
    rows = [
        [line["controller"], line["setting"], *(format_number(line[error]) for error in SHOWN)]
        for line in result.summary["correlations"]
    ]
    title = "what matters: Spearman's rank correlation with the error in the plane"
    return [Table(title, ["controller", "setting", "maximum", "mean"], rows, 2)] if rows else []


def _line(cell: dict[str, Any], names: list[str]) -> list[str]:
    error = {
        key: "∞" if metres is None else f"{100 * metres:.2f}"
        for key, metres in cell[STRAYED].items()
    }
    return [
        *(
            f"{cell[name]:g}" if isinstance(cell[name], float) else str(cell[name])
            for name in names
        ),
        cell["controller"],
        f"{100 * cell['failure_rate']:.3g}",
        f"{100 * cell['failure_low']:.0f} to {100 * cell['failure_high']:.0f}",
        error["median"],
        "" if cell[STRAYED]["low"] is None else f"{error['low']} to {error['high']}",
        error["p90"],
    ]

"""Table of a sweep: a line per point and controller."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_mj.measure.table import Table
from omni_mj.show import tables
from omni_mj.studies.sweep.cells import STRAYED

if TYPE_CHECKING:
    from omni_mj.studies.sweep import Sweep

MAX_LINES = 60  # on a terminal


def table(result: "Sweep", worst: int | None = None) -> Table:
    """Return failure rates and maximum errors in the plane, medians and 90th percentiles, with 95 % intervals.

    Args:
        result: Sweep, complete or not.
        worst: Number of lines to show, those where most robots fail and stray farthest. [all]
    """
    plan, cells, names = result.plan, result.cells(), [axis.name for axis in result.plan.axes]
    counts = sorted({cell["robots"] for cell in cells})
    robots = " to ".join(str(count) for count in dict.fromkeys((counts[0], counts[-1])))
    title = f"{plan.scenario.name} on the {plan.scenario.plant} plant, {robots} robots a line"
    title += "" if result.complete else f", {result.done} of {len(plan.jobs)} shards"
    if worst is not None and len(cells) > worst:
        title += f"; the worst {worst} of {len(cells)} lines"
        cells = sorted(cells, key=lambda cell: (-cell["failure_rate"], -(cell[STRAYED]["p90"] or 1e9)))[:worst]
    headings = [*names, "controller", "failed, %", "95 %", "max error, cm", "95 %", "90th percentile"]
    return Table(title, headings, [_line(cell, names) for cell in cells], len(names) + 1)


def shown(result: "Sweep") -> Table:
    """Return the table for a terminal: of a large sweep the worst lines, else each point's values once."""
    whole = table(result, MAX_LINES)
    if len(whole.rows) == len(result.cells()):
        count, before = len(result.plan.axes), None
        for row in whole.rows:
            before, point = row[:count], before
            row[:count] = [""] * count if row[:count] == point else row[:count]
    return whole


def save(result: "Sweep", path: Path) -> None:
    """Write the whole table as Markdown."""
    tables.save(table(result), path)


def _line(cell: dict[str, Any], names: list[str]) -> list[str]:
    error = cell[STRAYED]
    return [
        *(f"{cell[name]:g}" if isinstance(cell[name], float) else str(cell[name]) for name in names),
        cell["controller"],
        f"{100 * cell['failure_rate']:.3g}",
        f"{100 * cell['failure_low']:.2g} to {100 * cell['failure_high']:.2g}",
        _cm(error["median"]),
        "" if error["low"] is None else f"{_cm(error['low'])} to {_cm(error['high'])}",
        _cm(error["p90"]),
    ]


def _cm(metres: float | None) -> str:
    return "∞" if metres is None else f"{100 * metres:.2f}"

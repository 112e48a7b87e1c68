"""The table of a sweep: a line per point and controller."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_mj.files import write
from omni_mj.measure.table import Table
from omni_mj.show import markdown
from omni_mj.studies.sweep.cells import STRAYED

if TYPE_CHECKING:
    from omni_mj.studies.sweep import Sweep

MOST = 60  # lines on a terminal


def table(found: "Sweep") -> Table:
    """Failure rates, and maximum errors in the plane, medians and 90th percentiles, with 95 % intervals.

    The error of a robot that failed is without bound.
    """
    cells, axes = found.cells(), [axis.name for axis in found.plan.axes]
    state = "" if found.complete else f", {found.done} of {len(found.plan.jobs)} shards"
    title = (
        f"{found.plan.scenario.name} on the {found.plan.scenario.plant} plant, {_robots(cells)} robots a line{state}"
    )
    headings = [*axes, "controller", "failed, %", "95 %", "max error, cm", "95 %", "90th percentile"]
    return Table(title, headings, [_line(cell, axes) for cell in cells], len(axes) + 1)


def shown(found: "Sweep") -> Table:
    """The table as a terminal has it: of a large sweep those lines where most fail and robots stray farthest."""
    whole = table(found)
    if len(whole.rows) <= MOST:
        return Table(whole.title, whole.headings, _grouped(whole.rows, len(found.plan.axes)), whole.left)
    cells = found.cells()
    rank = sorted(range(len(cells)), key=lambda i: (-cells[i]["failure_rate"], -(cells[i][STRAYED]["p90"] or 1e9)))
    rows = [whole.rows[i] for i in rank[:MOST]]
    return Table(f"{whole.title}; the worst {MOST} of {len(cells)} lines", whole.headings, rows, whole.left)


def save(found: "Sweep", path: Path) -> None:
    """Write the whole table as Markdown."""
    whole = table(found)
    write(path, f"{whole.title}\n\n{markdown.table(whole.headings, whole.rows)}\n")


def _line(cell: dict[str, Any], axes: list[str]) -> list[str]:
    error = cell[STRAYED]
    return [
        *(f"{cell[name]:g}" if isinstance(cell[name], float) else str(cell[name]) for name in axes),
        cell["controller"],
        f"{100 * cell['failure_rate']:.3g}",
        f"{100 * cell['failure_low']:.2g} to {100 * cell['failure_high']:.2g}",
        _cm(error["median"]),
        f"{_cm(error['low'])} to {_cm(error['high'])}" if error["low"] is not None else "",
        _cm(error["p90"]),
    ]


def _grouped(lines: list[list[str]], axes: int) -> list[list[str]]:
    """Lines of one point under each other, its values in the first of them."""
    before = [[], *lines[:-1]]
    return [
        [""] * axes + line[axes:] if line[:axes] == last[:axes] else line
        for last, line in zip(before, lines, strict=True)
    ]


def _robots(cells: list[dict[str, Any]]) -> str:
    counts = {cell["robots"] for cell in cells}
    return str(counts.pop()) if len(counts) == 1 else f"{min(counts)} to {max(counts)}"


def _cm(metres: float | None) -> str:
    return "∞" if metres is None else f"{100 * metres:.2f}"

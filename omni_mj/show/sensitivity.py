"""Table and figure of a sensitivity: what each setting that is drawn does to errors and failures."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_mj.measure.table import Table
from omni_mj.show import style, tables
from omni_mj.show.figures import canvas
from omni_mj.studies.sweep import sensitivity
from omni_mj.studies.sweep.cells import SHOWN

if TYPE_CHECKING:
    from omni_mj.studies.sweep import Sweep

Lines = list[dict[str, Any]]
QUANTITIES = {**SHOWN, sensitivity.FAILED: "failed"}
HEADINGS = {
    "sobol": {"S1": "first order", "S1_conf": "±", "ST": "total", "ST_conf": "±"},
    "morris": {"mu_star": "mean change", "mu_star_conf": "±", "sigma": "spread"},
}
MEANING = {"sobol": "parts of the variance", "morris": "change over the whole range of a setting"}
BARS = {"sobol": "ST", "morris": "mu_star"}


def table(result: "Sweep", lines: Lines) -> Table:
    """Return a line per controller, quantity and setting; empty where a robot failed or nothing changed.

    Failures have lines if any robot failed.
    """
    assert result.plan.design is not None, "asked of such a sweep only"
    method, samples = result.plan.design
    scenario, numbers = result.plan.scenario, HEADINGS[method]
    title = f"{scenario.name} on the {scenario.plant} plant, {method} of {samples} samples: {MEANING[method]}"
    rows = []
    for line in lines:
        cells = ["" if line[key] is None else f"{line[key]:.3g}" for key in numbers]
        if line["of"] != sensitivity.FAILED or any(cells):
            rows.append([line["controller"], QUANTITIES[line["of"]], line["setting"], *cells])
    return Table(title, ["controller", "of", "setting", *numbers.values()], rows, 3)


def save(result: "Sweep", lines: Lines, folder: Path) -> None:
    """Write sensitivity.md, and sensitivity.png with a bar per quantity, setting and controller."""
    whole = table(result, lines)
    tables.save(whole, folder / "sensitivity.md")
    assert result.plan.design is not None, "asked of such a sweep only"
    key = BARS[result.plan.design[0]]
    settings, names = [axis.name for axis in result.plan.axes], result.plan.scenario.labels
    drawn = [q for q in QUANTITIES if any(line[key] is not None for line in lines if line["of"] == q)]
    drawn = drawn or list(QUANTITIES)[:1]
    size = (8, 1.2 + len(drawn) * (0.6 + 0.25 * len(settings) * len(names)))
    with canvas.drawing(folder / "sensitivity", whole.title, figsize=size) as figure:
        grid = figure.subplots(len(drawn), 1, squeeze=False)[:, 0]
        y, thickness = np.arange(len(settings)), 0.8 / len(names)
        for axes, quantity in zip(grid, drawn, strict=True):
            for i, (name, slot) in enumerate(style.slots(names).items()):
                part = [line for line in lines if line["controller"] == name and line["of"] == quantity]
                widths, halves = (np.array([line[k] for line in part], float) for k in (key, f"{key}_conf"))
                axes.barh(y + i * thickness, widths, thickness, xerr=halves, color=style.colour(slot), label=name)
            axes.set_yticks(y + 0.4 - thickness / 2, settings)
            axes.invert_yaxis()
            axes.set(title=QUANTITIES[quantity], xlabel=HEADINGS[result.plan.design[0]][key])
            axes.margins(x=0.05)
            axes.set_xlim(left=0)
            axes.grid(axis="y", visible=False)
        canvas.add_legend(figure, grid[:1])

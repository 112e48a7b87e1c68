"""The table and the figure of a sensitivity: what each setting that is drawn does to errors and failures."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import style as matplotlib_style
from matplotlib.figure import Figure

from omni_mj.files import write
from omni_mj.measure.table import Table
from omni_mj.show import markdown, style
from omni_mj.show.figures import canvas
from omni_mj.studies.sweep import sensitivity
from omni_mj.studies.sweep.cells import SHOWN

if TYPE_CHECKING:
    from omni_mj.studies.sweep import Sweep

Lines = list[dict[str, Any]]
OF = {**SHOWN, sensitivity.FAILED: "failed"}
HEADINGS = {
    "sobol": {"S1": "first order", "S1_conf": "±", "ST": "total", "ST_conf": "±"},
    "morris": {"mu_star": "mean change", "mu_star_conf": "±", "sigma": "spread"},
}
MEANING = {"sobol": "parts of the variance", "morris": "change over the whole range of a setting"}
SHOWN_AS_BAR = {"sobol": ("ST", "ST_conf"), "morris": ("mu_star", "mu_star_conf")}


def table(found: "Sweep", lines: Lines) -> Table:
    """A line per controller, error and setting; without numbers where a robot failed, or nothing changed.

    Of failures there are lines if any robot failed.
    """
    assert found.plan.design is not None, "asked of such a sweep only"
    method, samples = found.plan.design
    plan, numbers = found.plan, HEADINGS[method]
    title = f"{plan.scenario.name} on the {plan.scenario.plant} plant, {method} of {samples} samples: {MEANING[method]}"
    rows = [
        [line["controller"], OF[line["of"]], line["setting"], *(_shown(line[key]) for key in numbers)]
        for line in lines
        if line["of"] != sensitivity.FAILED or any(line[key] is not None for key in numbers)
    ]
    return Table(title, ["controller", "of", "setting", *numbers.values()], rows, 3)


def save(found: "Sweep", lines: Lines, folder: Path) -> None:
    """Write sensitivity.md and sensitivity.png."""
    whole = table(found, lines)
    write(folder / "sensitivity.md", f"{whole.title}\n\n{markdown.table(whole.headings, whole.rows)}\n")
    with matplotlib_style.context(style.SHEET):
        figure = _bars(found, lines)
        canvas.title(figure, whole.title)
        figure.savefig(folder / "sensitivity.png")


def _bars(found: "Sweep", lines: Lines) -> Figure:
    """Of each error a bar per setting and controller, with its 95 % interval; of failures, if there are any."""
    assert found.plan.design is not None, "asked of such a sweep only"
    key, half = SHOWN_AS_BAR[found.plan.design[0]]
    settings, names = [axis.name for axis in found.plan.axes], found.plan.scenario.labels
    there = [of for of in OF if any(line[key] is not None for line in lines if line["of"] == of)] or [next(iter(OF))]
    figure = Figure(figsize=(8, 1.2 + len(there) * (0.6 + 0.25 * len(settings) * len(names))))
    grid = figure.subplots(len(there), 1, squeeze=False)[:, 0]
    at, thick = np.arange(len(settings)), 0.8 / len(names)
    for axes, of in zip(grid, there, strict=True):
        for i, (name, slot) in enumerate(zip(names, style.slots(names), strict=True)):
            own = [line for line in lines if line["controller"] == name and line["of"] == of]
            widths, halves = (np.array([line[k] for line in own], float) for k in (key, half))
            axes.barh(at + i * thick, widths, thick, xerr=halves, color=style.colour(slot), label=name)
        axes.set_yticks(at + 0.4 - thick / 2, settings)
        axes.invert_yaxis()
        axes.set(title=OF[of], xlabel=HEADINGS[found.plan.design[0]][key])
        axes.margins(x=0.05)
        axes.set_xlim(left=0)
        axes.grid(axis="y", visible=False)
    canvas.legend(figure, grid[0])
    return figure


def _shown(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"

"""The figure of a sweep: lines with confidence bands over one setting, heat maps over two."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import style as matplotlib_style
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.sweep.cells import STRAYED

if TYPE_CHECKING:
    from omni_mj.studies.sweep import Axis, Sweep

Cell = dict[str, Any]
ERROR, RATE = "maximum error in the plane, cm: median", "robots that failed, %"
BESIDE = 0.03  # of the width, over which the intervals at a value are spread, not to lie on one another
LEVEL = 5  # values across, above which their labels are turned, not to overlap
LABELLED = 60  # cells of a heat map at most, for their numbers to be written in them


def save(found: "Sweep", path: Path) -> None:
    """Draw a sweep into a PNG: over its first two settings; at several values of others, the worst of these.

    The worst is shown, since a mean over settings that nobody weighted means nothing.
    """
    cells, axes = found.cells(), found.plan.axes[:2]
    with matplotlib_style.context(style.SHEET):
        names = list(dict.fromkeys(cell["controller"] for cell in cells))
        figure = _lines(cells, names, axes[0]) if len(axes) == 1 else _maps(cells, names, axes[0], axes[1])
        worst = "; the worst over the others" if len(found.plan.axes) > 2 else ""
        part = "" if found.complete else f", {found.done} of {len(found.plan.jobs)} shards"
        canvas.title(figure, f"{found.plan.scenario.name} on the {found.plan.scenario.plant} plant{worst}{part}")
        canvas.save_png(figure, path)


def _lines(cells: list[Cell], names: list[str], axis: "Axis") -> Figure:
    figure = Figure(figsize=(8, 5.5))
    error, rate = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    at = np.arange(len(axis.values)) if _words(axis) else np.array(axis.values, float)
    apart = BESIDE * float(np.ptp(at)) / len(names)
    for i, (slot, name) in enumerate(zip(style.slots(names), names, strict=True)):
        own = [_worst(cells, name, {axis.name: value}) for value in axis.values]
        look = style.line(slot)
        middle, low, high = (_of(own, lambda c, key=key: _cm(c[STRAYED][key])) for key in ("median", "low", "high"))
        error.plot(at, middle, label=name, **look)
        error.fill_between(at, low, high, color=look["color"], alpha=0.2, lw=0)
        failed = [_of(own, lambda c, key=key: 100 * c[key]) for key in ("failure_rate", "failure_low", "failure_high")]
        beside = at + (i - (len(names) - 1) / 2) * apart
        rate.plot(beside, failed[0], **look)
        rate.vlines(beside, failed[1], failed[2], color=look["color"], lw=1.2, zorder=2.5)
    error.set_yscale("log")
    canvas.plain(error.yaxis)
    error.set_ylabel(f"{ERROR}\nand its 95 % interval")
    rate.set(xlabel=axis.name, ylabel=f"{RATE},\nand 95 % intervals")
    rate.margins(x=0.03)
    rate.set_ylim(bottom=0)
    if _words(axis):
        rate.set_xticks(at, list(map(str, axis.values)))
    canvas.legend(figure, error)
    return figure


def _maps(cells: list[Cell], names: list[str], down: "Axis", across: "Axis") -> Figure:
    """A column per controller: errors, and if any robot failed, below them how many; all with the same colours."""
    at = [[{down.name: y, across.name: x} for x in across.values] for y in down.values]
    worst = [[[_worst(cells, name, where) for where in line] for line in at] for name in names]
    errors = [np.array([[_cm(c[STRAYED]["median"]) if c else np.nan for c in line] for line in own]) for own in worst]
    rates = [np.array([[100 * c["failure_rate"] if c else np.nan for c in line] for line in own]) for own in worst]
    finite = np.concatenate([each[np.isfinite(each) & (each > 0)] for each in errors])
    norm: Any = LogNorm(finite.min(), max(finite.max(), 1.01 * finite.min())) if finite.size else None
    parts = [
        (errors, {"norm": norm, "cmap": "viridis"}, ERROR),
        (rates, {"vmin": 0, "vmax": 100, "cmap": "Reds"}, RATE),
    ]
    parts = parts if np.nanmax(rates) > 0 else parts[:1]
    figure = Figure(figsize=(1.5 + 3.2 * len(names), 0.8 + 2.9 * len(parts)))
    grid = figure.subplots(len(parts), len(names), sharex=True, sharey=True, squeeze=False)
    for line, (values, look, label) in zip(grid, parts, strict=True):
        for axes, name, own in zip(line, names, values, strict=True):
            image = _map(axes, own, look)
            axes.set_title(name)
        figure.colorbar(image, ax=list(line), label=label, fraction=0.05, format="{x:g}")
        line[0].set_ylabel(down.name)
    for axes in grid[-1]:
        axes.set_xlabel(across.name)
    for axes in grid[-1]:
        axes.set_xticks(range(len(across.values)), [_short(value) for value in across.values])
        axes.tick_params(axis="x", labelrotation=45 if len(across.values) > LEVEL else 0)
    grid[0, 0].set_yticks(range(len(down.values)), [_short(value) for value in down.values])
    return figure


def _map(axes: Axes, values: Array, look: dict[str, Any]) -> Any:
    axes.grid(visible=False)
    axes.set_facecolor(style.BACKGROUND)  # without bound, or not there
    image: Any = axes.imshow(np.where(np.isfinite(values), values, np.nan), origin="lower", aspect="auto", **look)
    if values.size <= LABELLED:
        for (y, x), value in np.ndenumerate(values):
            red, green, blue, _ = image.cmap(image.norm(value))
            dark = np.isfinite(value) and 0.3 * red + 0.6 * green + 0.1 * blue < 0.5
            text = "∞" if np.isinf(value) else "" if np.isnan(value) else f"{value:.2g}"
            axes.text(x, y, text, ha="center", va="center", fontsize=7, color="white" if dark else "black")
    return image


def _worst(cells: list[Cell], controller: str, where: dict[str, Any]) -> Cell | None:
    """Of the cells of a controller at some values, that where most fail and then robots stray farthest, if any is."""
    own = [c for c in cells if c["controller"] == controller and all(c[name] == value for name, value in where.items())]
    return max(own, key=lambda c: (c["failure_rate"], _cm(c[STRAYED]["median"])), default=None)


def _of(cells: list[Cell | None], number: Any) -> Array:
    """A number of each cell; not one where there is none, which leaves a gap."""
    values = np.array([np.nan if cell is None else number(cell) for cell in cells])
    return np.where(np.isfinite(values), values, np.nan)


def _cm(metres: float | None) -> float:
    return np.inf if metres is None else 100 * metres


def _words(axis: "Axis") -> bool:
    return any(isinstance(value, (str, bool)) for value in axis.values)


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)

"""Figure of a sweep: lines with confidence bands over one setting, heat maps over two."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
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
Grid = list[list[Cell | None]]  # of rows and columns of points
ERROR, RATE = "maximum error in the plane, cm: median", "robots that failed, %"
SPREAD = 0.03  # of the axis, over which the intervals at a value are spread so that they do not overlap
MAX_LEVEL_LABELS = 5  # values on the x-axis above which labels are rotated
MAX_NUMBERS = 60  # cells of a heat map up to which their numbers are written in them


def save(result: "Sweep", path: Path) -> None:
    """Draw a sweep into a PNG over its first two settings; of several values of others, the worst.

    The worst is shown because a mean over settings that nobody weighted has no meaning.
    """
    plan, cells = result.plan, result.cells()
    names = list(dict.fromkeys(cell["controller"] for cell in cells))
    worst = "; the worst over the others" if len(plan.axes) > 2 else ""
    part = "" if result.complete else f", {result.done} of {len(plan.jobs)} shards"
    title = f"{plan.scenario.name} on the {plan.scenario.plant} plant{worst}{part}"
    with canvas.drawing(path.with_suffix(""), title) as figure:
        if len(plan.axes) == 1:
            _draw_lines(figure, cells, names, plan.axes[0])
        else:
            _draw_maps(figure, cells, names, plan.axes[0], plan.axes[1])


def _draw_lines(figure: Figure, cells: list[Cell], names: list[str], axis: "Axis") -> None:
    """Draw median errors with their intervals, and failure rates below."""
    figure.set_size_inches(8, 5.5)
    error, rate = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    categorical = any(isinstance(value, str | bool) for value in axis.values)
    x = np.arange(len(axis.values)) if categorical else np.array(axis.values, float)
    points = [[{axis.name: value} for value in axis.values]]
    for i, (name, slot) in enumerate(style.slots(names).items()):
        worst, look = _worst(cells, name, points), style.line(slot)
        median, low, high = (_errors(worst, key, np.nan)[0] for key in ("median", "low", "high"))
        error.plot(x, median, label=name, **look)
        error.fill_between(x, low, high, color=look["color"], alpha=0.2, lw=0)
        shift = (i / len(names) - 0.5) * SPREAD * np.ptp(x)
        failed, low, high = (_rates(worst, key)[0] for key in ("failure_rate", "failure_low", "failure_high"))
        rate.errorbar(x + shift, failed, [failed - low, high - failed], elinewidth=1.2, **look)
    canvas.use_log_scale(error.yaxis)
    error.set_ylabel(f"{ERROR}\nand its 95 % interval")
    rate.set(xlabel=axis.name, ylabel=f"{RATE},\nand 95 % intervals")
    rate.margins(x=0.03)
    rate.set_ylim(bottom=0)
    if categorical:
        rate.set_xticks(x, list(map(str, axis.values)))
    canvas.add_legend(figure, [error])


def _draw_maps(figure: Figure, cells: list[Cell], names: list[str], down: "Axis", across: "Axis") -> None:
    """Draw a column per controller: errors, and below them failure rates if any robot failed."""
    points = [[{down.name: y, across.name: x} for x in across.values] for y in down.values]
    worst = [_worst(cells, name, points) for name in names]
    errors = np.stack([_errors(grid, "median", np.inf) for grid in worst])
    rates = np.stack([_rates(grid, "failure_rate") for grid in worst])
    finite = errors[np.isfinite(errors) & (errors > 0)]
    norm = LogNorm(finite.min(), max(finite.max(), 1.01 * finite.min())) if finite.size else None
    parts: list[tuple[Array, dict[str, Any], str]] = [(errors, {"norm": norm, "cmap": "viridis"}, ERROR)]
    parts += [(rates, {"vmin": 0, "vmax": 100, "cmap": "Reds"}, RATE)] * bool(np.nanmax(rates) > 0)
    figure.set_size_inches(1.5 + 3.2 * len(names), 0.8 + 2.9 * len(parts))
    grid = figure.subplots(len(parts), len(names), sharex=True, sharey=True, squeeze=False)
    for row, (values, look, label) in zip(grid, parts, strict=True):
        for axes, name, shown in zip(row, names, values, strict=True):
            image = _draw_map(axes, shown, look)
            axes.set_title(name)
        figure.colorbar(image, ax=list(row), label=label, fraction=0.05, format="{x:g}")
        row[0].set_ylabel(down.name)
    for axes in grid[-1]:
        axes.set_xlabel(across.name)
        axes.set_xticks(range(len(across.values)), map(_short, across.values))
        axes.tick_params(axis="x", labelrotation=45 if len(across.values) > MAX_LEVEL_LABELS else 0)
    grid[0, 0].set_yticks(range(len(down.values)), map(_short, down.values))


def _draw_map(axes: Axes, values: Array, look: dict[str, Any]) -> Any:
    """Draw values (rows, columns) as colours, and as numbers if they are few; grey where there is no bound."""
    axes.grid(visible=False)
    axes.set_facecolor(style.BACKGROUND)
    image: Any = axes.imshow(np.where(np.isfinite(values), values, np.nan), origin="lower", aspect="auto", **look)
    for (y, x), value in np.ndenumerate(values if values.size <= MAX_NUMBERS else np.empty((0, 0))):
        is_dark = np.isfinite(value) and np.dot(image.to_rgba(value)[:3], (0.3, 0.6, 0.1)) < 0.5
        text = "" if np.isnan(value) else f"{value:.2g}".replace("inf", "∞")
        axes.text(x, y, text, ha="center", va="center", fontsize=7, color="white" if is_dark else "black")
    return image


def _worst(cells: list[Cell], controller: str, points: list[list[dict[str, Any]]]) -> Grid:
    """Return the controller's cell at each point where most robots fail and then stray farthest, if there is any."""

    def badness(cell: Cell) -> tuple[float, float]:
        return cell["failure_rate"], cell[STRAYED]["median"] or np.inf

    chosen = [cell for cell in cells if cell["controller"] == controller]
    return [
        [max((c for c in chosen if p.items() <= c.items()), key=badness, default=None) for p in row] for row in points
    ]


def _errors(grid: Grid, key: str, unbounded: float) -> Array:
    """Return errors in cm, (rows, columns); NaN for missing cells, `unbounded` where a robot failed."""
    values = [[np.nan if cell is None else cell[STRAYED][key] for cell in row] for row in grid]
    return np.array([[unbounded if value is None else 100 * value for value in row] for row in values])


def _rates(grid: Grid, key: str) -> Array:
    """Return failure rates in per cent, (rows, columns); NaN for missing cells."""
    return np.array([[np.nan if cell is None else 100 * cell[key] for cell in row] for row in grid])


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)

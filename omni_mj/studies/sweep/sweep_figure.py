"""Figure of a sweep: lines with confidence bands over one setting, heat maps over two."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axis import Axis
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.studies.sweep.sweep_statistics import STRAYED
from omni_mj.viz import style
from omni_mj.viz.figures import plotting

if TYPE_CHECKING:
    from omni_mj.studies.sweep import SweepResult

ERROR, RATE = "maximum error in the plane, cm: median", "robots that failed, %"
# Of the axis, over which the intervals at a value are spread so that they do not overlap
SPREAD = 0.03
MAX_TICKS = 8


def save_sweep_figure(result: "SweepResult", path: Path) -> None:
    """Draw a sweep into a PNG over its first two settings, if it has any; of several values of others, the worst.

    The worst is shown because a mean over settings that nobody weighted has no meaning.
    """
    plan = result.plan
    worst = "; the worst over the others" if len(plan.axes) > 2 else ""
    part = "" if result.complete else f", {result.done} of {len(plan.shards)} shards"
    title = f"{plan.scenario.name} on the {plan.scenario.plant} plant{worst}{part}"
    if plan.axes:
        with plotting.figure_file(path.with_suffix(""), title) as figure:
            (_draw_lines if len(plan.axes) == 1 else _draw_maps)(figure, result)


def _draw_lines(figure: Figure, result: "SweepResult") -> None:
    """Draw median errors with their intervals, and failure rates below."""
    figure.set_size_inches(8, 5.5)
    error, rate = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    ((setting, levels),), names = result.plan.axes.items(), result.plan.scenario.labels
    errors = [_values(result, STRAYED, key) for key in ("median", "low", "high")]
    median, low, high = (np.where(np.isfinite(values), values, np.nan) for values in errors)
    rates = [_values(result, f"failure_{key}") for key in ("rate", "low", "high")]
    x = np.arange(len(levels))
    for i, slot in enumerate(style.style_indices(names).values()):
        look, (failed, least, most) = style.line_style(slot), (values[:, i] for values in rates)
        error.plot(x, median[:, i], label=names[i], **look)
        error.fill_between(x, low[:, i], high[:, i], color=look["color"], alpha=0.2, lw=0)
        shift = (i / len(names) - 0.5) * SPREAD * len(x)
        rate.errorbar(x + shift, failed, [failed - least, most - failed], elinewidth=1.2, **look)
    if np.isfinite(median).any():
        plotting.use_log_scale(error.yaxis)
    error.set_ylabel(f"{ERROR}\nand its 95 % interval")
    rate.set(xlabel=setting, ylabel=f"{RATE},\nand 95 % intervals")
    rate.margins(x=0.03)
    rate.set_ylim(bottom=0)
    _set_ticks(rate.xaxis, levels)
    plotting.add_legend(figure, [error])


def _draw_maps(figure: Figure, result: "SweepResult") -> None:
    """Draw a column per controller: errors, grey where there is no bound, and failure rates if any robot failed."""
    (down, down_values), (across, across_values), *_ = result.plan.axes.items()
    names = result.plan.scenario.labels
    shape = len(down_values), len(across_values), -1, len(names)
    both = _values(result, STRAYED, "median"), _values(result, "failure_rate")
    errors, rates = (np.fmax.reduce(values.reshape(shape), axis=2) for values in both)
    finite = errors[np.isfinite(errors) & (errors > 0)]
    norm = LogNorm(finite.min(), max(finite.max(), 1.01 * finite.min())) if finite.size else None
    parts: list[tuple[Array, dict[str, Any], str]] = [
        (errors, {"norm": norm, "cmap": "viridis"}, ERROR)
    ]
    parts += [(rates, {"vmin": 0, "vmax": 100, "cmap": "Reds"}, RATE)] * bool(np.nanmax(rates) > 0)
    figure.set_size_inches(1.5 + 3.2 * len(names), 0.8 + 2.9 * len(parts))
    grid = figure.subplots(len(parts), len(names), sharex=True, sharey=True, squeeze=False)
    for row, (values, look, label) in zip(grid, parts, strict=True):
        for i, axes in enumerate(row):
            shown = np.where(np.isfinite(values[..., i]), values[..., i], np.nan)
            axes.grid(visible=False)
            axes.set_facecolor(style.BACKGROUND)
            image = axes.imshow(shown, origin="lower", aspect="auto", **look)
            axes.set(title=names[i], xlabel=across, ylabel=down)
            axes.label_outer()
        figure.colorbar(image, ax=list(row), label=label, fraction=0.05, format="{x:g}")
    _set_ticks(grid[0, 0].xaxis, across_values)
    _set_ticks(grid[0, 0].yaxis, down_values)


def _values(result: "SweepResult", *path: str) -> Array:
    """Return a number of each cell times 100, (points, controllers); infinite without bound, NaN for missing cells."""
    values = np.full((len(result.plan.points), len(result.plan.scenario.labels)), np.nan)
    for cell in result.summary["cells"]:
        value: Any = cell
        for key in path:
            value = value[key]
        place = cell["point"], result.plan.scenario.labels.index(cell["controller"])
        values[place] = np.inf if value is None else 100 * value
    return values


def _set_ticks(ticks: Axis, levels: Sequence[Any]) -> None:
    step = -(-len(levels) // MAX_TICKS)
    labels = [
        f"{value:.3g}" if isinstance(value, float) else str(value) for value in levels[::step]
    ]
    ticks.set_ticks(range(0, len(levels), step), labels)

"""Figure of a sweep: lines with confidence bands over one setting, heat maps over two."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axis import Axis
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from omni_control.kinematics import Array
from omni_mj.studies.sweep.sweep_statistics import MAX_ERROR
from omni_mj.studies.sweep.sweep_study import SweepResult
from omni_mj.viz import figure_helpers, style

ERROR_LABEL = "median of the maximum position error in cm"
RATE_LABEL = "robots that failed in %"
# Width of all intervals at one value side by side, as a fraction of the axis
INTERVAL_OFFSET = 0.03
MAX_TICKS = 8  # of an axis


def save_sweep_figure(result: SweepResult, path: Path) -> None:
    """Draw a sweep over its first two settings into a PNG file; nothing without settings.

    If further settings vary, each point shows the worst case over them. A mean would depend on how
    their values were chosen.
    """
    plan = result.plan
    if not plan.axes:
        return
    worst = "; worst case of all other settings" if len(plan.axes) > 2 else ""
    progress = "" if result.complete else f", {result.n_done} of {len(plan.shards)} shards"
    settings = " and ".join(list(plan.axes)[:2])
    title = f"Errors over {settings}: {plan.scenario.name} on the {plan.scenario.plant} plant"
    with figure_helpers.figure_file(path.with_suffix(""), f"{title}{worst}{progress}") as figure:
        if len(plan.axes) == 1:
            _draw_lines(figure, result)
        else:
            _draw_maps(figure, result)


def _draw_lines(figure: Figure, result: SweepResult) -> None:
    """Draw median errors above failure rates, both with 95 % intervals."""
    figure.set_size_inches(8, 5.5)
    error, rate = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    ((setting, levels),), names = result.plan.axes.items(), result.plan.scenario.labels
    median, low, high = (_collect(result, MAX_ERROR, key) for key in ("median", "low", "high"))
    rates = [_collect(result, f"failure_{key}") for key in ("rate", "low", "high")]
    x = np.arange(len(levels))
    for i, slot in enumerate(style.style_indices(names).values()):
        line = style.line_style(slot)
        error.plot(x, median[:, i], label=names[i], **line)
        error.fill_between(x, low[:, i], high[:, i], color=line["color"], alpha=0.2, lw=0)
        offset = (i / len(names) - 0.5) * INTERVAL_OFFSET * len(x)
        failed, lower, upper = (values[:, i] for values in rates)
        interval = [failed - lower, upper - failed]
        rate.errorbar(x + offset, failed, interval, elinewidth=1.2, **line)
    if np.isfinite(median).any():
        figure_helpers.use_log_scale(error.yaxis)
    error.set_ylabel(f"{ERROR_LABEL}\nwith 95 % interval")
    rate.set(xlabel=setting, ylabel=f"{RATE_LABEL}\nwith 95 % interval")
    rate.margins(x=0.03)
    rate.set_ylim(bottom=0)
    _set_ticks(rate.xaxis, levels)
    figure_helpers.add_legend(figure, [error])


def _draw_maps(figure: Figure, result: SweepResult) -> None:
    """Draw a column of heat maps per controller: errors, and failure rates if any robot failed."""
    (row_name, row_values), (column_name, column_values), *_ = result.plan.axes.items()
    names = result.plan.scenario.labels
    shape = len(row_values), len(column_values), -1, len(names)
    # The worst case over all further settings; NaN are ignored
    errors = np.fmax.reduce(_collect(result, MAX_ERROR, "median").reshape(shape), axis=2)
    rates = np.fmax.reduce(_collect(result, "failure_rate").reshape(shape), axis=2)
    finite = errors[np.isfinite(errors) & (errors > 0)]
    norm = LogNorm(finite.min(), max(finite.max(), 1.01 * finite.min())) if finite.size else None
    maps: list[tuple[Array, dict[str, Any], str]] = [
        (errors, {"norm": norm, "cmap": "viridis"}, ERROR_LABEL)
    ]
    if np.nanmax(rates) > 0:
        maps.append((rates, {"vmin": 0, "vmax": 100, "cmap": "Reds"}, RATE_LABEL))
    figure.set_size_inches(1.5 + 3.2 * len(names), 0.8 + 2.9 * len(maps))
    grid = figure.subplots(len(maps), len(names), sharex=True, sharey=True, squeeze=False)
    for row, (values, colors, label) in zip(grid, maps, strict=True):
        for i, axes in enumerate(row):
            # Infinite and missing values show the gray background.
            image = axes.imshow(values[..., i], origin="lower", aspect="auto", **colors)
            axes.set(
                title=names[i], xlabel=column_name, ylabel=row_name, facecolor=style.BACKGROUND
            )
            axes.grid(visible=False)
            axes.label_outer()
        ticks = LogLocator(subs=(1, 2, 5)) if label == ERROR_LABEL else None
        bar = figure.colorbar(
            image, ax=list(row), label=label, fraction=0.05, ticks=ticks, format="{x:g}"
        )
        bar.minorticks_off()
    _set_ticks(grid[0, 0].xaxis, column_values)
    _set_ticks(grid[0, 0].yaxis, row_values)


def _collect(result: SweepResult, *path: str) -> Array:
    """Return a statistic of each point and controller times 100, (points, controllers).

    The statistic is infinite if it is None in the summary, because robots failed. It is NaN for
    points that have not been run.

    Args:
        result: The sweep.
        path: Keys of the statistic in an entry of the summary's "points".
    """
    labels = result.plan.scenario.labels
    values = np.full((len(result.plan.points), len(labels)), np.nan)
    for statistics in result.summary["points"]:
        value: Any = statistics
        for key in path:
            value = value[key]
        index = statistics["point"], labels.index(statistics["controller"])
        values[index] = np.inf if value is None else 100 * value
    return values


def _set_ticks(axis: Axis, levels: Sequence[Any]) -> None:
    """Label at most `MAX_TICKS` values of a setting."""
    step = -(-len(levels) // MAX_TICKS)
    labels = [
        f"{value:.3g}" if isinstance(value, float) else str(value) for value in levels[::step]
    ]
    axis.set_ticks(range(0, len(levels), step), labels)

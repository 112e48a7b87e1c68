"""Figure of one scenario over all seeds: errors, effort and settling time of each controller."""

from collections.abc import Collection
from functools import reduce
from operator import getitem

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.results.result_tables import describe_plant
from omni_mj.results.seed_statistics import SeedStatistics
from omni_mj.results.summary import Entry
from omni_mj.viz import figure_helpers, style

LINE_HEIGHT = 0.3  # of a controller's line, inches
# Largest ratio of an axis's limits. Smaller errors, such as those of rounding, are not visible.
MAX_RANGE = 1e4
SETTLING_TIME = "settling time\nin s"
# Label of a panel -> factor from SI units to the label's, and keys of the statistic in a result
PANELS: dict[str, tuple[float, tuple[str, ...]]] = {
    "maximum position\nerror in cm": (100, ("error_m", "position", "max")),
    "mean position\nerror in cm": (100, ("error_m", "position", "mean")),
    "maximum heading\nerror in °": (180 / np.pi, ("error_rad", "heading", "max")),
    "excess effort\nin m/s²": (1, ("excess_effort_m_s2",)),
    SETTLING_TIME: (1, ("settle_s",)),
}


def draw_seed_statistics(
    scenario: str, entry: Entry, privileged: Collection[str], figure: Figure
) -> None:
    """Draw each controller's means over the seeds with their intervals, a panel per statistic.

    Args:
        scenario: Name of the scenario.
        entry: Entry of the scenario in a summary.
        privileged: Controllers that know the true state.
        figure: Empty figure.
    """
    results = entry["results"]
    figure.set_size_inches(9, 1.4 + LINE_HEIGHT * len(results))
    grid = figure.subplots(1, len(PANELS), sharey=True)
    for axes, (label, (scale, keys)) in zip(grid, PANELS.items(), strict=True):
        spreads = {name: reduce(getitem, keys, result) for name, result in results.items()}
        means = _draw_means(axes, spreads, scale)
        if label == SETTLING_TIME:
            axes.update_datalim([(0, 0), (1, 0)])
        axes.margins(x=0.08)
        if label != SETTLING_TIME and np.isfinite(means).any() and np.nanmin(means) > 0:
            largest = axes.dataLim.x1
            axes.set_xlim(max(np.nanmin(means) / 2, largest / MAX_RANGE), 1.15 * largest)
            figure_helpers.use_log_scale(axes.xaxis)
        axes.set_xlabel(label)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
    labels = [name + " (privileged)" * (name in privileged) for name in results]
    grid[0].set_yticks(range(len(labels)), labels)
    grid[0].set_ylim(len(labels) - 0.5, -0.5)
    n_seeds = len(entry["seeds"])
    seeds = "one seed" if n_seeds == 1 else f"mean of {n_seeds} seeds ± 95 % interval"
    figure.suptitle(f"Controllers compared: {scenario}, {describe_plant(entry)}, {seeds}")


def _draw_means(axes: Axes, spreads: dict[str, SeedStatistics], scale: float) -> Array:
    """Draw a controller's mean and half interval on each line; return the means, scaled.

    The mean is NaN, and is not drawn, if a seed failed or never settled.
    """
    indices, means = style.style_indices(spreads), np.full(len(spreads), np.nan)
    for line, (name, spread) in enumerate(spreads.items()):
        if spread["mean"] is not None:
            means[line] = scale * spread["mean"]
        axes.errorbar(
            means[line],
            line,
            xerr=scale * (spread["ci95_half_width"] or 0.0),
            elinewidth=1.2,
            **style.line_style(indices[name]) | {"linestyle": "none", "label": name},
        )
    return means

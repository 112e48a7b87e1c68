"""Figure of the alpha study: contribution of each cause; gain and lag under each condition."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from omni_mj.studies.alpha.alpha_study import AlphaResult, AlphaStudy
from omni_mj.studies.alpha.operating_conditions import DIRECTIONS, PROFILE_TEXT, WORN_TEXT
from omni_mj.viz import figure_helpers, style

QUANTITY_TITLES = {
    "steady_gain": "steady gain - 1",
    "acceleration_gain": "gain while speeding up - 1",
    "lag_s": "lag in ms",
}
MARKERS = "os^"  # of directions, for readers who cannot distinguish the colors
COLUMNS = 4  # conditions side by side
CAUSES_HEIGHT, CONDITIONS_HEIGHT = 3.2, 4.0  # of the causes and of a row of conditions, inches
BAR_WIDTH = 0.27  # relative to the distance of causes
MAX_LINEAR_RATIO = 30  # largest over smallest value of a condition on a linear axis


def save_alpha_figure(result: AlphaResult, stem: Path) -> None:
    """Draw the contributions of causes above the responses under each condition.

    Args:
        result: Result of a study that was not stopped, with at least one condition.
        stem: Path of the figure without ".png".
    """
    study = result.study
    assert study is not None
    names = list(study.by_condition)
    n_rows = -(-len(names) // COLUMNS)
    heights = [CAUSES_HEIGHT] + [CONDITIONS_HEIGHT] * n_rows
    title = f"Why robots do not reach the commanded speed at once: {PROFILE_TEXT}"
    with figure_helpers.figure_file(stem, title, figsize=(11, 0.4 + sum(heights))) as figure:
        cause_figure, *row_figures = figure.subfigures(
            len(heights), 1, height_ratios=heights, squeeze=False
        )[:, 0]
        cause_title = f"Contribution of each cause: {WORN_TEXT} (Shapley values)"
        cause_figure.suptitle(cause_title, x=0.01, ha="left")
        for axes, quantity in zip(cause_figure.subplots(1, 3), QUANTITY_TITLES, strict=True):
            _draw_causes(study, quantity, axes)
        for i, row_figure in enumerate(row_figures):
            _draw_conditions(study, names[COLUMNS * i : COLUMNS * (i + 1)], row_figure)
        row_figures[0].suptitle("One condition varied, all others nominal", x=0.01, ha="left")
        figure_helpers.add_legend(figure, figure.axes)


def _draw_causes(study: AlphaStudy, quantity: str, axes: Axes) -> None:
    """Draw the contributions of the wheel loop and of each cause to a quantity as bars.

    The contribution of the wheel loop is its deviation from the ideal: gain 1, no lag.
    """
    factor, ideal = (1000.0, 0.0) if quantity == "lag_s" else (1.0, 1.0)
    wheel_loop = getattr(study.wheel_loop, quantity) - ideal
    contributions = {"wheel loop": wheel_loop} | study.contributions(quantity)
    positions = np.arange(len(contributions))
    for i, heights in enumerate(factor * np.array(list(contributions.values())).T):
        axes.bar(positions + (i - 1) * BAR_WIDTH, heights, BAR_WIDTH, color=style.color(i))
    axes.set_xticks(positions, list(contributions))
    axes.axhline(0, color="#888888", lw=0.8)
    axes.set_title(QUANTITY_TITLES[quantity])


def _draw_conditions(study: AlphaStudy, names: list[str], figure: Figure | SubFigure) -> None:
    """Draw a pair of panels, gain above lag, for each condition."""
    grid = figure.subplots(2, COLUMNS, sharex="col", sharey="row")
    grid[0, 0].set_ylabel("gain")
    grid[1, 0].set_ylabel("lag in ms")
    for name, (gain_axes, lag_axes) in zip(names, grid.T, strict=False):
        _draw_condition(study, name, gain_axes, lag_axes)
    for axes in grid[:, len(names) :].flat:
        axes.set_axis_off()


def _draw_condition(study: AlphaStudy, name: str, gain_axes: Axes, lag_axes: Axes) -> None:
    """Draw gain and lag over the values of a condition, a color for each direction."""
    values, response = study.condition_values[name], study.by_condition[name]
    for i, (direction, marker) in enumerate(zip(DIRECTIONS, MARKERS, strict=True)):
        line: dict[str, Any] = {"color": style.color(i), "marker": marker}
        dotted = line | {"ls": ":", "mfc": "white", "label": f"{direction}, speeding up"}
        gain_axes.plot(values, response.steady_gain[:, i], label=f"{direction}, steady", **line)
        gain_axes.plot(values, response.acceleration_gain[:, i], **dotted)
        lag_axes.plot(values, 1000 * response.lag_s[:, i], **line)
    responses = study.by_condition.values()
    min_gain = min(np.nanmin(r.acceleration_gain) for r in responses)
    max_lag = max(np.nanmax(r.lag_s) for r in responses)
    gain_axes.set(title=name, ylim=(min_gain - 0.05, 1.05))
    lag_axes.set_ylim(0, 1.05 * 1000 * max_lag)
    gain_axes.margins(x=0.06)
    if max(values) > MAX_LINEAR_RATIO * min(values) > 0:
        figure_helpers.use_log_scale(gain_axes.xaxis)
    else:
        gain_axes.set_xticks(values, [f"{value:g}" for value in values])

"""Figure of the alpha study: contribution of each cause; gain and lag under each condition."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from omni_mj.studies.alpha.alpha_study import AlphaResult, AlphaStudy
from omni_mj.studies.alpha.operating_conditions import (
    CONDITION_LABELS,
    DIRECTIONS,
    PROFILE_TEXT,
    WORN_TEXT,
)
from omni_mj.viz import plotting, style

QUANTITIES = {
    "steady_gain": "steady gain - 1",
    "acceleration_gain": "gain while speeding up - 1",
    "lag_s": "lag in ms",
}
MARKERS = "os^"  # of directions, for readers who cannot distinguish the colors
COLUMNS = 4  # conditions side by side
CAUSES_IN, CONDITIONS_IN = 3.2, 4.0  # heights of the causes and of a line of conditions, inches
BAR_WIDTH = 0.27  # with a distance of 1 between causes
MAX_LINEAR_RATIO = 30  # largest value over smallest value of a linear axis


def save_alpha_figure(result: AlphaResult, stem: Path) -> None:
    """Draw the contributions of causes above the responses under each condition.

    Args:
        result: Result of a study that was not stopped.
        stem: Path of the figure without ".png".
    """
    study = result.study
    assert study is not None
    names = list(study.by_condition)
    n_lines = -(-len(names) // COLUMNS)
    height = 0.4 + CAUSES_IN + CONDITIONS_IN * n_lines
    title = f"Why robots do not reach the commanded speed at once: {PROFILE_TEXT}"
    with plotting.figure_file(stem, title, figsize=(11, height)) as figure:
        cause_figure, *lines = figure.subfigures(
            1 + n_lines, 1, height_ratios=[CAUSES_IN] + [CONDITIONS_IN] * n_lines, squeeze=False
        )[:, 0]
        cause_figure.suptitle(
            f"Contribution of each cause: {WORN_TEXT} (Shapley values)", x=0.01, ha="left"
        )
        for axes, name in zip(cause_figure.subplots(1, len(QUANTITIES)), QUANTITIES, strict=True):
            _draw_causes(study, name, axes)
        for i, line in enumerate(lines):
            _draw_conditions(study, names[COLUMNS * i : COLUMNS * (i + 1)], line)
        if lines:
            lines[0].suptitle("One condition varied, all others nominal", x=0.01, ha="left")
        plotting.add_legend(figure, figure.axes)


def _draw_causes(study: AlphaStudy, name: str, axes: Axes) -> None:
    """Draw the contributions of the wheel loop and of each cause to a quantity as bars."""
    is_lag = name == "lag_s"
    wheel_loop = getattr(study.wheel_loop, name) - (0.0 if is_lag else 1.0)
    contributions = {"wheel loop": wheel_loop} | study.contributions(name)
    heights = (1000.0 if is_lag else 1.0) * np.array(list(contributions.values()))
    positions = np.arange(len(contributions))
    for i, values in enumerate(heights.T):
        axes.bar(positions + (i - 1) * BAR_WIDTH, values, BAR_WIDTH, color=style.color(i))
    axes.set_xticks(positions, list(contributions))
    axes.axhline(0, color="#888888", lw=0.8)
    axes.set_title(QUANTITIES[name])


def _draw_conditions(study: AlphaStudy, names: list[str], figure: Figure | SubFigure) -> None:
    """Draw a pair of panels, gain above lag, for each condition."""
    grid = figure.subplots(2, COLUMNS, sharex="col", sharey="row")
    grid[0, 0].set_ylabel("gain")
    grid[1, 0].set_ylabel("lag in ms")
    for name, (gain, lag) in zip(names, grid.T, strict=False):
        _draw_condition(study, name, gain, lag)
    for axes in grid[:, len(names) :].flat:
        axes.set_axis_off()


def _draw_condition(study: AlphaStudy, name: str, gain: Axes, lag: Axes) -> None:
    """Draw gain and lag over the values of a condition, a color for each direction."""
    values, response = study.condition_values[name], study.by_condition[name]
    for i, (direction, marker) in enumerate(zip(DIRECTIONS, MARKERS, strict=True)):
        line: dict[str, Any] = {"color": style.color(i), "marker": marker}
        dotted = line | {"ls": ":", "mfc": "white", "label": f"{direction}, speeding up"}
        gain.plot(values, response.steady_gain[:, i], label=f"{direction}, steady", **line)
        gain.plot(values, response.acceleration_gain[:, i], **dotted)
        lag.plot(values, 1000 * response.lag_s[:, i], **line)
    responses = study.by_condition.values()
    lowest = min(np.nanmin(r.acceleration_gain) for r in responses)
    gain.set(title=CONDITION_LABELS[name], ylim=(lowest - 0.05, 1.05))
    lag.set_ylim(0, 1050 * max(np.nanmax(r.lag_s) for r in responses))
    gain.margins(x=0.06)
    if min(values) > 0 and max(values) > MAX_LINEAR_RATIO * min(values):
        plotting.use_log_scale(gain.xaxis)
    else:
        gain.set_xticks(values, [f"{value:g}" for value in values])

"""Figure of the alpha study: gain and lag under each condition, and what each cause contributes."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes

from omni_mj.studies.alpha.operating_conditions import DIRECTIONS, DRIVE_TEXT, LABELS, WORN_TEXT
from omni_mj.viz import style
from omni_mj.viz.figures import plotting

if TYPE_CHECKING:
    from omni_mj.studies.alpha import AlphaResult, AlphaStudy

QUANTITIES = {
    "steady": "steady gain",
    "speeding_up": "gain while speeding up",
    "lag_s": "lag in ms",
}
MARKS = "os^"  # of directions, for readers who cannot tell the colours apart
COLUMNS = 4
BAR = 0.27  # width, if causes are 1 apart
WIDE_RANGE = 30  # ratio of values above which an axis is logarithmic


def save_alpha_figure(result: "AlphaResult", stem: Path) -> None:
    """Draw the study into `stem`.png: conditions in pairs of panels, gain above lag; below them what causes take."""
    study = result.study
    assert study is not None
    names = list(study.changed)
    bands = -(-len(names) // COLUMNS)
    title = f"Gain and lag of a robot's motion: {DRIVE_TEXT}, unless the panel changes it"
    with plotting.figure_file(stem, title, figsize=(11, 3.6 + 4.0 * bands)) as figure:
        *upper, lower = figure.subfigures(
            bands + 1, 1, height_ratios=[4.0] * bands + [3.2], squeeze=False
        )[:, 0]
        pairs: list[Any] = []
        for band in upper:
            grid = band.subplots(2, COLUMNS, sharex="col", sharey="row")
            grid[0, 0].set_ylabel("gain")
            grid[1, 0].set_ylabel("lag in ms")
            pairs += list(grid.T)
        for name, (gain, lag) in zip(names, pairs, strict=False):
            _draw_condition(study, name, gain, lag)
        for axes in np.ravel(pairs[len(names) :]):
            axes.set_axis_off()
        for axes, name in zip(lower.subplots(1, len(QUANTITIES)), QUANTITIES, strict=True):
            _draw_causes(study, name, axes)
        lower.suptitle(
            f"What takes how much ({WORN_TEXT}; mean over all orders, adds up)", x=0.01, ha="left"
        )
        plotting.add_legend(figure, figure.axes)


def _draw_condition(study: "AlphaStudy", name: str, gain: Axes, lag: Axes) -> None:
    """Draw gain and lag over the values of a condition, a colour for each direction."""
    values, result = study.conditions[name], study.changed[name]
    for i, (direction, mark) in enumerate(zip(DIRECTIONS, MARKS, strict=True)):
        look: dict[str, Any] = {"color": style.colour(i), "marker": mark}
        gain.plot(values, result.steady[:, i], label=f"{direction}, steady", **look)
        gain.plot(
            values,
            result.speeding_up[:, i],
            ls=":",
            mfc="white",
            label=f"{direction}, speeding up",
            **look,
        )
        lag.plot(values, 1000 * result.lag_s[:, i], **look)
    results = study.changed.values()
    gain.set(title=LABELS[name], ylim=(min(np.nanmin(r.speeding_up) for r in results) - 0.05, 1.05))
    lag.set_ylim(0, 1050 * max(np.nanmax(r.lag_s) for r in results))
    gain.margins(x=0.06)
    if min(values) > 0 and max(values) > WIDE_RANGE * min(values):
        plotting.use_log_scale(gain.xaxis)
    else:
        gain.set_xticks(values, [f"{value:g}" for value in values])


def _draw_causes(study: "AlphaStudy", name: str, axes: Axes) -> None:
    """Draw what each cause adds to a quantity, and what the wheel loop leaves without any of them."""
    is_lag = name == "lag_s"
    parts = {"wheel loop": getattr(study.loop, name) - (0.0 if is_lag else 1.0)} | study.shares(
        name
    )
    heights = (1000.0 if is_lag else 1.0) * np.array(list(parts.values()))
    causes = np.arange(len(parts))
    for i, direction in enumerate(heights.T):
        axes.bar(causes + (i - 1) * BAR, direction, BAR, color=style.colour(i))
    axes.set_xticks(causes, list(parts))
    axes.axhline(0, color="#888888", lw=0.8)
    axes.set_title(QUANTITIES[name] + ("" if is_lag else ": what is missing of 1"))

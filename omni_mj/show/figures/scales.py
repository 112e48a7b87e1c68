"""Scales of axes as one collection of grid lines and their labels.

Matplotlib makes three lines and two texts of each tick, which are nearly all there is in a figure of many panels.
"""

from typing import Any

from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

APART_PT = 4.0  # labels from the axis, and what the axis is called from them
LINE_PT, LETTER_PT = 10.0, 5.2  # of a label
POINTS_PER_IN = 72
NEAR = 1e-9  # of an axis' length, within which a tick is still on it


def flatten(figure: Figure) -> None:
    """Draw the scales of a figure so, whose limits are final; those of solids stay."""
    for axes in figure.axes:
        if axes.name == "rectilinear":
            _flatten(axes, 0)
            _flatten(axes, 1)


def _flatten(axes: Axes, up: int) -> None:
    """Replace the axis across (0) or up (1)."""
    axis, side = ((axes.xaxis, "bottom"), (axes.yaxis, "left"))[up]
    along = (axes.get_xaxis_transform, axes.get_yaxis_transform)[up]()  # data along the axis, a share of the axes else
    look, (low, high) = axis.get_tick_params(which="major"), sorted(axis.get_view_interval())
    near = NEAR * (high - low)
    ticks = [tick for tick in axis.get_majorticklocs() if low - near <= tick <= high + near]
    labels = axis.get_major_formatter().format_ticks(ticks) if look[f"label{side}"] else []
    if look["gridOn"]:
        lines = [[_at(up, tick, end) for end in (0.0, 1.0)] for tick in ticks]
        grid = {"colors": rcParams["grid.color"], "linewidths": rcParams["grid.linewidth"], "zorder": 0.5}
        axes.add_artist(LineCollection(lines, transform=along, **grid))
    across = {"ha": "right", "va": "center_baseline"} if up else {"ha": "center", "va": "top"}
    for tick, label in zip(ticks, labels, strict=False):
        _write(axes, label, along, up, tick, APART_PT, fontsize=rcParams["xtick.labelsize"], **across)
    deep = LETTER_PT * max(map(len, labels), default=0) if up else LINE_PT * _lines(labels)
    turned = {"ha": "right", "va": "center", "rotation": 90} if up else across
    name, apart = axis.get_label(), deep + (2 * APART_PT if labels else APART_PT)
    _write(axes, name.get_text(), axes.transAxes, up, 0.5, apart, fontsize=name.get_fontsize(), **turned)
    axis.set_visible(False)


def _write(axes: Axes, text: str, along: Any, up: int, at: float, apart: float, **look: Any) -> None:
    """Write a text beside an axis, as many points from it."""
    if not text:
        return
    away = ScaledTranslation(*_at(up, 0.0, -apart / POINTS_PER_IN), axes.figure.dpi_scale_trans)
    axes.text(*_at(up, at, 0.0), text, transform=along + away, color=rcParams["axes.labelcolor"], **look)


def _at(up: int, along: float, beside: float) -> tuple[float, float]:
    return (beside, along) if up else (along, beside)


def _lines(labels: list[str]) -> int:
    return max((label.count("\n") + 1 for label in labels), default=0)

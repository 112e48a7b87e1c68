"""Figure that compares controllers: means over the seeds with their intervals, scenario by scenario."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_mj.measure.table import where
from omni_mj.show import style
from omni_mj.show.figures import canvas

Entry = dict[str, Any]  # a scenario's, in a summary
LINE_IN = 0.1, 0.25  # height of a controller's line with several scenarios; with one
GAP = 1.5  # between scenarios, in lines
MAX_DOTS = 60  # seeds up to which single ones are shown


@dataclass(frozen=True)
class Panel:
    """A statistic of a comparison.

    Args:
        label: Label of its axis.
        spread: Returns its spread over the seeds, from a result.
        scale: Factor from SI units to the label's.
        logarithmic: Whether the axis is.
        missing: Text for a value that not every seed has.
    """

    label: str
    spread: Callable[[Entry], Entry]
    scale: float = 1.0
    logarithmic: bool = True
    missing: str = "failed"


PANELS = (
    Panel("maximum error\nin the plane, cm", lambda result: result["error_m"]["distance"]["max"], 100),
    Panel("mean error\nin the plane, cm", lambda result: result["error_m"]["distance"]["mean"], 100),
    Panel("maximum error\nof heading, deg", lambda result: result["error_rad"]["heading"]["max"], 180 / np.pi),
    Panel("excess effort\nin m/s²", lambda result: result["excess_effort_m_s2"]),
    Panel("time to settle\nin s", lambda result: result["settle_s"], logarithmic=False, missing="never"),
)


def draw_comparison(entries: Mapping[str, Entry], informed: Iterable[str], figure: Figure) -> None:
    """Draw means over the seeds with their intervals, scenario by scenario, a panel per statistic.

    A figure of one scenario shows its seeds as dots as well.

    Args:
        entries: Entries of a summary by label; those without results are left out.
        informed: Controllers that know the truth, drawn hollow.
        figure: Empty figure.
    """
    entries = {label: entry for label, entry in entries.items() if entry["results"]}
    slots = style.slots(name for entry in entries.values() for name in entry["results"])
    tops = np.cumsum([0.0, *(len(entry["results"]) + GAP for entry in entries.values())])
    figure.set_layout_engine("constrained")
    figure.set_size_inches(11, 1.9 + LINE_IN[len(entries) == 1] * tops[-1])
    grid = figure.subplots(1, len(PANELS), sharey=True)
    for axes, panel in zip(grid, PANELS, strict=True):
        shown = []
        for k, (entry, span) in enumerate(zip(entries.values(), pairwise(tops), strict=True)):
            if k % 2 == 0:
                axes.axhspan(*span, color="#F4F4F4", lw=0, zorder=0)
            for line, (name, result) in enumerate(entry["results"].items(), start=1):
                spread, label = panel.spread(result), name + " (informed)" * (name in informed)
                height = span[0] + line + GAP / 2 - 0.5
                _dot(axes, panel, spread, height, slots[name], label)
                if len(entries) == 1 and 1 < len(spread["seeds"]) <= MAX_DOTS:
                    seeds = panel.scale * np.array(spread["seeds"], float)
                    axes.plot(
                        seeds, np.full(len(seeds), height + 0.3), ".", ms=4, mew=0, color="#333333", label="a seed"
                    )
                shown += [spread["mean"]]
        axes.margins(x=0.08)
        smallest = panel.scale * min((mean for mean in shown if mean is not None), default=0.0)
        if panel.logarithmic and smallest > 0:
            axes.set_xlim(smallest / 2, 1.15 * axes.dataLim.x1)
            canvas.use_log_scale(axes.xaxis)
        axes.set_xlabel(panel.label)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
    grid[0].set_yticks((tops[:-1] + tops[1:]) / 2, list(entries))
    grid[0].set_ylim(tops[-1], 0)
    canvas.add_legend(figure, grid)
    places = {where(entry) for entry in entries.values()}
    place = f", {places.pop()}" if len(places) == 1 else ""
    counts = " to ".join(map(str, sorted({len(entry["seeds"]) for entry in entries.values()})))
    over = "one seed, no intervals" if counts == "1" else f"mean of {counts} seeds ± 95 % interval"
    figure.suptitle(f"Controllers compared{place}: {over}")


def _dot(axes: Axes, panel: Panel, spread: Entry, line: float, slot: int, label: str) -> None:
    """Draw a mean with its interval, or the panel's word at the right edge if a seed has no value."""
    look = style.line(slot) | {"linestyle": "none", "label": label}
    if label.endswith(" (informed)"):
        look |= {"markerfacecolor": "white", "markeredgecolor": look["color"], "markeredgewidth": 1.0}
    if spread["mean"] is None or None in spread["seeds"]:
        axes.plot([], [], **look)
        place: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "ha": "right", "va": "center"}
        axes.annotate(panel.missing, (1, line), fontsize=7, color=look["color"], **place)
    else:
        mean, half = panel.scale * spread["mean"], panel.scale * (spread["plus_minus"] or 0.0)
        axes.errorbar(mean, line, xerr=half, elinewidth=1.2, zorder=3, **look)

"""Scenarios or runs side by side: a dot per entry and controller, a panel per statistic; limits as lines."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.measure import limits
from omni_mj.measure.table import counted, where
from omni_mj.show import style
from omni_mj.show.figures import canvas

Entry = dict[str, Any]  # of a scenario, in a summary
LINE_IN = 0.1  # height of a controller's line
GAP = 1.5  # between entries, in lines
LEAST_MARGIN = 1.15  # ratio, on either side of a logarithmic panel
UNKNOWN = "failed"  # the place of a value that not every seed has


@dataclass(frozen=True)
class Panel:
    """A statistic: its label, where a result has its spread, what 1 of it is in the label's unit, how it is shown."""

    label: str
    spread: Callable[[Entry], Entry]
    scale: float = 1.0
    logarithmic: bool = True
    unknown: str = UNKNOWN
    limited: bool = False  # whether a limit has it too


PANELS = (
    Panel("maximum error\nin the plane, cm", lambda result: result["error_m"]["distance"]["max"], 100.0, limited=True),
    Panel("mean error\nin the plane, cm", lambda result: result["error_m"]["distance"]["mean"], 100.0, limited=True),
    Panel("maximum error\nof heading, deg", lambda result: result["error_rad"]["heading"]["max"], 180 / np.pi),
    Panel("excess effort\nin m/s²", lambda result: result["excess_effort_m_s2"]),
    Panel("time to settle\nin s", lambda result: result["settle_s"], logarithmic=False, unknown="never"),
)


def with_results(entries: Mapping[str, Entry]) -> dict[str, Entry]:
    """Those of the entries that have results."""
    return {label: entry for label, entry in entries.items() if entry["results"]}


def comparison(entries: Mapping[str, Entry], informed: Iterable[str] = ()) -> Figure:
    """Means over the seeds with their intervals; what not every seed has stands at "failed" or "never", at the right.

    Args:
        entries: label -> a scenario's entry of a summary, each with results; at least one.
        informed: controllers that know the truth, drawn hollow.
    """
    names = list(dict.fromkeys(name for entry in entries.values() for name in entry["results"]))
    sizes = [len(entry["results"]) + GAP for entry in entries.values()]
    tops = np.concatenate([[0.0], np.cumsum(sizes)])
    figure = Figure(figsize=(11, 1.7 + LINE_IN * tops[-1]))
    grid = figure.subplots(1, len(PANELS), sharey=True)
    found = [(name, result) for entry in entries.values() for name, result in entry["results"].items()]
    inside = [(GAP + 1) / 2 + np.arange(len(entry["results"])) for entry in entries.values()]
    lines = np.concatenate([top + each for top, each in zip(tops, inside, strict=False)])
    drivers = np.array([names.index(name) for name, _ in found])
    for axes, panel in zip(grid, PANELS, strict=True):
        mean, half = _numbers([panel.spread(result) for _, result in found], panel.scale)
        lowest = _limits(axes, panel, entries.values(), tops) if panel.limited else []
        at = _scaled(axes, panel, mean, half, lowest)
        for i, (slot, name) in enumerate(zip(style.slots(names), names, strict=True)):
            own = drivers == i
            look = style.line(slot) | {"linestyle": "none"}
            if name in informed:
                look |= {"markerfacecolor": "white", "markeredgecolor": look["color"], "markeredgewidth": 1.0}
            low = np.maximum(mean - half, 1e-12)[own]  # an interval that reaches zero leaves a logarithmic panel
            axes.hlines(lines[own], low, (mean + half)[own], color=look["color"], lw=1.2, zorder=2)
            axes.plot(at[own], lines[own], label=name + " (informed)" * (name in informed), zorder=3, **look)
        axes.set_xlabel(panel.label)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        for top, bottom in list(pairwise(tops))[::2]:
            axes.axhspan(top, bottom, color="#F4F4F4", lw=0, zorder=0)
    grid[0].set_yticks((tops[:-1] + tops[1:]) / 2, list(entries))
    grid[0].set_ylim(tops[-1], 0)
    canvas.legend(figure, grid[0], 4)
    canvas.title(figure, _title(entries))
    return figure


def _title(entries: Mapping[str, Entry]) -> str:
    """The plant, if it is the same for all, and what the numbers are the mean of."""
    places = {where(entry) for entry in entries.values()}
    same = f", {places.pop()}" if len(places) == 1 else ""
    number = counted(entry["seeds"] for entry in entries.values())
    over = "one seed, no intervals" if number == "1" else f"mean of {number} seeds ± 95 % interval"
    return f"Controllers compared{same}: {over}"


def _numbers(spreads: list[Entry], scale: float) -> tuple[Array, Array]:
    """Means, not a number where a seed has no value, and half intervals, zero where there are none."""
    mean = [np.nan if spread["mean"] is None or None in spread["seeds"] else spread["mean"] for spread in spreads]
    half = [spread["plus_minus"] or 0.0 for spread in spreads]
    return scale * np.array(mean), scale * np.array(half)


def _limits(axes: Axes, panel: Panel, entries: Iterable[Entry], tops: Array) -> list[float]:
    """Draw the limits that are known as lines over their entries, and return where they are."""
    drawn = []
    for entry, (top, bottom) in zip(entries, pairwise(tops), strict=True):
        for name, errors in limits.of(entry).items():
            value = panel.spread({"error_m": errors})["mean"]
            if value is not None:
                drawn.append(panel.scale * value)
                canvas.mark_limit(axes, drawn[-1], name, (top, bottom))
    return drawn


def _scaled(axes: Axes, panel: Panel, mean: Array, half: Array, shown: list[float]) -> Array:
    """Scale a panel and return where its dots are: the means, and those unknown at a place right of them.

    Besides, what is `shown` is to be seen.
    """
    unknown = np.isnan(mean)
    known = np.concatenate([mean[~unknown], shown])
    around = np.concatenate([half[~unknown], np.zeros(len(shown))])
    if panel.logarithmic and known.size and known.min() > 0:
        low, high = np.maximum(known - around, known / 2).min(), (known + around).max()
        margin = max(LEAST_MARGIN, (high / low) ** 0.05)
        low, high = low / margin, high * margin
        canvas.logarithmic(axes, low, high)
        place, end = high * (high / low) ** 0.25, high
    else:
        end = float(np.max(known + around, initial=0.1))
        axes.set_xlim(-0.05 * end, 1.05 * end)
        place = 1.25 * end
    if unknown.any():
        _leave_room(axes, end, place, panel.unknown)
    return np.where(unknown, place, mean)


def _leave_room(axes: Axes, end: float, place: float, name: str) -> None:
    """Make room right of the known values, which end at `end`, for a tick `name` at `place`."""
    low = axes.get_xlim()[0]
    ticks = [tick for tick in axes.get_xticks() if max(low, 0.0) <= tick <= end]
    between = (end * place) ** 0.5 if axes.get_xscale() == "log" else (end + place) / 2
    beyond = place * place / between if axes.get_xscale() == "log" else 2 * place - between
    axes.set_xlim(low, beyond)
    axes.set_xticks([*ticks, place], [*(f"{tick:g}" for tick in ticks), name])
    axes.axvline(between, color="#888888", lw=0.8, ls=":")

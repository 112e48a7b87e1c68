"""The figure of `omni-mj compare`: a dot per scenario and controller, one panel per statistic."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import style as matplotlib_style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from omni_mj.show import style
from omni_mj.show.compare_table import title
from omni_mj.show.figures import canvas

Result = dict[str, Any]
LINE_IN = 0.1  # height of a controller's line
SETTLING = "time to settle in s"
GAP = 1.5  # between scenarios, in lines
MANY = 200.0  # ratio of greatest to least above which 1, 2, 5 are too many ticks for a decade


def save(result: Result, stem: Path) -> None:
    """Draw what was done, at least one scenario, into `stem`.png and `stem`.svg."""
    with matplotlib_style.context(style.SHEET):
        canvas.save(draw(result), stem)


def draw(result: Result) -> Figure:
    """Means over the seeds with their intervals; a controller that some seed does not settle with is at "not"."""
    scenarios = {name: entry["results"] for name, entry in result["scenarios"].items() if entry["status"] == "done"}
    controllers = result["controllers"]
    block = len(controllers) + GAP
    figure = Figure(figsize=(9, 1.5 + LINE_IN * block * len(scenarios)))
    grid = figure.subplots(1, 4, sharey=True)
    found = [results[name] for results in scenarios.values() for name in controllers]
    lines = np.array(
        [row * block + (GAP + 1) / 2 + i for row in range(len(scenarios)) for i in range(len(controllers))]
    )
    panels = {
        "maximum error in cm": _in_cm([each["error_m"]["position"]["max"] for each in found]),
        "mean error in cm": _in_cm([each["error_m"]["position"]["mean"] for each in found]),
        "effort in m/s²": _numbers([each["effort_m_s2"] for each in found]),
        SETTLING: _numbers([each["settle_s"] for each in found]),
    }
    for axes, (label, (mean, half)) in zip(grid, panels.items(), strict=True):
        if label == SETTLING:
            mean = _linear_scale(axes, mean, half)
        else:
            _log_scale(axes, mean, half)
        for i, name in enumerate(controllers):
            own = slice(i, None, len(controllers))
            look = style.line(i) | {"linestyle": "none"}
            if name in result["limits"]:
                look |= {"markerfacecolor": "white", "markeredgecolor": look["color"], "markeredgewidth": 1.0}
            low = np.maximum(mean - half, 1e-12)[own]  # an interval that reaches zero leaves a logarithmic panel
            axes.hlines(lines[own], low, (mean + half)[own], color=look["color"], lw=1.2, zorder=2)
            axes.plot(mean[own], lines[own], label=name + " (limit)" * (name in result["limits"]), zorder=3, **look)
        axes.set_xlabel(label)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        for row in range(0, len(scenarios), 2):
            axes.axhspan(row * block, (row + 1) * block, color="#F4F4F4", lw=0, zorder=0)
    grid[0].set_yticks((np.arange(len(scenarios)) + 0.5) * block, list(scenarios))
    grid[0].set_ylim(block * len(scenarios), 0)
    canvas.legend(figure, grid[0], 4)
    figure.suptitle(title(result), x=0.01, ha="left")
    return figure


def _numbers(spreads: list[Result]) -> tuple[np.ndarray, np.ndarray]:
    """Means, not a number where a seed has no value, and half intervals, zero where there are none."""
    mean = [np.nan if None in spread["seeds"] else spread["mean"] for spread in spreads]
    return np.array(mean), np.array([spread["plus_minus"] or 0.0 for spread in spreads])


def _in_cm(spreads: list[Result]) -> tuple[np.ndarray, np.ndarray]:
    mean, half = _numbers(spreads)
    return 100 * mean, 100 * half


def _log_scale(axes: Axes, mean: np.ndarray, half: np.ndarray) -> None:
    if mean.min() <= 0:
        return
    low, high = np.maximum(mean - half, mean / 2).min() / 1.15, 1.15 * (mean + half).max()
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(LogLocator(subs=(1,) if high > MANY * low else (1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    if high <= MANY * low:
        axes.xaxis.set_minor_locator(NullLocator())


def _linear_scale(axes: Axes, mean: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Scale the panel of times and return the means with a place right of them, the tick "not", for those unknown."""
    top = float(np.nanmax(mean + half, initial=0.1))
    unknown = np.isnan(mean)
    axes.set_xlim(-0.05 * top, (1.35 if unknown.any() else 1.05) * top)
    if unknown.any():
        ticks = [tick for tick in axes.get_xticks() if 0 <= tick <= top]
        axes.set_xticks([*ticks, 1.25 * top], [*(f"{tick:g}" for tick in ticks), "not"])
        axes.axvline(1.12 * top, color="#888888", lw=0.8, ls=":")
    return np.where(unknown, 1.25 * top, mean)

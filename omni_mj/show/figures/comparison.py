"""Several runs side by side."""

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from omni_mj.measure.metrics import AXES
from omni_mj.show import style
from omni_mj.show.figures import canvas

WIDE = 20.0  # ratio of the greatest error to the least above which the axis is logarithmic


def comparison(summaries: Mapping[str, dict[str, Any]]) -> Figure:
    """Maximum error of each run's controllers along x and y: the median over seeds, a line from least to greatest.

    Args:
        summaries: run's label -> its summary; one without results is left out.
    """
    summaries = {label: summary for label, summary in summaries.items() if summary["results"]}
    names = list(dict.fromkeys(name for summary in summaries.values() for name in summary["results"]))
    rows = sum(len(summary["results"]) + 1 for summary in summaries.values())
    figure = Figure(figsize=(8, 1.4 + 0.2 * rows))
    grid = figure.subplots(1, 2, sharey=True)
    medians = []
    for axis, axes in zip(AXES, grid, strict=True):
        top, middles = 0.0, []
        for summary in summaries.values():
            results = summary["results"]
            middles.append(top + (len(results) + 1) / 2)
            for y, (name, result) in enumerate(results.items(), 1):
                spread = {key: 100 * value for key, value in result["error_m"][axis]["max"].items()}
                i = names.index(name)
                axes.plot([spread["min"], spread["max"]], [top + y] * 2, color=style.controller(i), lw=1.5)
                dot = style.line(i)
                axes.plot(
                    spread["median"],
                    top + y,
                    label=name,
                    **dot | {"linestyle": "none", "markersize": 1.5 * dot["markersize"]},
                )
                medians.append(spread["median"])
            top += len(results) + 1
            axes.axhline(top, color="#BBBBBB", lw=0.6)
        axes.set_yticks(middles, list(summaries))
        axes.set_ylim(top, 0)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel(f"maximum error in ${axis}$ in cm")
    for axes in grid:
        axes.margins(x=0.06)
        if min(medians) > 0 and max(medians) > WIDE * min(medians):
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_locator(NullLocator())
        else:
            axes.set_xlim(left=0)
    canvas.legend(figure, list(grid))
    figure.suptitle("Maximum errors", x=0.01, ha="left")
    return figure

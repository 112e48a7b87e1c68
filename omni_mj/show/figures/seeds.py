"""Box plots of the errors over the seeds."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_mj.measure import limits
from omni_mj.show import style
from omni_mj.show.figures import canvas

FEWEST = 3  # seeds that make a box
MOST_DOTS = 60  # seeds beyond which single ones are not shown
STATISTICS = {"max": "maximum", "mean": "mean"}
# Axis -> where its errors are in a result, their name, their unit, and how many of that are 1 m or 1 rad.
ERRORS = {
    "x": ("error_m", "x", "cm", 100.0),
    "y": ("error_m", "y", "cm", 100.0),
    "distance": ("error_m", "the plane", "cm", 100.0),
    "heading": ("error_rad", "heading", "deg", 180 / np.pi),
}
PANEL_IN = 2.7
APART = 10.0  # ratio of greatest to least of a panel above which its scale is logarithmic


def seeds(entry: dict[str, Any], heading: bool) -> Figure:
    """Maximum and mean error of each controller and axis: a box from quartile to quartile, whiskers to the ends.

    Where errors are far apart their scale is logarithmic.

    Args:
        entry: a scenario's, of the summary.
        heading: whether there are errors of heading to be shown.
    """
    results, paper = entry["results"], entry["paper"] or {}
    axes = [axis for axis in ERRORS if axis != "heading" or heading]
    figure = Figure(figsize=(PANEL_IN * len(axes), 1.6 + 2 * 0.36 * (len(results) + 1)))
    grid = figure.subplots(2, len(axes), sharey=True)
    rows, slots = np.arange(len(results))[::-1], style.slots(list(results))
    count = 0
    for (key, label), line in zip(STATISTICS.items(), grid, strict=True):
        for axis, panel in zip(axes, line, strict=True):
            part, name, unit, scale = ERRORS[axis]
            drawn: list[float] = []
            for i, (controller, result) in enumerate(results.items()):
                errors = result[part][axis][key]["seeds"]
                count = max(count, len(errors))
                drawn += [scale * error for error in errors if error is not None]
                _box(panel, scale * np.array(errors, float), rows[i], slots[i])
                printed = paper.get(controller, {}).get(axis)
                if printed:
                    drawn.append(scale * printed[key])
                    panel.plot(scale * printed[key], rows[i], "D", ms=6, mec="black", mfc="white", zorder=4,
                               label="the paper")  # fmt: skip
            for known, errors in limits.of(entry).items():
                if part == "error_m" and errors[axis][key]["median"] is not None:
                    drawn.append(scale * errors[axis][key]["median"])
                    canvas.mark_limit(panel, scale * errors[axis][key]["median"], known)
            _scale(panel, drawn)
            panel.grid(axis="y", visible=False)
            panel.set_xlabel(f"{label} |error| in {name}, {unit}")
    grid[0, 0].set_yticks(rows, [_label(name, result["failed"]) for name, result in results.items()])
    grid[0, 0].set_ylim(-0.6, len(results) - 0.4)
    canvas.legend(figure, list(grid.flat))
    figure.suptitle(f"Errors over {count} seeds")
    return figure


def _scale(axes: Axes, drawn: list[float]) -> None:
    """Let all of what is drawn across be seen."""
    low, high = min(drawn, default=0.0), max(drawn, default=0.0)
    if high > APART * low > 0:
        margin = (high / low) ** 0.05
        canvas.logarithmic(axes, low / margin, high * margin)
    else:
        axes.margins(x=0.05)
        axes.set_xlim(left=0)


def _box(axes: Axes, values: np.ndarray, row: int, slot: int) -> None:
    """Draw a controller's errors (seeds,), not a number where it failed."""
    known = ~np.isnan(values)
    if not known.any():
        return
    drawn = axes.boxplot(
        [values[known]], positions=[row], orientation="horizontal", widths=0.55, whis=(0, 100), showfliers=False,
        patch_artist=True, medianprops={"color": "black", "linewidth": 1.6}, zorder=2, manage_ticks=False,
    )  # fmt: skip
    drawn["boxes"][0].set(facecolor=style.colour(slot) + "55", edgecolor=style.colour(slot))
    if len(values) <= MOST_DOTS:
        spread = 0.16 * np.linspace(-1, 1, len(values))  # one seed keeps its height in all boxes
        axes.plot(values[known], row + spread[known], "o", ms=3, mew=0, color="#333333", zorder=3, label="a seed")


def _label(controller: str, failed: int) -> str:
    return f"{controller}\n({failed} failed)" if failed else controller

"""Figures of a run, from each controller's first row but for the one over all seeds; and of comparisons."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from omni_mj.results.result_tables import where
from omni_mj.viz import style
from omni_mj.viz.figures import plotting, run_figures
from omni_mj.viz.recorded_robots import select_robots

if TYPE_CHECKING:
    from omni_mj.results.result import Outcome

FEWEST_SEEDS = 3  # that make a figure
TITLES = {
    "path": "Path travelled, and enlarged, in cm, where each controller strays farthest",
    "output": "Velocities commanded",
    "error": "Absolute errors",
    "alpha": "Motor correction factor alpha",
}
Entry = dict[str, Any]  # a scenario's, in a summary
LINE_IN = 0.1, 0.25  # height of a controller's line with several scenarios; with one
GAP = 1.5  # between scenarios, in lines
# Ratio of the limits of an axis; smaller errors, such as those of rounding, are left of it
WIDEST = 1e4
SETTLE = "time to settle\nin s"
# Label of a panel -> factor from SI units to the label's, and the spread over the seeds, from a
# result.
PANELS: dict[str, tuple[float, Callable[[Entry], Entry]]] = {
    "maximum error\nin the plane, cm": (100, lambda result: result["error_m"]["distance"]["max"]),
    "mean error\nin the plane, cm": (100, lambda result: result["error_m"]["distance"]["mean"]),
    "maximum error\nof heading, deg": (
        180 / np.pi,
        lambda result: result["error_rad"]["heading"]["max"],
    ),
    "excess effort\nin m/s²": (1, lambda result: result["excess_effort_m_s2"]),
    SETTLE: (1, lambda result: result["settle_s"]),
}


def save_run_figures(outcome: "Outcome", folder: Path, svg: bool = False) -> None:
    """Write each figure that a scenario's outcome has data for into `folder`, as PNG.

    Args:
        outcome: Outcome of the scenario; without a log nothing is drawn.
        folder: Folder, created if needed.
        svg: Whether to write SVGs as well.
    """
    log = outcome.log
    if log is None or not log.lengths.any():
        return
    folder.mkdir(parents=True, exist_ok=True)
    first = [failure for failure in outcome.failures if failure.seed == log.seeds[0]]
    stopped = [
        f"{failure.controller} failed at {failure.time_s:.2f} s: {failure.cause}"
        for failure in first
    ]
    place = f"{outcome.scenario.name}, {where(outcome.entry)}, seed {log.seeds[0]}"
    for name, draw in drawings(outcome).items():
        title = "\n".join([f"{TITLES[name]}: {place}", *stopped]) if name in TITLES else ""
        with plotting.figure_file(folder / name, title, svg) as figure:
            draw(figure)


def drawings(outcome: "Outcome") -> dict[str, Callable[[Figure], None]]:
    """Return the functions that draw the figures for which an outcome has data, by name."""
    assert outcome.log
    robots = [robot for robot in select_robots(outcome.log, 1) if robot.length]
    stopped = {failure.row for failure in outcome.failures}
    failed = {robot.name for robot in robots if robot.row in stopped}
    figures: dict[str, Callable[[Figure], None]] = {
        "path": partial(run_figures.draw_paths, robots, failed),
        "output": partial(run_figures.draw_output, robots, failed),
        "error": partial(run_figures.draw_errors, robots, failed),
    }
    if estimators := run_figures.estimators(robots):
        figures["alpha"] = partial(run_figures.draw_alpha, estimators)
    if len(outcome.log.seeds) >= FEWEST_SEEDS:
        figures["seeds"] = partial(draw_comparison, {outcome.scenario.name: outcome.entry}, ())
    return figures


def save_comparison(summary: dict[str, Any], stem: Path) -> None:
    """Draw a comparison into `stem`.png and `stem`.svg, if any of its scenarios has results."""
    if any(entry["results"] for entry in summary["scenarios"].values()):
        with plotting.figure_file(stem, svg=True) as figure:
            draw_comparison(summary["scenarios"], summary["informed"], figure)


def draw_comparison(entries: Mapping[str, Entry], informed: Iterable[str], figure: Figure) -> None:
    """Draw means over the seeds with their intervals, scenario by scenario, a panel per statistic.

    Args:
        entries: Entries of a summary by label; those without results are left out.
        informed: Controllers that know the truth.
        figure: Empty figure.
    """
    entries = {label: entry for label, entry in entries.items() if entry["results"]}
    slots = style.style_indices(name for entry in entries.values() for name in entry["results"])
    tops = np.cumsum([0.0, *(len(entry["results"]) + GAP for entry in entries.values())])
    figure.set_size_inches(11, 1.9 + LINE_IN[len(entries) == 1] * tops[-1])
    lines: dict[str, list[tuple[float, Entry]]] = {name: [] for name in slots}
    for entry, top in zip(entries.values(), tops, strict=False):
        for i, (name, result) in enumerate(entry["results"].items()):
            lines[name].append((top + i + (GAP + 1) / 2, result))
    grid = figure.subplots(1, len(PANELS), sharey=True)
    for axes, (title, (scale, spread_of)) in zip(grid, PANELS.items(), strict=True):
        smallest = np.inf
        for name, points in lines.items():
            spreads = [spread_of(result) for _, result in points]
            # What a seed lacks, since it failed or never settled, is no number and not drawn.
            means = [None if None in spread["seeds"] else spread["mean"] for spread in spreads]
            values, half = (
                scale * np.array(numbers, float)
                for numbers in (means, [spread["plus_minus"] or 0 for spread in spreads])
            )
            look = style.line_style(slots[name]) | {
                "linestyle": "none",
                "label": name + " (informed)" * (name in informed),
            }
            axes.errorbar(
                values, [height for height, _ in points], xerr=half, elinewidth=1.2, **look
            )
            smallest = np.nanmin(values, initial=smallest)
        for top in tops[1:-1]:
            axes.axhline(top, color="#DDDDDD", lw=0.8, zorder=0)
        axes.margins(x=0.08)
        if title != SETTLE and 0 < smallest < np.inf:
            largest = axes.dataLim.x1
            axes.set_xlim(max(smallest / 2, largest / WIDEST), 1.15 * largest)
            plotting.use_log_scale(axes.xaxis)
        axes.set_xlabel(title)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
    grid[0].set_yticks((tops[:-1] + tops[1:]) / 2, list(entries))
    grid[0].set_ylim(tops[-1], 0)
    plotting.add_legend(figure, grid)
    places = {where(entry) for entry in entries.values()}
    where_all = f", {places.pop()}" if len(places) == 1 else ""
    counts = " to ".join(map(str, sorted({len(entry["seeds"]) for entry in entries.values()})))
    over = "one seed, no intervals" if counts == "1" else f"mean of {counts} seeds ± 95 % interval"
    figure.suptitle(f"Controllers compared{where_all}: {over}")

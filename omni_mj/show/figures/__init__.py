"""Figures of a run, from each controller's first row but for the one over all seeds; and of comparisons."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from omni_mj.measure.table import where
from omni_mj.show.figures import canvas, comparison, paths, series
from omni_mj.show.shown import shown_robots

if TYPE_CHECKING:
    from omni_mj.measure.result import Outcome

FEWEST_SEEDS = 3  # that make a figure


def save_all(outcome: "Outcome", folder: Path, svg: bool = False) -> None:
    """Write each figure that a scenario's outcome has data for into `folder`, as PNG.

    Args:
        outcome: Outcome of the scenario; without a log nothing is drawn.
        folder: Folder, created if needed.
        svg: Whether to write SVGs as well.
    """
    if outcome.log is None or not outcome.log.lengths.any():
        return
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in drawings(outcome).items():
        with canvas.drawing(folder / name, svg=svg) as figure:
            draw(figure)


def drawings(outcome: "Outcome") -> dict[str, Callable[[Figure], None]]:
    """Return the functions that draw the figures for which an outcome has data, by name."""
    log, scenario = outcome.log, outcome.scenario
    assert log
    robots = shown_robots(log, 1)
    by_row = {failure.row: failure for failure in outcome.failures}
    failures = {robot.name: by_row[robot.row] for robot in robots if robot.row in by_row}
    place = f"{scenario.name}, {where(outcome.entry)}, seed {log.seeds[0]}"
    titles = [f"{name} failed at {failure.time_s:.2f} s: {failure.cause}" for name, failure in failures.items()]

    def over_time(draw: Callable[..., None], figure: Figure) -> None:
        draw(robots, failures, figure)
        figure.suptitle("\n".join([f"{figure.get_suptitle()}: {place}", *titles]))

    functions = {"path": paths.draw_paths, "output": series.draw_output, "error": series.draw_errors}
    functions["why"] = series.draw_causes
    if series.estimators(robots):
        functions["alpha"] = series.draw_alpha
    figures: dict[str, Callable[[Figure], None]] = {name: partial(over_time, draw) for name, draw in functions.items()}
    if len(log.seeds) >= FEWEST_SEEDS:
        figures["seeds"] = partial(comparison.draw_comparison, {scenario.name: outcome.entry}, ())
    return figures


def save_comparison(summary: dict[str, Any], stem: Path) -> None:
    """Draw a comparison into `stem`.png and `stem`.svg, if any of its scenarios has results."""
    if any(entry["results"] for entry in summary["scenarios"].values()):
        with canvas.drawing(stem, svg=True) as figure:
            comparison.draw_comparison(summary["scenarios"], summary["informed"], figure)

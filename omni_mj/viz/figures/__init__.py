"""Figures of a run: of each controller's first row, and of errors and effort over all seeds."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from omni_mj.results.result_tables import describe_plant
from omni_mj.viz.figures import plotting, run_figures
from omni_mj.viz.figures.seed_figure import draw_seed_statistics
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
    place = f"{outcome.scenario.name}, {describe_plant(outcome.entry)}, seed {log.seeds[0]}"
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
        name, entry = outcome.scenario.name, outcome.entry
        figures["seeds"] = partial(draw_seed_statistics, name, entry, ())
    return figures

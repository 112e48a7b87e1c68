"""Figures of a run: paths, commands, errors and alpha of the first seed, and statistics of all."""

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

MIN_SEEDS = 3  # for a figure of statistics over seeds
TITLES = {
    "error": "Absolute errors in x, y and heading",
    "path": "Paths in m, and close-ups in cm of the points farthest from the reference",
    "command": "Commanded velocities in the world frame, compared with the reference's",
    "alpha": "Motor correction factor alpha, estimated and measured",
}


def save_run_figures(outcome: "Outcome", folder: Path, svg: bool = False) -> None:
    """Save each figure for which an outcome has data as a PNG file.

    Args:
        outcome: Outcome of a scenario; without a log nothing is drawn.
        folder: Folder for the files, created if needed.
        svg: Whether to save SVG files as well.
    """
    log = outcome.log
    if log is None or not log.lengths.any():
        return
    folder.mkdir(parents=True, exist_ok=True)
    seed = log.seeds[0]
    context = f"{outcome.scenario.name}, {describe_plant(outcome.entry)}, seed {seed}"
    failures = [
        f"{failure.controller} failed at {failure.time_s:.2f} s: {failure.cause}"
        for failure in outcome.failures
        if failure.seed == seed
    ]
    for name, draw in choose_figures(outcome).items():
        title = "\n".join([f"{TITLES[name]}: {context}", *failures]) if name in TITLES else ""
        with plotting.figure_file(folder / name, title, svg) as figure:
            draw(figure)


def choose_figures(outcome: "Outcome") -> dict[str, Callable[[Figure], None]]:
    """Return, by file name, a function that draws each figure for which an outcome has data."""
    assert outcome.log
    robots = [robot for robot in select_robots(outcome.log, 1) if robot.length]
    failed_rows = {failure.row for failure in outcome.failures}
    failed = {robot.name for robot in robots if robot.row in failed_rows}
    figures: dict[str, Callable[[Figure], None]] = {
        "error": partial(run_figures.draw_errors, robots, failed),
        "path": partial(run_figures.draw_paths, robots, failed),
        "command": partial(run_figures.draw_commands, robots, failed),
    }
    if estimators := run_figures.select_alpha_estimators(robots):
        figures["alpha"] = partial(run_figures.draw_alpha, estimators)
    if len(outcome.log.seeds) >= MIN_SEEDS:
        name, entry = outcome.scenario.name, outcome.entry
        figures["seeds"] = partial(draw_seed_statistics, name, entry, ())
    return figures

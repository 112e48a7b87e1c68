"""Figures of a run, from each controller's first row but for the one over all seeds; and of comparisons."""

from collections.abc import Callable, Mapping
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from omni_mj.measure.table import where
from omni_mj.scenarios.settings import ControlSettings
from omni_mj.show.figures import canvas, comparison, controller, paths, series
from omni_mj.show.figures.first import FirstRows

if TYPE_CHECKING:
    from omni_mj.measure.result import Outcome

OVER_TIME = ("path", "output", "error", "why", "alpha")
FEWEST_SEEDS = 3  # that make a figure


def save_all(outcome: "Outcome", folder: Path, svg: bool = False) -> None:
    """Write each figure that a scenario's outcome has data for into `folder`, as PNG.

    Args:
        outcome: Outcome of the scenario; without a log nothing is drawn.
        folder: Folder, created if needed.
        svg: Whether to write SVGs as well.
    """
    log, scenario = outcome.log, outcome.scenario
    if log is None or not log.lengths.any():
        return
    first = FirstRows(log, outcome.failures)
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in drawings(first, {scenario.name: outcome.entry}, scenario.settings.control).items():
        with canvas.drawing(folder / name, svg=svg, layout="none") as figure:
            draw(figure)
            title = [figure.get_suptitle()]
            if name in OVER_TIME:
                title[0] += f": {scenario.name}, {where(outcome.entry)}, seed {log.seeds[0]}"
                title += [f"{f.controller} failed at {f.time_s:.2f} s: {f.cause}" for f in first.failed.values()]
            figure.suptitle("\n".join(title))


def drawings(
    first: FirstRows, entry: Mapping[str, dict[str, Any]], control: ControlSettings
) -> dict[str, Callable[[Figure], None]]:
    """Return the functions that draw the figures for which a run has data, by name.

    Args:
        first: Rows that figures over time show.
        entry: The run's entry of the summary by its scenario's name.
        control: Settings of the fuzzy controller.
    """
    functions: dict[str, Callable[[Figure], None]] = {
        "path": partial(paths.draw_paths, first),
        "output": partial(series.draw_output, first),
        "error": partial(series.draw_errors, first),
        "why": partial(series.draw_causes, first),
    }
    if series.estimators(first):
        functions["alpha"] = partial(series.draw_alpha, first)
    if len(first.log.seeds) >= FEWEST_SEEDS:
        functions["seeds"] = partial(comparison.draw_comparison, entry, ())
    functions["memberships"] = partial(controller.draw_memberships, control)
    return functions


def save_comparison(summary: dict[str, Any], stem: Path) -> None:
    """Draw a comparison into `stem`.png and `stem`.svg, if any of its scenarios has results."""
    if any(entry["results"] for entry in summary["scenarios"].values()):
        with canvas.drawing(stem, svg=True) as figure:
            comparison.draw_comparison(summary["scenarios"], summary["informed"], figure)


def comparison_svg(entries: Mapping[str, dict[str, Any]], informed: tuple[str, ...] = ()) -> bytes:
    """Return the figure that compares scenarios or runs as SVG.

    Args:
        entries: Entries of summaries by label; at least one has results.
        informed: Controllers that know the truth.
    """
    file = BytesIO()
    with canvas.styled():
        figure = Figure()
        comparison.draw_comparison(entries, informed, figure)
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()

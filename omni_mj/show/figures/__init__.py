"""The figures of a run, drawn from its first seed, but for the box plots over all seeds."""

from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib import style as matplotlib_style
from matplotlib.figure import Figure

from omni_mj.scenarios.settings import Settings
from omni_mj.show import style
from omni_mj.show.figures import comparison, controller, heat, paths, seeds, series
from omni_mj.show.figures.canvas import save
from omni_mj.simulate.log import Trajectory

NAMES = ("path", "output", "error", "alpha", "temperatures", "seeds", "memberships", "surface")
OF_THE_CONTROLLER = ("memberships", "surface")
PaperTable = dict[str, dict[str, dict[str, float]]]


def save_all(
    trajectory: Trajectory,
    title: str,
    folder: Path,
    settings: Settings | None = None,
    paper: PaperTable | None = None,
) -> None:
    """Write each figure that the run has data for into `folder`, as PNG and as SVG.

    Args:
        trajectory: what was recorded, at least one frame.
        title: scenario and plant, put into the titles of the figures that depend on them.
        folder: made if need be.
        settings: those of the run: the fuzzy controller's ranges, the windings' limit. [the defaults]
        paper: the table of the paper (see `paper.TABLES`) to mark in the box plots.
    """
    folder.mkdir(exist_ok=True)
    with matplotlib_style.context(style.SHEET):
        for name, draw in drawings(trajectory, settings or Settings(), paper).items():
            figure = draw()
            of_a_seed = "" if name == "seeds" else f", seed {trajectory.seeds[0]}"
            heading = figure.get_suptitle() + ("" if name in OF_THE_CONTROLLER else f": {title}{of_a_seed}")
            figure.suptitle(heading, x=0.01, ha="left")
            save(figure, folder / name)


def comparison_svg(summaries: Mapping[str, dict[str, Any]]) -> bytes:
    """The figure that compares several runs, given their labels and summaries."""
    file = BytesIO()
    with matplotlib_style.context(style.SHEET):
        comparison.comparison(summaries).savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def drawings(trajectory: Trajectory, settings: Settings, paper: PaperTable | None) -> dict[str, Callable[[], Figure]]:
    """The figures that the run has data for, by name, as functions that draw them."""
    figures: dict[str, Callable[[], Figure]] = {
        "path": lambda: paths.path(trajectory),
        "output": lambda: series.output(trajectory),
        "error": lambda: series.error(trajectory),
        "alpha": lambda: series.alpha(trajectory),
    }
    if heat.has_temperatures(trajectory):
        figures["temperatures"] = lambda: heat.temperatures(trajectory, settings.motor.limit_c)
    if len(trajectory.seeds) >= seeds.FEWEST:
        figures["seeds"] = lambda: seeds.seeds(trajectory, paper)
    figures["memberships"] = lambda: controller.memberships(settings.control)
    figures["surface"] = lambda: controller.surface(settings.control)
    return figures

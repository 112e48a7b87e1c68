"""The figures of a run, drawn from each controller's first row, but for the box plots over all seeds."""

import gc
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib import style as matplotlib_style
from matplotlib.figure import Figure

from omni_mj.measure.table import where
from omni_mj.scenarios.settings import ControlSettings
from omni_mj.show import style
from omni_mj.show.figures import canvas, comparison, controller, heat, paths, seeds, series, why
from omni_mj.show.figures.first import FirstRows

if TYPE_CHECKING:
    from omni_mj.measure.result import Outcome

OVER_TIME = ("path", "output", "error", "why", "alpha", "temperatures")
OF_THE_CONTROLLER = ("memberships", "surface")


def save_all(outcome: "Outcome", folder: Path, svg: bool = False) -> None:
    """Write each figure that a scenario's outcome has data for into `folder`, as PNG.

    Args:
        outcome: of the scenario; where nothing was recorded there is nothing to draw.
        folder: made if need be.
        svg: whether to write them as SVG too, which takes about as long again.
    """
    log, scenario = outcome.log, outcome.scenario
    if log is None:
        return
    first = FirstRows(log, outcome.failures)
    if not first.length:
        return
    folder.mkdir(parents=True, exist_ok=True)
    title = f"{scenario.name}, {where(outcome.entry)}"
    with matplotlib_style.context(style.SHEET), _nothing_collected():
        for name, draw in drawings(first, outcome.entry, scenario.settings.control).items():
            figure = draw()
            of_the_run = "" if name in OF_THE_CONTROLLER else f": {title}"
            of_a_seed = f", seed {log.seeds[0]}" if name in OVER_TIME else ""
            notes = first.said() if name in OVER_TIME else []
            explained = series.ALPHA_SAID if name == "alpha" else ""
            canvas.title(figure, figure.get_suptitle() + of_the_run + of_a_seed, notes, explained)
            canvas.save(figure, folder / name, svg)


@contextmanager
def _nothing_collected() -> Iterator[None]:
    """Without collecting what is no longer of use: of so many small things that are, that takes a tenth of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def save_comparison(summary: dict[str, Any], stem: Path) -> None:
    """Draw what was done of a comparison into `stem`.png and `stem`.svg; nothing where nothing was.

    Args:
        summary: as saved, of several scenarios or one.
        stem: of the files; their folder must exist.
    """
    entries = comparison.with_results(summary["scenarios"])
    if entries:
        with matplotlib_style.context(style.SHEET):
            canvas.save(comparison.comparison(entries, summary["informed"]), stem)


def comparison_svg(entries: Mapping[str, dict[str, Any]], informed: tuple[str, ...] = ()) -> bytes:
    """The figure that compares scenarios or runs.

    Args:
        entries: label -> the summary's entry of a scenario; at least one has results.
        informed: controllers that know the truth.
    """
    file = BytesIO()
    with matplotlib_style.context(style.SHEET):
        figure = comparison.comparison(comparison.with_results(entries), informed)
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def drawings(first: FirstRows, entry: dict[str, Any], control: ControlSettings) -> dict[str, Callable[[], Figure]]:
    """The figures that a run has data for, by name, as functions that draw them."""
    figures: dict[str, Callable[[], Figure]] = {
        "path": lambda: paths.path(first),
        "output": lambda: series.output(first),
        "error": lambda: series.error(first),
        "why": lambda: why.why(first),
    }
    if series.estimating(first):
        figures["alpha"] = lambda: series.alpha(first)
    if heat.has_temperatures(first):
        figures["temperatures"] = lambda: heat.temperatures(first)
    if len(first.log.seeds) >= seeds.FEWEST:
        figures["seeds"] = lambda: seeds.seeds(entry, first.turns)
    figures["memberships"] = lambda: controller.memberships(control)
    figures["surface"] = lambda: controller.surface(control)
    return figures

"""Figure of the limit: the errors that remain over time, with noise and without."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_mj.measure.metrics import errors
from omni_mj.measure.table import where
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.limit import LIMIT, WITHOUT_NOISE

if TYPE_CHECKING:
    from omni_mj.studies.limit import LimitResult


def save(result: "LimitResult", stem: Path) -> None:
    """Draw median, least and greatest error in the plane of all seeds of a complete result into a PNG."""
    (outcome,) = result.outcomes
    log = outcome.log
    assert log is not None
    distance = 100 * errors(log)["distance"]
    title = f"What is possible on {outcome.scenario.name}, {where(outcome.entry)}"
    with canvas.drawing(stem, title, figsize=(9, 6)) as figure:
        axes, time = figure.subplots(), canvas.seconds(distance)
        for i, (name, label) in enumerate(((LIMIT, result.whose["max"]), (WITHOUT_NOISE, WITHOUT_NOISE))):
            part = distance[:, log.of(label)]
            axes.plot(time, np.median(part, axis=1), color=style.colour(i), label=name)
            axes.fill_between(time, part.min(1), part.max(1), color=style.colour(i), alpha=0.2, lw=0)
        axes.set(ylabel="error in the plane, cm", xlabel="time in s")
        axes.set_ylim(bottom=0)
        axes.legend()

"""Figure of the limit: how learning approached it, and the errors that remain."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.limit import AIMS, LIMIT, WITHOUT_NOISE

if TYPE_CHECKING:
    from omni_mj.studies.limit import LimitResult


def save(result: "LimitResult", path: Path) -> None:
    """Draw a result that is complete into a PNG."""
    (outcome,) = result.outcomes
    log, scenario = outcome.log, outcome.scenario
    assert log is not None
    robot = "" if scenario.plant == "kinematic" else f", {scenario.robot}"
    with canvas.drawing(path.with_suffix(""), f"What is possible on {scenario.name}{robot}", figsize=(9, 6)) as figure:
        learning, errors = figure.subplots(2, 1)
        _draw_learning(result, learning)
        distance = 100 * np.hypot(*np.moveaxis((log.channel("pose") - log.channel("ref"))[..., :2], -1, 0))
        for i, (name, label) in enumerate(((LIMIT, result.whose["max"]), (WITHOUT_NOISE, WITHOUT_NOISE))):
            part, time = distance[:, log.of(label)], canvas.seconds(distance)
            errors.plot(time, np.median(part, axis=1), color=style.colour(i), label=name)
            errors.fill_between(time, part.min(1), part.max(1), color=style.colour(i), alpha=0.2, lw=0)
        errors.set(ylabel="error in the plane, cm", xlabel="time in s")
        errors.set_ylim(bottom=0)
        for axes in (learning, errors):
            axes.legend(loc="upper right", ncols=2, frameon=True, edgecolor="none", framealpha=0.9)


def _draw_learning(result: "LimitResult", axes: Axes) -> None:
    """Draw the least error so far over the attempts."""
    for i, aim in enumerate(AIMS):
        label, colour = {"max": "maximum", "mean": "mean"}[aim], style.colour(i)
        axes.plot([100 * errors[aim] for errors in result.history], f"{'os'[i]}-", color=colour,
                  label=f"{label}, without noise")  # fmt: skip
        median = result.outcomes[0].entry["results"][LIMIT]["error_m"]["distance"][aim]["median"]
        if median:
            axes.axhline(100 * median, color=colour, ls=":", label=f"{label}, with noise")
    canvas.use_log_scale(axes.yaxis)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="attempt", ylabel="error in the plane, cm")
    axes.margins(x=0.02)

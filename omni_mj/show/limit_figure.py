"""Figure of the limit: how learning approached it, what was learned, and the errors that remain."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.limit import AIMS, LIMIT, WITHOUT_NOISE

if TYPE_CHECKING:
    from omni_mj.studies.limit import LimitResult

AXES = ("velocity in x, m/s", "velocity in y, m/s", "turn rate, rad/s")
TURNS_RAD = 0.01  # change of the reference's heading below which its turn rate is not drawn


def save(result: "LimitResult", path: Path) -> None:
    """Draw a result that is complete into a PNG."""
    (outcome,) = result.outcomes
    log, scenario = outcome.log, outcome.scenario
    assert log is not None
    row = log.first(WITHOUT_NOISE)
    reference, command = log.channel("ref")[:, row], log.channel("command")[:, row]
    axes_shown = AXES if np.ptp(reference[:, 2]) > TURNS_RAD else AXES[:2]
    robot = "" if scenario.plant == "kinematic" else f", {scenario.robot}"
    title, size = f"What is possible on {scenario.name}{robot}", (9, 3.5 + 2 * len(axes_shown))
    with canvas.drawing(path.with_suffix(""), title, figsize=size) as figure:
        learning, *commands, errors = figure.subplots(
            2 + len(axes_shown), 1, height_ratios=[1.3, *[1.0] * len(axes_shown), 1.3]
        )
        _draw_learning(result, learning)
        for k, (axes, label) in enumerate(zip(commands, axes_shown, strict=True)):
            velocity, time = np.diff(reference[:, k]) / PERIOD_S, canvas.seconds(command)
            axes.plot(time[:-1], velocity, color=style.REFERENCE, label="reference")
            axes.plot(time, command[:, k], color=style.colour(1), lw=0.9, label="learned command, as sent")
            axes.set_ylabel(label)
            axes.sharex(errors)
            axes.tick_params(labelbottom=False)
        distance = 100 * np.hypot(*np.moveaxis((log.channel("pose") - log.channel("ref"))[..., :2], -1, 0))
        for i, (name, label) in enumerate(((LIMIT, result.whose["max"]), (WITHOUT_NOISE, WITHOUT_NOISE))):
            part, time = distance[:, log.of(label)], canvas.seconds(distance)
            errors.plot(time, np.median(part, axis=1), color=style.colour(i), label=name)
            errors.fill_between(time, part.min(1), part.max(1), color=style.colour(i), alpha=0.2, lw=0)
        errors.set(ylabel="error in the plane, cm", xlabel="time in s")
        errors.set_ylim(bottom=0)
        for axes in (learning, commands[0], errors):
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

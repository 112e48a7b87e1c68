"""The figure of the limit: how learning came down to it, what was learned, and the errors that are left."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style as matplotlib_style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.limit import AIMS, LIMIT, WITHOUT_NOISE

if TYPE_CHECKING:
    from omni_mj.studies.limit import LimitResult

AXES = ("velocity in x, m/s", "velocity in y, m/s", "turn rate, rad/s")
TURNS_RAD = 0.01  # of a reference's heading, below which its turn rate is not drawn


def save(result: "LimitResult", path: Path) -> None:
    """Draw a result that is complete into a PNG."""
    (outcome,) = result.outcomes
    with matplotlib_style.context(style.SHEET):
        assert outcome.log is not None
        log = outcome.log
        reference = log.channel("ref")[:, log.first(WITHOUT_NOISE)]
        turns = np.ptp(reference[:, 2]) > TURNS_RAD
        figure = Figure(figsize=(9, 7.5 + 2 * turns))
        grid = figure.subplots(4 + turns, 1, height_ratios=[1.3, *[1.0] * (2 + turns), 1.3])
        _learning(result, grid[0])
        command = log.channel("command")[:, log.first(WITHOUT_NOISE)]
        for axis, axes in enumerate(grid[1:-1]):
            _command(reference[:, axis], command[:, axis], AXES[axis], axes)
        _errors(result, grid[-1])
        for axes in grid[1:-1]:
            axes.sharex(grid[-1])
            axes.tick_params(labelbottom=False)
        grid[1].legend(loc="upper right", ncols=2)
        grid[-1].set_xlabel("time in s")
        robot = "" if outcome.scenario.plant == "kinematic" else f", {outcome.scenario.robot}"
        figure.suptitle(f"What is possible on {outcome.scenario.name}{robot}", x=0.01, ha="left")
        canvas.save_png(figure, path)


def _learning(result: "LimitResult", axes: Axes) -> None:
    """Draw the least error so far over the attempts."""
    attempts = np.arange(len(result.history))
    for i, aim in enumerate(AIMS):
        values = [100 * each[aim] for each in result.history]
        label = {"max": "maximum", "mean": "mean"}[aim]
        axes.semilogy(attempts, values, f"{'os'[i]}-", color=style.colour(i), label=f"{label}, without noise")
        spread = result.outcomes[0].entry["results"][LIMIT]["error_m"]["distance"][aim]
        if spread["median"]:
            axes.axhline(100 * spread["median"], color=style.colour(i), ls=":", label=f"{label}, with noise")
    canvas.plain(axes.yaxis)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="attempt", ylabel="error in the plane, cm")
    axes.margins(x=0.02)
    axes.legend(loc="upper right", ncols=2, frameon=True, edgecolor="none", framealpha=0.9)


def _command(reference: np.ndarray, command: np.ndarray, label: str, axes: Axes) -> None:
    """Draw what was sent, when it was, beside the reference's own velocity."""
    time = PERIOD_S * np.arange(len(reference))
    axes.plot(time[:-1], np.diff(reference) / PERIOD_S, color=style.REFERENCE, label="reference")
    axes.plot(time, command, color=style.colour(1), lw=0.9, label="learned command, as sent")
    axes.set_ylabel(label)


def _errors(result: "LimitResult", axes: Axes) -> None:
    """Draw the error in the plane along the way: the median over seeds and their range."""
    (outcome,) = result.outcomes
    assert outcome.log is not None
    log = outcome.log
    offset = log.channel("pose") - log.channel("ref")
    distance = 100 * np.hypot(offset[..., 0], offset[..., 1])
    time = PERIOD_S * np.arange(len(distance))
    for i, (name, label) in enumerate(((LIMIT, result.whose["max"]), (WITHOUT_NOISE, WITHOUT_NOISE))):
        part = distance[:, log.of(label)]
        axes.plot(time, np.median(part, axis=1), color=style.colour(i), label=name)
        if part.shape[1] > 1:
            axes.fill_between(time, part.min(1), part.max(1), color=style.colour(i), alpha=0.2, lw=0)
    axes.set_ylabel("error in the plane, cm")
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper right", ncols=2)

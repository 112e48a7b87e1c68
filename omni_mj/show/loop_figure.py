"""The figure of the loop study: a column for each case; step response, gain and phase around the loop, Nyquist plot."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style as matplotlib_style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.loop.drive import STEP_M, STRENGTHS
from omni_mj.studies.loop.excitation import FREQUENCIES
from omni_mj.studies.loop.transfer import curve

if TYPE_CHECKING:
    from omni_mj.studies.loop.findings import Findings, Loop

WIDTH_IN, HEIGHTS_IN = 3.4, (2.6, 2.2, 2.2, 3.4)  # of a column, and of its panels
SENSITIVITY = 2.0  # whose circle is drawn: a loop outside of it has margins of 2 and 29 degrees at least
LOWEST_DEG = -360.0
TICKS_RAD_S = (2, 5, 10, 20)


def save(findings: "Findings", stem: Path) -> None:
    """Draw the answers at the greatest strength into `stem`.png and `stem`.svg."""
    with matplotlib_style.context(style.SHEET):
        cases = findings.loops
        figure = Figure(figsize=(WIDTH_IN * max(len(cases), 2), sum(HEIGHTS_IN)))
        grid = figure.subplots(4, len(cases), height_ratios=HEIGHTS_IN, squeeze=False)
        for column, (case, loops) in zip(grid.T, cases.items(), strict=True):
            column[0].set_title(case)
            for slot, (label, loop) in zip(style.slots(list(loops)), loops.items(), strict=True):
                if np.isfinite(loop.moved).all() and np.isfinite(loop.gains).all():
                    _draw(column, loop, {**style.line(slot), "marker": ""}, label)
            _frame(column)
        for axes, label in zip(
            grid[:, 0], ("step response in cm", "|L|", "phase of L in °", "imaginary part of L"), strict=True
        ):
            axes.set_ylabel(label)
        canvas.title(figure, findings.title)
        canvas.legend(figure, list(grid[0]), 8)
        canvas.save(figure, stem)


def _draw(column: np.ndarray, loop: "Loop", look: dict[str, object], label: str) -> None:
    """One controller's curves in the four panels of a case."""
    step, size, phase, nyquist = column
    moved = 100 * loop.moved[:, -1]
    step.plot(PERIOD_S * np.arange(len(moved)), moved, label=label, **look)
    fine, gain = curve(FREQUENCIES, loop.gains[-1])
    size.plot(fine, np.abs(gain), **look)
    lag = np.degrees(np.unwrap(np.angle(gain)))
    phase.plot(fine, lag - 360 * np.ceil(lag[0] / 360), **look)  # from between -360 degrees and 0 on
    nyquist.plot(gain.real, gain.imag, **look)


def _frame(column: np.ndarray) -> None:
    """What the panels of a case have whoever is measured."""
    step, size, phase, nyquist = column
    asked = 100 * STEP_M * STRENGTHS[-1]
    step.axhline(asked, color=style.REFERENCE, lw=1, zorder=1)
    step.set(xlabel="time in s", ylim=(-0.1 * asked, 2 * asked))
    size.axhline(1, color=style.REFERENCE, lw=1, zorder=1)
    size.set(yscale="log", ylim=(0.05, 10))
    phase.axhline(-180, color=style.REFERENCE, lw=1, zorder=1)
    phase.set(xlabel="frequency in rad/s", ylim=(LOWEST_DEG, 0), yticks=np.arange(LOWEST_DEG, 1, 90))
    for axes in (size, phase):
        axes.set_xscale("log")
        axes.set_xticks(TICKS_RAD_S, map(str, TICKS_RAD_S))
        axes.set_xticks([], minor=True)
    _circle(nyquist)
    nyquist.set(xlabel="real part of L", xlim=(-2.2, 0.8), ylim=(-2.2, 0.8), aspect="equal")


def _circle(axes: Axes) -> None:
    """The point -1, and where 1 / |1 + L| is `SENSITIVITY`."""
    angle = np.linspace(0, 2 * np.pi, 100)
    axes.plot(np.cos(angle) / SENSITIVITY - 1, np.sin(angle) / SENSITIVITY, color=style.REFERENCE, lw=1, zorder=1)
    axes.plot([-1], [0], "+", color=style.REFERENCE, zorder=1)

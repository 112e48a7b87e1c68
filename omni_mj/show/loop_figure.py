"""Figure of the loop study: a column per case; step response, gain and phase around the loop, Nyquist plot."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.loop.drive import STEP_M, STRENGTHS
from omni_mj.studies.loop.motion import FREQUENCIES
from omni_mj.studies.loop.response import curve

if TYPE_CHECKING:
    from omni_mj.studies.loop.findings import Findings

WIDTH_IN, HEIGHTS_IN = 3.4, (2.6, 2.2, 2.2, 3.4)  # of a column, and of its panels
LABELS = ("step response in cm", "|L|", "phase of L in °", "imaginary part of L")
SENSITIVITY = 2.0  # whose circle is drawn: a loop outside of it has margins of 2 and 29 degrees at least
LOWEST_DEG = -360.0
TICKS_RAD_S = (2, 5, 10, 20)


def save(findings: "Findings", stem: Path) -> None:
    """Draw the answers at the greatest strength into `stem`.png and `stem`.svg."""
    size = (WIDTH_IN * max(len(findings.loops), 2), sum(HEIGHTS_IN))
    with canvas.drawing(stem, findings.title, svg=True, figsize=size) as figure:
        grid = figure.subplots(4, len(findings.loops), height_ratios=HEIGHTS_IN, squeeze=False)
        for (case, loops), (step, gain, phase, nyquist) in zip(findings.loops.items(), grid.T, strict=True):
            for label, slot in style.slots(loops).items():
                loop, look = loops[label], style.line(slot) | {"marker": ""}
                if np.isfinite(loop.moved).all() and np.isfinite(loop.gains).all():
                    moved = 100 * loop.moved[:, -1]
                    step.plot(canvas.seconds(moved), moved, label=label, **look)
                    frequencies, response = curve(FREQUENCIES, loop.gains[-1])
                    gain.plot(frequencies, np.abs(response), **look)
                    angle = np.degrees(np.unwrap(np.angle(response)))
                    phase.plot(frequencies, angle - 360 * np.ceil(angle[0] / 360), **look)  # from (-360, 0] on
                    nyquist.plot(response.real, response.imag, **look)
            target, mark = 100 * STEP_M * STRENGTHS[-1], {"color": style.REFERENCE, "lw": 1, "zorder": 1}
            for axes, level in ((step, target), (gain, 1), (phase, -180)):
                axes.axhline(level, **mark)
            circle = (np.exp(1j * np.linspace(0, 2 * np.pi, 100))) / SENSITIVITY - 1
            nyquist.plot(circle.real, circle.imag, **mark)
            nyquist.plot([-1], [0], "+", **mark)
            step.set(title=case, xlabel="time in s", ylim=(-0.1 * target, 2 * target))
            gain.set(yscale="log", ylim=(0.05, 10))
            phase.set(xlabel="frequency in rad/s", ylim=(LOWEST_DEG, 0), yticks=np.arange(LOWEST_DEG, 1, 90))
            nyquist.set(xlabel="real part of L", xlim=(-2.2, 0.8), ylim=(-2.2, 0.8), aspect="equal")
            for axes in (gain, phase):
                axes.set_xscale("log")
                axes.set_xticks(TICKS_RAD_S, map(str, TICKS_RAD_S))
                axes.set_xticks([], minor=True)
        for axes, label in zip(grid[:, 0], LABELS, strict=True):
            axes.set_ylabel(label)
        canvas.add_legend(figure, grid[0])

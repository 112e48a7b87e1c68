"""Figure of the loop study: a column per case; step response, gain and phase around the loop, Nyquist plot."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_mj.studies.loop.loop_experiment import FREQUENCIES, STEP_M
from omni_mj.studies.loop.stability_margins import interpolate
from omni_mj.viz import style
from omni_mj.viz.figures import plotting

if TYPE_CHECKING:
    from omni_mj.studies.loop import LoopResult

WIDTH_IN, HEIGHTS_IN = 3.4, (2.6, 2.2, 2.2, 3.4)  # of a column, and of its panels
LABELS = ("step response in cm", "|L|", "phase of L in °", "imaginary part of L")
# Whose circle is drawn: a loop outside of it has margins of 2 and 29 degrees at least
SENSITIVITY = 2.0
TICKS_RAD_S = (2, 5, 10, 20)


def save_loop_figure(result: "LoopResult", stem: Path) -> None:
    """Draw all loops into `stem`.png and `stem`.svg."""
    size = (WIDTH_IN * max(len(result.loops), 2), sum(HEIGHTS_IN))
    with plotting.figure_file(stem, result.title, svg=True, figsize=size) as figure:
        grid = figure.subplots(4, len(result.loops), height_ratios=HEIGHTS_IN, squeeze=False)
        for (case, loops), (step, gain, phase, nyquist) in zip(
            result.loops.items(), grid.T, strict=True
        ):
            for label, slot in style.style_indices(loops).items():
                loop, look = loops[label], style.line_style(slot) | {"marker": ""}
                if np.isfinite(loop.moved).all() and np.isfinite(loop.gains).all():
                    step.plot(
                        plotting.frame_times(loop.moved), 100 * loop.moved, label=label, **look
                    )
                    frequencies, response = interpolate(FREQUENCIES, loop.gains)
                    gain.loglog(frequencies, np.abs(response), **look)
                    angle = np.degrees(np.unwrap(np.angle(response)))
                    phase.semilogx(
                        frequencies, angle - 360 * np.ceil(angle[0] / 360), **look
                    )  # from (-360, 0] on
                    nyquist.plot(response.real, response.imag, **look)
            mark = {"color": style.REFERENCE, "lw": 1, "zorder": 1}
            for axes, level in ((step, 100 * STEP_M), (gain, 1), (phase, -180)):
                axes.axhline(level, **mark)
            circle = (np.exp(1j * np.linspace(0, 2 * np.pi, 100))) / SENSITIVITY - 1
            nyquist.plot(circle.real, circle.imag, **mark)
            nyquist.plot([-1], [0], "+", **mark)
            step.set(title=case, xlabel="time in s", ylim=(-10 * STEP_M, 200 * STEP_M))
            gain.set(ylim=(0.05, 10))
            phase.set(xlabel="frequency in rad/s", ylim=(-360, 0), yticks=np.arange(-360, 1, 90))
            nyquist.set(xlabel="real part of L", xlim=(-2.2, 0.8), ylim=(-2.2, 0.8), aspect="equal")
            for axes in (gain, phase):
                axes.set_xticks(TICKS_RAD_S, map(str, TICKS_RAD_S))
                axes.set_xticks([], minor=True)
        for axes, label in zip(grid[:, 0], LABELS, strict=True):
            axes.set_ylabel(label)
        plotting.add_legend(figure, grid[0])

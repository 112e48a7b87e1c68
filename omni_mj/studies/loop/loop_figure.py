"""Figure of the loop study: step response, Bode plot and Nyquist plot of each case."""

from pathlib import Path
from typing import Any

import numpy as np

from omni_mj.studies.loop.loop_experiment import STEP_M
from omni_mj.studies.loop.loop_metrics import interpolate_gains
from omni_mj.studies.loop.loop_study import LoopMeasurement, LoopResult
from omni_mj.viz import figure_helpers, style

COLUMN_WIDTH = 3.4  # of a case, inches
PANEL_HEIGHTS = (2.6, 2.2, 2.2, 3.4)  # inches
LABELS = (
    "step response in cm",
    "gain |L|",
    "phase of L in degrees",
    "imaginary part of L",
)
# Sensitivity Ms of a circle around -1 with the radius 1 / Ms. A loop gain outside of the circle has
# a gain margin of at least 2 and a phase margin of at least 29 degrees.
SENSITIVITY = 2.0
TICKS_RAD_S = (2, 5, 10, 20)
GUIDE = {"color": style.REFERENCE, "lw": 1, "zorder": 1}  # line style of levels and of the circle


def save_loop_figure(result: LoopResult, stem: Path) -> None:
    """Draw all loops into `stem`.png and `stem`.svg, with a column of panels per case."""
    size = (COLUMN_WIDTH * max(len(result.loops), 2), sum(PANEL_HEIGHTS))
    title = f"Step responses and loop gains of controllers: {result.title}"
    with figure_helpers.figure_file(stem, title, svg=True, figsize=size) as figure:
        grid = figure.subplots(4, len(result.loops), height_ratios=PANEL_HEIGHTS, squeeze=False)
        for (case, loops), panels in zip(result.loops.items(), grid.T, strict=True):
            for label, slot in style.style_indices(loops).items():
                line = style.line_style(slot) | {"marker": ""}
                _draw_loop(panels, loops[label], label, line)
            _draw_guides(panels)
            panels[0].set_title(case)
        for axes, label in zip(grid[:, 0], LABELS, strict=True):
            axes.set_ylabel(label)
        figure_helpers.add_legend(figure, grid[0])


def _draw_loop(panels: np.ndarray, loop: LoopMeasurement, label: str, line: dict[str, Any]) -> None:
    """Draw one controller into the four panels of a case, unless its robot failed."""
    step, gain, phase, nyquist = panels
    response = loop.step_response
    if not (np.isfinite(response).all() and np.isfinite(loop.gains).all()):
        return
    figure_helpers.plot_frames(step, 100 * response, label=label, **line)
    frequencies, gains = interpolate_gains(loop.gains)
    gain.loglog(frequencies, np.abs(gains), **line)
    angle = np.degrees(np.unwrap(np.angle(gains)))
    shift = 360 * np.ceil(angle[0] / 360)  # moves the first angle into (-360, 0]
    phase.semilogx(frequencies, angle - shift, **line)
    nyquist.plot(gains.real, gains.imag, **line)


def _draw_guides(panels: np.ndarray) -> None:
    """Draw reference levels and the sensitivity circle, and set limits and labels."""
    step, gain, phase, nyquist = panels
    for axes, level in ((step, 100 * STEP_M), (gain, 1), (phase, -180)):
        axes.axhline(level, **GUIDE)
    circle = (np.exp(1j * np.linspace(0, 2 * np.pi, 100))) / SENSITIVITY - 1
    nyquist.plot(circle.real, circle.imag, **GUIDE)
    nyquist.plot([-1], [0], "+", **GUIDE)
    step.set(xlabel="time in s", ylim=(-10 * STEP_M, 200 * STEP_M))
    gain.set(ylim=(0.05, 10))
    phase.set(xlabel="frequency in rad/s", ylim=(-360, 0), yticks=np.arange(-360, 1, 90))
    nyquist.set(xlabel="real part of L", xlim=(-2.2, 0.8), ylim=(-2.2, 0.8), aspect="equal")
    for axes in (gain, phase):
        axes.set_xticks(TICKS_RAD_S, map(str, TICKS_RAD_S))
        axes.set_xticks([], minor=True)

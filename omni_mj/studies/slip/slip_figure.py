"""Figure of the slip study: speed of the body over that of the wheels, and their ratio."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from omni_mj.config import PERIOD_S
from omni_mj.studies.slip.slip_fits import SlipFit, simulate_slip
from omni_mj.studies.slip.slip_study import SlipResult
from omni_mj.viz import figure_helpers, style

# Axis -> style index, marker, dashes
LINES: dict[str, tuple[int, str, Any]] = {
    "forward": (1, ".", "-"),
    "sideways": (0, "x", (0, (4, 1.5))),
}
TITLE = "Slip in moves at 2 m/s²: samples, and the fitted model v' = (K u - v) / (T |u|)"
MIN_WHEEL_SPEED_M_S = 0.2  # of samples whose ratio is drawn
ACCELERATIONS = np.array([-2.5, 2.5])  # ends of the fitted lines, m/s^2


def save_slip_figure(result: SlipResult, stem: Path) -> None:
    """Draw the samples and the fitted model of each robot into `stem`.png."""
    robots = result.robots
    with figure_helpers.figure_file(stem, TITLE, figsize=(10, 3.6 * len(robots))) as figure:
        grid = figure.subplots(len(robots), 2, squeeze=False)
        for (speeds, ratios), (name, robot) in zip(grid, robots.items(), strict=True):
            for axis in LINES:
                _draw_axis(speeds, ratios, robot, axis)
            speeds.axline((0, 0), slope=1, ls=":", lw=1, color="0.6", label="without slip")
            speeds.set(
                title=name,
                xlabel="speed of the wheels u in m/s",
                ylabel="speed of the body v in m/s",
            )
            ratios.set(
                xlabel="acceleration of the body in m/s²",
                ylabel="v / u",
                xlim=(-3, 3),
                ylim=(0.5, 1.3),
            )
            speeds.legend()
            ratios.legend()


def _draw_axis(speeds: Axes, ratios: Axes, robot: SlipFit, axis: str) -> None:
    """Draw the braked moves of a robot along one axis.

    Args:
        speeds: Panel of the fastest move, whose hysteresis loop is the widest.
        ratios: Panel of v / u over the acceleration, for all moves.
        robot: Fits of the robot.
        axis: Key of `LINES`.
    """
    slot, marker, dashes = LINES[axis]
    color = style.color(slot)
    gain, time = robot.measured[f"gain_{axis}"], robot.measured[f"time_{axis}"]
    move_axes = np.array([move.axis for move in robot.moves])
    is_drawn = (move_axes == axis) & ~np.isnan(robot.fitted["gain"])
    u, v = robot.wheel_speeds[:, is_drawn], robot.body_speeds[:, is_drawn]
    if is_drawn.any():
        fastest = u.max(0).argmax()
        u_i, v_i = u[:, fastest], v[:, fastest]
        fitted = simulate_slip(gain, time, u_i, np.abs(u_i))
        speeds.plot(u_i, v_i, marker, ms=3, color=color, label=axis)
        speeds.plot(u_i, fitted, lw=1, color="k", label=f"{axis}, fitted")
    is_fast = u > MIN_WHEEL_SPEED_M_S
    acceleration = np.gradient(v, PERIOD_S, axis=0)
    ratios.plot(acceleration[is_fast], v[is_fast] / u[is_fast], marker, ms=3, color=color)
    label = f"{axis}: K = {gain:.3f}, T = {time:.3f} s²/m"
    ratios.plot(ACCELERATIONS, gain - time * ACCELERATIONS, ls=dashes, color=color, label=label)

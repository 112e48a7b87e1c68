"""Temperatures of the motors."""

import numpy as np
from matplotlib.figure import Figure

from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.simulate.log import Trajectory

MOTORS = ("motor 1, front left", "2, rear left", "3, rear right", "4, front right")
PARTS = ("winding", "housing")
LEAST_SPAN_K = 1.0
NEAR_K = 30.0  # within which of the limit the limit is drawn


def has_temperatures(trajectory: Trajectory) -> bool:
    """Whether the plant has motors that heat."""
    return not np.isnan(trajectory.channel("winding")).all()


def temperatures(trajectory: Trajectory, limit_c: float) -> Figure:
    """Winding and housing of the four motors, for each controller."""
    figure, grid = canvas.over_time(trajectory.length, len(trajectory.controllers), 2, 1.7, "col")
    for j, part in enumerate(PARTS):
        values = trajectory.channel(part)[:, :, 0]
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        for i, name in enumerate(trajectory.controllers):
            axes = grid[i, j]
            for motor, label in enumerate(MOTORS):
                line = style.line(motor) | {"color": style.AXES[motor]}
                frames, kept = canvas.thin(values[:, i, motor])
                step = max(len(kept) // 6, 1)
                axes.plot(frames, kept, label=label, markevery=(motor * step // 4, step), **line)
            axes.set_title(f"{name}, {part}")
            axes.set_ylabel("°C")
            if part == "winding" and high > limit_c - NEAR_K:
                axes.axhline(limit_c, color="black", lw=1, ls=":", label=f"limit, {limit_c:g} °C")
                high = max(high, limit_c)
        span = max(high - low, LEAST_SPAN_K)
        grid[0, j].set_ylim(low - 0.05 * span, low + 1.08 * span)
    canvas.legend(figure, grid[0, 0])
    figure.suptitle("Temperatures of the motors")
    return figure

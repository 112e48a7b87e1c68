"""Temperatures of the motors."""

import numpy as np
from matplotlib.figure import Figure

from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.first import FirstRows
from omni_mj.show.wheels import names_of
from omni_mj.worlds.build import kinematics

PARTS = ("winding", "housing")
LEAST_SPAN_K = 1.0
NEAR_K = 30.0  # within which of the limit the limit is drawn


def has_temperatures(first: FirstRows) -> bool:
    """Whether the plant has motors that heat."""
    return not np.isnan(first.channel("winding")).all()


def temperatures(first: FirstRows) -> Figure:
    """Winding and housing of each motor, for each controller."""
    figure, grid = canvas.over_time(first.length, len(first.names), 2, 1.3, "col")
    rows = [first.log.rows[row] for row in first.rows]
    for j, part in enumerate(PARTS):
        values = first.channel(part)
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        for i, name in enumerate(first.names):
            axes, limit_c = grid[i, j], rows[i].settings.motor.limit_c
            for motor, place in enumerate(names_of(kinematics(rows[i].settings.wheels).azimuths)):
                frames, kept = canvas.thin(values[:, i, motor])
                step = max(len(kept) // 6, 1)
                label = f"motor {motor + 1}, {place}"
                axes.plot(frames, kept, label=label, markevery=(motor * step // 4 % step, step), **style.line(motor))
            axes.set_title(f"{name}, {part}")
            if j == 0:
                axes.set_ylabel("°C")
            if part == "winding" and high > limit_c - NEAR_K:
                axes.axhline(limit_c, color="black", lw=1, ls=":", label=f"limit, {limit_c:g} °C")
                high = max(high, limit_c)
        span = max(high - low, LEAST_SPAN_K)
        grid[0, j].set_ylim(low - 0.05 * span, low + 1.08 * span)
    canvas.legend(figure, list(grid.flat))
    figure.suptitle("Temperatures of the motors")
    return figure

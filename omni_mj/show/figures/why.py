"""Why controllers stray: each one's error, and below it when its wheels slide, and what is at a limit."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator

from omni_control.kinematics import Array
from omni_mj.measure import causes
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.first import FirstRows

LINE = 0.19  # height of a cause's line, as a share of the panel's error
TEXT_IN = 1.45  # beside a panel


def why(first: FirstRows) -> Figure:
    """The error in the plane of each controller, and lines that are dark in the frames in which a cause is there."""
    error = 100 * first.errors("distance")
    figure, grid = canvas.over_time(first.length, len(first.names), 1, 1.15, "all", canvas.WIDTH_IN - TEXT_IN, TEXT_IN)
    _, top = canvas.reach(error, list(first.failed))
    for i, (axes, name) in enumerate(zip(grid[:, 0], first.names, strict=True)):
        axes.plot(*canvas.thin(error[:, i]), color=style.colour(first.slots[i]), zorder=3)
        called = f"{name} failed; until then" if i in first.failed else f"{name},"
        axes.set_title(f"{called} {_numbers(error[:, i], first.channel('duty_peak')[:, i, 0])}")
        _causes(axes, first, i, max(top, 1e-9))
        if i in first.failed:
            canvas.mark_failure(axes, max(int(first.log.lengths[first.rows[i]]) - 1, 0), first.slots[i], name)
    middle = grid[len(first.names) // 2, 0]
    middle.set_ylabel("error in the plane, cm")
    figure.suptitle("Why: errors, and the frames in which something is at its limit")
    return figure


def _causes(axes: Axes, first: FirstRows, controller: int, top: float) -> None:
    """Draw the lines below the error, with the share of the frames at the end of each."""
    found = causes.of_row(first.log, first.rows[controller])
    axes.set_ylim(-LINE * top * (len(found) + 0.3), 1.05 * top)
    ticks = np.asarray(MaxNLocator(4, steps=canvas.STEPS).tick_values(0, top))
    axes.yaxis.set_major_locator(FixedLocator(list(ticks[(ticks >= 0) & (ticks <= 1.05 * top)])))
    axes.axhline(0, color="#888888", lw=0.8)
    for line, (cause, frames) in enumerate(found.items()):
        middle = -LINE * top * (line + 0.65)
        axes.broken_barh(spans(frames), (middle - 0.3 * LINE * top, 0.6 * LINE * top), color="#333333", lw=0)
        share = f"{100 * frames.mean():.1f}" if frames.any() else "0"
        axes.annotate(
            f"{causes.CAUSES[cause]}  {share} %", (1.0, middle), (5, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", fontsize=8, annotation_clip=False,
        )  # fmt: skip


def spans(frames: np.ndarray) -> list[tuple[int, int]]:
    """Where frames (n,) are true: the first of each run of them, and how many they are."""
    edges = np.diff(frames.astype(int), prepend=0, append=0)
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return list(zip(starts.tolist(), (ends - starts).tolist(), strict=True))


def _numbers(error: Array, duty: Array) -> str:
    """Of a controller: its error in cm, and the mean duty of its motors, where it has any; all (frames,)."""
    if np.isnan(error).all():
        return "nothing recorded"
    said = f"at most {np.nanmax(error):.2f} cm, mean {np.nanmean(error):.2f} cm"
    return said if np.isnan(duty).all() else f"{said}, mean duty {100 * np.nanmean(duty):.0f} %"

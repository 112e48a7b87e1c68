"""Figures 7, 8 and 9 of the paper, drawn from a run's first seed."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_mj import metrics, style
from omni_mj.settings import FRAME_RATE_HZ
from omni_mj.trajectory import Trajectory


def save_all(trajectory: Trajectory, title: str, folder: Path) -> None:
    """Write path.png, output.png and error.png into `folder`."""
    folder.mkdir(exist_ok=True)
    for name, draw in FIGURES.items():
        figure = draw(trajectory)
        figure.suptitle(title, fontsize=10)
        figure.savefig(folder / f"{name}.png", dpi=150)


def path(trajectory: Trajectory) -> Figure:
    """The reference and the paths travelled (figure 7)."""
    figure = Figure(figsize=(7, 5.6), layout="constrained")
    axes = figure.add_subplot()
    ref = trajectory.channel("ref")[:, 0, 0]
    axes.plot(ref[:, 0], ref[:, 1], color=style.REFERENCE, lw=3, alpha=0.6, label="reference")
    for i, name in enumerate(trajectory.controllers):
        pose = trajectory.channel("pose")[:, i, 0]
        axes.plot(pose[:, 0], pose[:, 1], color=style.controller(i), ls=_line(i), lw=1.2, label=name)
    axes.plot(*ref[0, :2], "o", color="black", ms=5, label="start")
    axes.set(xlabel="x in m", ylabel="y in m", aspect="equal")
    axes.margins(0.08)
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=len(trajectory.controllers) + 2)
    return figure


def output(trajectory: Trajectory) -> Figure:
    """Velocities commanded by the controllers (figure 8)."""
    figure, rows = _time_axes(trajectory)
    for j, axes in enumerate(rows):
        for i, name in enumerate(trajectory.controllers):
            values = trajectory.channel("command")[:, i, 0, j]
            axes.plot(values, color=style.controller(i), ls=_line(i), lw=1, label=name)
        axes.set_ylabel(f"v{metrics.AXES[j]} commanded in m/s")
    return _finish(figure, rows)


def error(trajectory: Trajectory) -> Figure:
    """Absolute position errors (figure 9)."""
    figure, rows = _time_axes(trajectory)
    errors = 100 * metrics.absolute_errors(trajectory)
    for j, axes in enumerate(rows):
        for i, name in enumerate(trajectory.controllers):
            axes.plot(errors[:, i, 0, j], color=style.controller(i), ls=_line(i), lw=1, label=name)
        axes.set_ylabel(f"|error| in {metrics.AXES[j]} in cm")
        axes.set_ylim(bottom=0)
    return _finish(figure, rows)


FIGURES: dict[str, Callable[[Trajectory], Figure]] = {"path": path, "output": output, "error": error}


def _line(index: int) -> str:
    return ("-", "--", "-.", ":")[index % 4]


def _time_axes(trajectory: Trajectory) -> tuple[Figure, list[Axes]]:
    """Two axes above each other over frames (fp), as the paper plots them, with seconds on top."""
    figure = Figure(figsize=(7, 5.6), layout="constrained")
    rows = list(np.atleast_1d(figure.subplots(2, sharex=True)))
    rows[0].set_xlim(0, max(trajectory.length - 1, 1))
    seconds = rows[0].secondary_xaxis("top", functions=(lambda k: k / FRAME_RATE_HZ, lambda s: s * FRAME_RATE_HZ))
    seconds.set_xlabel("time in s")
    rows[-1].set_xlabel("time in frames of 1/60 s (fp)")
    return figure, rows


def _finish(figure: Figure, rows: list[Axes]) -> Figure:
    for axes in rows:
        axes.grid(alpha=0.3)
    handles, labels = rows[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure

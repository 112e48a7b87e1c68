"""Shared parts of the figures: style, saving, legends, time axes and logarithmic axes."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis, YAxis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from omni_control.kinematics import Array
from omni_mj.config.settings import FRAME_RATE_HZ
from omni_mj.files import open_atomic
from omni_mj.viz import style

LETTERS_PER_INCH, HANDLE_LETTERS = 12, 9  # of titles and legends; room of a legend's line
WIDE_RANGE = 200.0  # ratio of limits above which a logarithmic axis labels powers of ten only


@contextmanager
def figure_file(stem: Path, title: str = "", svg: bool = False, **options: Any) -> Iterator[Figure]:
    """Yield a figure in the program's style, then write it to `stem`.png and, if requested, `stem`.svg.

    Args:
        stem: Path without suffix.
        title: Text above the figure, wrapped to its width; a figure may set its own instead.
        svg: Whether to write an SVG as well.
        **options: Arguments of `matplotlib.figure.Figure`, such as `figsize`.
    """
    with rc_context(fname=style.STYLE_SHEET):
        figure = Figure(**options)
        yield figure
        figure.suptitle(wrap_title(title or figure.get_suptitle(), figure), x=0.01, ha="left")
        for kind in ("png", "svg") if svg else ("png",):
            with open_atomic(stem.with_suffix(f".{kind}")) as file:
                figure.savefig(
                    file, format=kind, metadata={"Date": None} if kind == "svg" else None
                )


def wrap_title(text: str, figure: Figure) -> str:
    """Return a text whose lines are broken to the width of a figure."""
    width = round(LETTERS_PER_INCH * figure.get_figwidth())
    return "\n".join(
        part for line in text.splitlines() for part in wrap(line, width, break_on_hyphens=False)
    )


def create_time_axes(
    figure: Figure, rows: int, columns: int, height: float, **shared: Any
) -> np.ndarray:
    """Return axes of shape (rows, columns) over time in s; ticks name the frame, as in the paper, and the second.

    Args:
        figure: Empty figure, which is resized.
        rows: Number of rows.
        columns: Number of columns.
        height: Height of a panel, inches.
        **shared: Arguments of `Figure.subplots`.
    """
    figure.set_size_inches(8, 1.4 + rows * (height + 0.3))
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False, **shared)
    grid[0, 0].xaxis.set_major_formatter(lambda time, _: f"{FRAME_RATE_HZ * time:g}\n{time:g} s")
    for axes in grid[-1]:
        axes.set_xlabel("frames of 1/60 s (fp)")
    return grid


def frame_times(values: Array) -> Array:
    """Return the times of the frames of `values`, s."""
    return np.arange(len(values)) / FRAME_RATE_HZ


def add_legend(figure: Figure, axes: Iterable[Axes]) -> None:
    """Add one legend below the figure for everything labelled in `axes`, each label once."""
    entries: dict[str, Any] = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if not entries:  # all that would have one failed
        return
    columns = max(
        1, int(LETTERS_PER_INCH * figure.get_figwidth() / (HANDLE_LETTERS + max(map(len, entries))))
    )
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        ncols=min(columns, len(entries)),
    )


def use_log_scale(axis: Axis) -> None:
    """Make an axis logarithmic, with ticks as plain numbers; all data must have been drawn."""
    axis.axes.set(**{"yscale" if isinstance(axis, YAxis) else "xscale": "log"})
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1,) if high > WIDE_RANGE * low else (1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())

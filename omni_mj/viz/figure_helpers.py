"""Helpers for all figures: style, files, titles, legends, time axes and logarithmic axes."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib import style as matplotlib_style
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator
from numpy.typing import NDArray

from omni_control.kinematics import Array
from omni_mj.config import FRAME_RATE_HZ
from omni_mj.io.atomic_files import open_atomic
from omni_mj.viz import style

LETTERS_PER_INCH = 12  # of titles and legends
LEGEND_HANDLE_LETTERS = 9  # width of a line and its margins in a legend
NARROW_RANGE = 10.0  # ratio of limits below which a logarithmic axis has evenly spaced ticks
MAX_POINTS = 60_000  # of a line, which needs 0.2 kB of memory per point
WIDE_RANGE = 200.0  # ratio of limits above which a logarithmic axis labels powers of ten only


@contextmanager
def figure_file(stem: Path, title: str = "", svg: bool = False, **options: Any) -> Iterator[Figure]:
    """Yield a figure in the program's style; on exit, save it as a PNG and perhaps an SVG file.

    Args:
        stem: Path without suffix.
        title: Text above the figure, wrapped to its width. Default: the title that the figure has.
        svg: Whether to save an SVG file as well.
        **options: Arguments of `matplotlib.figure.Figure`, such as `figsize`.
    """
    # A user's matplotlibrc has no effect, and a user's settings are as before at the end.
    with matplotlib_style.context(["default", style.STYLE_SHEET]):
        figure = Figure(**options)
        yield figure
        width = round(LETTERS_PER_INCH * figure.get_figwidth())
        lines = (title or figure.get_suptitle()).splitlines()
        wrapped_lines = [fill(line, width, break_on_hyphens=False) for line in lines]
        figure.suptitle("\n".join(wrapped_lines), x=0.01, ha="left")
        for suffix in ("png", "svg") if svg else ("png",):
            # Equal figures give equal files, so an SVG file has no date.
            metadata = {"Date": None} if suffix == "svg" else None
            with open_atomic(stem.with_suffix(f".{suffix}")) as file:
                figure.savefig(file, format=suffix, metadata=metadata)
        figure.clear()  # frees the memory of its lines, which refer to one another


def create_time_axes(
    figure: Figure, rows: int, columns: int, height: float, **options: Any
) -> np.ndarray:
    """Return axes of shape (rows, columns) over time in s.

    Ticks show the frame, as the paper's figures do, and the second.

    Args:
        figure: Empty figure, which is resized.
        rows: Number of rows.
        columns: Number of columns.
        height: Height of one panel, inches.
        **options: Arguments of `Figure.subplots`.
    """
    figure.set_size_inches(8, 1.4 + rows * (height + 0.3))
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False, **options)
    grid[0, 0].xaxis.set_major_formatter(lambda time, _: f"{FRAME_RATE_HZ * time:g}\n{time:g} s")
    for axes in grid[-1]:
        axes.set_xlabel("frames of 1/60 s")
    return grid


def plot_frames(axes: Axes, values: Array, **options: Any) -> None:
    """Plot values, one per frame, over time.

    A line of more than `MAX_POINTS` frames shows the extremes in short intervals of equal length.
    """
    frames = choose_frames(values)
    axes.plot(frames / FRAME_RATE_HZ, values[frames], **options)


def choose_frames(values: Array) -> NDArray[np.int_]:
    """Return the frames that `plot_frames` shows: all, or those of the extremes."""
    n = len(values)
    if n <= MAX_POINTS:
        return np.arange(n)
    interval = -(-2 * n // MAX_POINTS)
    intervals = np.pad(values, (0, -n % interval), "edge").reshape(-1, interval)
    extremes = np.concatenate([intervals.argmin(1), intervals.argmax(1)])
    starts = np.tile(np.arange(0, n, interval), 2)
    return np.unique(np.minimum(starts + extremes, n - 1))


def add_legend(figure: Figure, axes: Iterable[Axes]) -> None:
    """Add one legend below the figure with each label of `axes` once."""
    handles: dict[str, Any] = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if not handles:
        return
    entry_letters = LEGEND_HANDLE_LETTERS + max(map(len, handles))
    columns = min(len(handles), int(LETTERS_PER_INCH * figure.get_figwidth() / entry_letters) or 1)
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=columns)


def use_log_scale(axis: XAxis | YAxis) -> None:
    """Make an axis logarithmic with plain numbers at its ticks; call it after drawing all data."""
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    low, high = axis.get_view_interval()
    subs = (1,) if high > WIDE_RANGE * low else (1, 2, 5)
    axis.set_major_locator(MaxNLocator(4) if high < NARROW_RANGE * low else LogLocator(subs=subs))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())

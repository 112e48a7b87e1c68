"""Shared parts of the figures: style, saving, legends, time axes, curves and scales."""

from collections.abc import Collection, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib import rc_context, rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.axis import Axis, YAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from PIL import Image

from omni_control.kinematics import Array
from omni_mj.files import whole
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show import style

MAX_SHARED_CURVES = 3  # curves that one pair of axes shows; more controllers get axes each
LETTERS_PER_INCH, HANDLE_LETTERS = 12, 9  # of titles and legends; room of a legend's line
LINE_IN, GAP_IN = 0.18, 0.42  # height of a line of text; between panels
MARKERS_PER_CURVE = 12
OUTLIER = 3.0  # ratio to the median controller's largest value beyond which curves are cut off
WIDE_RANGE = 200.0  # ratio of limits above which a logarithmic axis labels powers of ten only
COMPARED: dict[str, Any] = {"color": style.REFERENCE, "lw": 0.8, "ls": (0, (4, 1.5))}


def styled() -> AbstractContextManager[None]:
    """Return a context in which matplotlib has the program's style."""
    return rc_context(_sheet())


@cache
def _sheet() -> Any:
    return rc_params_from_file(style.SHEET, use_default_template=False)


@contextmanager
def drawing(stem: Path, title: str = "", svg: bool = False, **options: Any) -> Iterator[Figure]:
    """Yield a figure in the program's style, then write it to `stem`.png and, if requested, `stem`.svg.

    Args:
        stem: Path without suffix.
        title: Text above the figure, wrapped to its width; a figure may set its own instead.
        svg: Whether to write an SVG as well.
        **options: Arguments of `matplotlib.figure.Figure`, such as `figsize`.
    """
    with styled():
        figure = Figure(**options)
        yield figure
        set_title(figure, title or figure.get_suptitle())
        image: Any = FigureCanvasAgg(figure)
        image.draw()  # once, whereas savefig draws twice if it has to lay out
        with whole(stem.with_suffix(".png")) as file:
            Image.fromarray(np.asarray(image.buffer_rgba())).convert("RGB").save(file, "png", compress_level=1)
        if svg:
            figure.set_layout_engine("none")  # the layout of the PNG fits the SVG as well
            with whole(stem.with_suffix(".svg")) as file:
                figure.savefig(file, format="svg", metadata={"Date": None})


def set_title(figure: Figure, text: str) -> None:
    """Set the title at the left edge, wrapped to the width of the figure."""
    width = round(LETTERS_PER_INCH * figure.get_figwidth())
    lines = [part for line in text.splitlines() for part in wrap(line, width, break_on_hyphens=False)]
    figure.suptitle("\n".join(lines), x=0.01, ha="left")
    if figure.get_layout_engine() is None:
        figure.subplots_adjust(top=1 - (0.4 + LINE_IN * len(lines)) / figure.get_figheight())


def time_axes(figure: Figure, rows: int, columns: int, height: float, right: float = 0.2, **shared: Any) -> np.ndarray:
    """Return axes of shape (rows, columns) over time in s; ticks name the frame, as in the paper, and the second.

    Margins are fixed: to measure what constrained layout needs takes as long as to draw these figures.

    Args:
        figure: Empty figure without a layout engine, which is resized.
        rows: Number of rows.
        columns: Number of columns.
        height: Height of a panel, inches.
        right: Right margin, inches.
        **shared: Arguments of `Figure.subplots`.
    """
    width, total = max(8.0, 3.0 * columns), 1.4 + rows * (height + GAP_IN)
    figure.set_size_inches(width, total)
    figure.subplots_adjust(0.75 / width, 0.55 / total, 1 - right / width, hspace=GAP_IN / height)
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False, **shared)
    grid[0, 0].xaxis.set_major_formatter(lambda time, _: f"{FRAME_RATE_HZ * time:g}\n{time:g} s")
    for axes in grid.flat:
        axes.locator_params(axis="y", nbins=max(3, round(3 * height)))
    for axes in grid[-1]:
        axes.set_xlabel("frames of 1/60 s (fp)")
    return grid


def seconds(values: Array) -> Array:
    """Return the times of the frames of `values`, s."""
    return np.arange(len(values)) / FRAME_RATE_HZ


def plot_curve(axes: Axes, values: Array, index: int, slot: int, label: str) -> None:
    """Draw values (frames,) of the controller with this index in the look of its slot, its markers staggered."""
    step = max(len(values) // MARKERS_PER_CURVE, 1)
    start = index * step // MAX_SHARED_CURVES % step
    axes.plot(seconds(values), values, label=label, markevery=(start, step), zorder=3, **style.line(slot))


def add_legend(figure: Figure, axes: Iterable[Axes]) -> None:
    """Add one legend below the figure for everything labelled in `axes`, each label once."""
    entries: dict[str, Any] = {}
    for panel in axes:
        handles, labels = panel.get_legend_handles_labels()
        entries |= {label: handle for label, handle in zip(labels, handles, strict=True) if label not in entries}
    lengths, space = [len(label) + HANDLE_LETTERS for label in entries], LETTERS_PER_INCH * figure.get_figwidth()
    columns = len(entries) if sum(lengths) <= space else max(1, int(space / max(lengths)))
    fixed = figure.get_layout_engine() is None
    if fixed:
        rows = -(-len(entries) // columns)
        figure.subplots_adjust(bottom=(0.75 + LINE_IN * rows) / figure.get_figheight())
    place: Any = "lower center" if fixed else "outside lower center"
    figure.legend(list(entries.values()), list(entries), loc=place, ncols=columns)


def use_log_scale(axis: Axis) -> None:
    """Make an axis logarithmic, with ticks as plain numbers; all data must have been drawn."""
    axis.axes.set(**{"yscale" if isinstance(axis, YAxis) else "xscale": "log"})
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1,) if high > WIDE_RANGE * low else (1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def visible_range(values: Array, failed: Collection[int]) -> tuple[float, float]:
    """Return axis limits within which most of the values (frames, controllers) can be told apart.

    Controllers that failed, or that strayed several times as far as the median one, may be cut off.
    """
    low, high = np.nanmin(values, axis=0, initial=0.0), np.nanmax(values, axis=0, initial=0.0)
    largest = np.maximum(-low, high)
    others = [value for i, value in enumerate(largest) if i not in failed and value] or largest
    bound = OUTLIER * float(np.median(others))
    return max(low.min(), -bound), min(high.max(), bound)

"""What the figures share: axes over time, curves that stay tellable, legends, saving."""

from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any, Literal

import numpy as np
from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from omni_control.kinematics import Array
from omni_mj.files import whole
from omni_mj.measure.limits import LIMITS
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show import style

TOGETHER = 3  # as many curves can be told apart in one pair of axes; more get axes each
WIDTH_IN, COLUMN_IN = 8.0, 3.2  # of a figure with one or two columns, and of each column of one with more
TITLE_PER_IN = 10  # letters of a title, at least
BINS = 600  # along a curve, narrower than a dot of the printed figure
MARKS = 12  # along a curve
OFF_SCALE = 1.5  # as many times as far as the others a row that failed may stray and still be shown whole
LIMIT_DASHES = dict(zip(LIMITS.values(), ("-", (0, (1, 1))), strict=True))
HALO = withStroke(linewidth=2.5, foreground="white")


def save(figure: Figure, stem: Path, svg: bool = True) -> None:
    """Write `stem`.png and, if wanted, `stem`.svg, the same bytes for the same figure."""
    # The canvases draw once, where savefig would draw twice; the layout found for one is right for the other.
    figure.dpi = rcParams["savefig.dpi"]
    with whole(stem.with_suffix(".png")) as file:
        FigureCanvasAgg(figure).print_png(file)  # type: ignore[no-untyped-call]
    if not svg:
        return
    figure.set_layout_engine("none")
    with whole(stem.with_suffix(".svg")) as file:
        FigureCanvasSVG(figure).print_svg(file, metadata={"Date": None})  # type: ignore[no-untyped-call]


def save_png(figure: Figure, path: Path, dpi: float | None = None) -> None:
    """Write a figure to a PNG that appears whole or not at all.

    Args:
        figure: what is drawn.
        path: of the file.
        dpi: dots an inch. [the style's]
    """
    with whole(path) as file:
        figure.savefig(file, format="png", dpi=rcParams["savefig.dpi"] if dpi is None else dpi)


def title(figure: Figure, text: str, notes: Sequence[str] = ()) -> None:
    """Write the title, and notes on lines of their own below it, as long as the figure is wide."""
    wide = round(TITLE_PER_IN * figure.get_figwidth())
    lines = [text, *(line for note in notes for line in wrap(note, wide))]
    figure.suptitle("\n".join(lines), x=0.01, ha="left")


def over_time(
    length: int, rows: int, columns: int = 1, height: float = 2.2, sharey: Literal["none", "all", "col"] = "none"
) -> tuple[Figure, np.ndarray]:
    """A figure with axes (rows, columns) over the frames 0 to length - 1, with seconds on top, as in the paper."""
    figure = Figure(figsize=(max(WIDTH_IN, COLUMN_IN * columns), 0.9 + height * rows))
    grid = figure.subplots(rows, columns, sharex=True, sharey=sharey, squeeze=False)
    grid[0, 0].set_xlim(0, max(length - 1, 1))
    for axes in grid[0]:
        seconds = axes.secondary_xaxis("top", functions=(lambda k: k / FRAME_RATE_HZ, lambda s: s * FRAME_RATE_HZ))
        seconds.set_xlabel("time in s")
        seconds.spines["top"].set_visible(True)
    for axes in grid[-1]:
        axes.set_xlabel("time in frames of 1/60 s (fp)")
    return figure, grid


def thin(values: Array) -> tuple[np.ndarray, Array]:
    """Frames and values (m,) of a curve (frames,); a long one keeps the least and the greatest value of each bin."""
    bins = np.array_split(np.arange(len(values)), BINS) if len(values) > 2 * BINS else []
    if not bins:
        return np.arange(len(values)), values
    low, high = np.where(np.isnan(values), np.inf, values), np.where(np.isnan(values), -np.inf, values)
    kept = np.unique([(b[low[b].argmin()], b[high[b].argmax()]) for b in bins])
    return kept, values[kept]


def curve(axes: Axes, values: Array, index: int, slot: int, label: str) -> None:
    """Draw values (frames,) of a run's index-th controller with the colour, dashes and markers of its slot."""
    frames, kept = thin(values)
    step = max(len(kept) // MARKS, 1)
    start = (index * step // TOGETHER) % step
    axes.plot(frames, kept, label=label, markevery=(start, step), zorder=3, **style.line(slot))


def legend(figure: Figure, axes: Axes | Sequence[Axes], columns: int = 5) -> None:
    """One legend below the figure for what is labelled in `axes`, each label once."""
    entries: dict[str, Artist] = {}
    for each in [axes] if isinstance(axes, Axes) else axes:
        handles, labels = each.get_legend_handles_labels()
        entries |= {
            label: handle for handle, label in zip(handles, labels, strict=True) if label and label not in entries
        }
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=min(len(entries), columns))


def mark_greatest(axes: Axes, values: Array, slot: int, text: str) -> None:
    """Label the greatest of a controller's values (frames,) where it is."""
    frame = int(np.nanargmax(values))
    inward = "left" if frame < 0.03 * len(values) else "right" if frame > 0.97 * len(values) else "center"
    axes.annotate(
        text, (frame, values[frame]), (0, 4), textcoords="offset points", ha=inward, va="bottom", fontsize=8,
        color=style.colour(slot), annotation_clip=False, zorder=5, path_effects=[HALO],
    )  # fmt: skip


def mark_failure(axes: Axes, frame: int, slot: int, name: str) -> None:
    """Draw a line where a controller's row was stopped."""
    axes.axvline(frame, color=style.colour(slot), lw=1, ls=(0, (1, 1)), zorder=2, label=f"{name} failed")


def mark_limit(axes: Axes, value: float, name: str, span: tuple[float, float] | None = None) -> None:
    """Draw the line of a limit that is called `name`, from one place to another up the axes, or all the way."""
    look: dict[str, Any] = {"color": "black", "lw": 1.4, "ls": LIMIT_DASHES[name], "zorder": 2.5, "label": name}
    if span is None:
        axes.axvline(value, **look)
    else:
        axes.vlines(value, *span, **look)


def greatest(values: Array, failed: Sequence[int]) -> float:
    """How far up axes must reach for non-negative values (frames, controllers), least so to tell those apart.

    A controller that failed may be shown in part, so that the others remain to be seen.
    """
    most = np.nanmax(values, axis=0, initial=0.0)
    whole = np.delete(most, list(failed))
    top = float(most.max())
    return min(top, OFF_SCALE * float(whole.max())) if whole.size and whole.max() > 0 else top

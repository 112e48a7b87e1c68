"""What the figures share: panels, axes over time, curves that stay tellable, legends, saving."""

from collections.abc import Collection, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any, Literal

import numpy as np
from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, MaxNLocator, MultipleLocator, NullFormatter, NullLocator

from omni_control.kinematics import Array
from omni_mj.files import whole
from omni_mj.measure.limits import LIMITS
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show import style
from omni_mj.show.figures import lettering, scales

TOGETHER = 3  # as many curves can be told apart in one pair of axes; more get axes each
LEFT_IN, RIGHT_IN, ABOVE_IN, BELOW_IN = 0.7, 0.2, 0.3, 0.6  # around the panels, for what is written beside them
GAP_IN = (0.65, 0.42)  # between panels
WIDTH_IN, COLUMN_IN = 7.1, 2.6  # of the panels of a figure with one or two columns, and of each of one with more
LINE_IN, HEAD_IN, FOOT_IN = 0.18, 0.08, 0.1  # of a line of the title or legend, and around them
ENTRY_IN, LETTER_IN = 0.75, 0.075  # of a legend: around a label, and each of its letters
TITLE_PER_IN, SMALL_PER_IN = 11, 14  # letters of a title and of what is written smaller, at least
SECONDS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600)  # between ticks
TICKS = 7  # along an axis over time at most, by the inch of which there are two
BINS = 600  # along a curve, narrower than a dot of the printed figure
MARKS = 12  # along a curve
OFF_SCALE = 1.5  # as many times as far as the others a row that failed may stray and still be shown whole
LOST = 3.0  # as many times as far as most controllers strayed one that is shown in part too
LIMIT_DASHES = dict(zip(LIMITS.values(), ("-", (0, (1, 1))), strict=True))
MANY = 200.0  # ratio of greatest to least above which 1, 2, 5 are too many ticks for a decade
STEPS = (1, 2, 2.5, 5, 10)  # between ticks, in powers of ten
TO_COMPARE: dict[str, Any] = {"color": style.REFERENCE, "lw": 0.8}
HALO = withStroke(linewidth=2.5, foreground="white")


def save(figure: Figure, stem: Path, svg: bool = True) -> None:
    """Write `stem`.png and, if wanted, `stem`.svg, the same bytes for the same figure."""
    if figure.get_layout_engine() is None:
        scales.flatten(figure)
    # The canvases draw once, where savefig would draw twice; the layout found for one is right for the other.
    figure.dpi = rcParams["savefig.dpi"]
    image = lettering.picture(figure)
    with whole(stem.with_suffix(".png")) as file:
        image.save(file, "png", compress_level=1, dpi=(figure.dpi, figure.dpi))
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


def title(figure: Figure, text: str, notes: Sequence[str] = (), explained: str = "") -> None:
    """Write the title, notes and an explanation, smaller, below it, in lines as long as the figure is wide."""
    wide = figure.get_figwidth()
    lines = [line for part in (text, *notes) for line in wrap(part, round(TITLE_PER_IN * wide), break_on_hyphens=False)]
    small = wrap(explained, round(SMALL_PER_IN * wide))
    _grow(figure, above=HEAD_IN + LINE_IN * (len(lines) + 0.9 * len(small)))
    high = figure.get_figheight()
    on_sheet = {} if figure.get_layout_engine() else {"y": 1 - HEAD_IN / high, "va": "top"}
    figure.suptitle("\n".join(lines), x=0.01, ha="left", **on_sheet)
    below = 1 - (1.2 * HEAD_IN + LINE_IN * len(lines)) / high
    figure.text(0.01, below, "\n".join(small), va="top", fontsize=8.5, linespacing=1.25)


def sheet(width: float, height: float) -> Figure:
    """A figure of so many inches for panels and what is written beside them; `title` and `legend` add their own.

    Nothing is measured to lay it out, which would take longer than to draw it.
    """
    return Figure(figsize=(width, height), layout="none")  # type: ignore[arg-type]  # which its stub forgets


def panels(
    rows: int,
    columns: int,
    width: float,
    height: float,
    sharey: Literal["none", "all", "col", "row"] = "none",
    gap: tuple[float, float] = GAP_IN,
    left: float = LEFT_IN,
    above: float = ABOVE_IN,
    right: float = RIGHT_IN,
    sharex: Literal["none", "all", "col"] = "none",
) -> tuple[Figure, np.ndarray]:
    """A sheet with panels (rows, columns) of so many inches each, `gap` apart, `left` and so on from its edges."""
    wide = left + columns * width + (columns - 1) * gap[0] + right
    high = above + rows * height + (rows - 1) * gap[1] + BELOW_IN
    figure = sheet(wide, high)
    figure.subplots_adjust(
        left / wide, BELOW_IN / high, 1 - right / wide, 1 - above / high, gap[0] / width, gap[1] / height
    )
    return figure, figure.subplots(rows, columns, sharex=sharex, sharey=sharey, squeeze=False)


def _grow(figure: Figure, above: float = 0.0, below: float = 0.0) -> None:
    """Make a sheet higher by as many inches above and below its panels, which stay as they are."""
    if figure.get_layout_engine() is not None:
        return
    wide, high = figure.get_size_inches()
    total = high + above + below
    for axes in figure.axes:
        x, y, width, height = axes.get_position(original=True).bounds
        axes.set_position((x, (y * high + below) / total, width, height * high / total))
    figure.set_size_inches(wide, total)


def over_time(
    length: int,
    rows: int,
    columns: int = 1,
    height: float = 1.8,
    sharey: Literal["none", "all", "col"] = "none",
    width: float = WIDTH_IN,
    right: float = RIGHT_IN,
) -> tuple[Figure, np.ndarray]:
    """A sheet with axes (rows, columns) over the frames 0 to length - 1, which are the paper's, and seconds."""
    width = (width - (columns - 1) * GAP_IN[0]) / columns if columns < 3 else COLUMN_IN
    figure, grid = panels(rows, columns, width, height, sharey, sharex="all", right=right)
    last = max(length - 1, 1)
    axis = grid[0, 0].xaxis
    apart = next((each for each in SECONDS if last / FRAME_RATE_HZ / each <= min(2 * width, TICKS)), SECONDS[-1])
    axis.set_major_locator(MultipleLocator(apart * FRAME_RATE_HZ))
    axis.set_major_formatter(lambda frame, _: f"{frame:g}\n{frame / FRAME_RATE_HZ:g} s")
    grid[0, 0].set_xlim(0, last)
    for axes in grid.flat:
        axes.yaxis.set_major_locator(MaxNLocator(max(round(3 * height), 3), steps=STEPS))
    for axes in grid[-1]:
        axes.set_xlabel("frames of 1/60 s (fp)")
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
    columns = min(len(entries), columns)
    while columns > 1 and _legend_in(list(entries), columns) > figure.get_figwidth():
        columns -= 1
    _grow(figure, below=FOOT_IN + 1.15 * LINE_IN * -(-len(entries) // columns))
    place: Literal["lower center", "outside lower center"]
    place = "outside lower center" if figure.get_layout_engine() else "lower center"
    figure.legend(list(entries.values()), list(entries), loc=place, ncols=columns)


def _legend_in(labels: Sequence[str], columns: int) -> float:
    """About how wide a legend of so many columns is, inches; matplotlib fills them as evenly as they can be."""
    letters = np.array_split([len(label) for label in labels], columns)
    return float(sum(ENTRY_IN + LETTER_IN * column.max() for column in letters))


def logarithmic(axes: Axes, low: float, high: float) -> None:
    """Make the scale across logarithmic, from `low` to `high`, both above 0."""
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    plain(axes.xaxis)


def plain(axis: Axis) -> None:
    """Write the values of a logarithmic axis, whose limits are final, as plain numbers."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1,) if high > MANY * low else (1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
    if high <= MANY * low:
        axis.set_minor_locator(NullLocator())


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


def shown_in_part(values: Array, failed: Collection[int]) -> list[int]:
    """The controllers whose values (frames, controllers) are beyond what lets the others be seen.

    Those that failed may be, and those that strayed several times as far as most.
    """
    most = np.nanmax(np.abs(values), axis=0, initial=0.0)
    whole = np.delete(most, list(failed))
    typical = float(np.median(whole)) if whole.size else 0.0
    return [i for i, each in enumerate(most) if i in failed or each > LOST * typical > 0]


def reach(values: Array, failed: Collection[int]) -> tuple[float, float]:
    """The least and the greatest to be shown of values (frames, controllers), so that most can be told apart."""
    hidden = shown_in_part(values, failed)
    low, high = np.nanmin(values, axis=0, initial=0.0), np.nanmax(values, axis=0, initial=0.0)
    ends = float(low.min()), float(high.max())
    if len(hidden) == values.shape[1]:
        return ends
    whole = OFF_SCALE * float(np.delete(low, hidden).min()), OFF_SCALE * float(np.delete(high, hidden).max())
    return (max(ends[0], whole[0]), min(ends[1], whole[1])) if hidden and whole[0] < whole[1] else ends

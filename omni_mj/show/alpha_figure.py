"""The figure of the alpha study: gain and lag under each condition, and what each cause takes of them."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style as matplotlib_style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.studies.conditions import CAUSES, LABELS, PROFILE, WORN
from omni_mj.studies.drives import DIRECTIONS

if TYPE_CHECKING:
    from omni_mj.studies.alpha_findings import Study

QUANTITIES = {
    "steady": ("steady gain", 1.0),
    "speeding_up": ("gain while speeding up", 1.0),
    "lag_s": ("lag in ms", 1000.0),
}
MARKS, HATCHES = "os^", ("", "///", "...")  # of directions, for those who see no colours
COLUMNS = 4  # of conditions
LOGARITHMIC = 30  # times the least value: beyond it, an axis is


def save(study: "Study", path: Path) -> None:
    """Draw the study into a PNG: conditions in pairs of panels, gain above lag, and what causes take below them."""
    with matplotlib_style.context(style.SHEET):
        names = list(study.changed)
        bands = -(-len(names) // COLUMNS)
        figure = Figure(figsize=(11, 3.6 + 4.0 * bands))
        *upper, lower = figure.subfigures(bands + 1, 1, height_ratios=[4.0] * bands + [3.2], squeeze=False)[:, 0]
        for band, part in enumerate(upper):
            grid = part.subplots(2, COLUMNS, sharey="row", squeeze=False)
            for pair, name in itertools.zip_longest(grid.T, names[band * COLUMNS :][:COLUMNS]):
                _condition(study, name, *pair)
        for axes, name in zip(lower.subplots(1, len(QUANTITIES)), QUANTITIES, strict=True):
            _causes(study, name, axes)
        drive = f"{PROFILE.speed_m_s:g} m/s at {PROFILE.acceleration_m_s2:g} m/s², unless the panel changes it"
        figure.suptitle(f"Gain and lag of a robot's motion: {drive}", x=0.01, ha="left")
        worn = f"windings at {WORN['winding_c']:g} °C, battery at {100 * WORN['charge']:g} %"
        lower.suptitle(f"What takes how much ({worn}; mean over all orders, adds up)", x=0.01, ha="left")
        drawn = figure.axes[0] if bands else figure.axes[-1]
        figure.legend(*drawn.get_legend_handles_labels(), loc="outside lower center", ncols=len(DIRECTIONS))
        canvas.save_png(figure, path)


def _condition(study: "Study", name: str | None, gain: Axes, lag: Axes) -> None:
    """Gain above and lag below, over the values of a condition, a colour for each direction; nothing without one."""
    if name is None:
        gain.set_axis_off()
        lag.set_axis_off()
        return
    values, found = study.conditions[name], study.changed[name]
    for i, direction in enumerate(DIRECTIONS):
        colour, mark = style.colour(i), MARKS[i]
        gain.plot(values, found.steady[:, i], f"{mark}-", color=colour, label=f"{direction}, steady")
        gain.plot(
            values, found.speeding_up[:, i], f"{mark}:", color=colour, mfc="white", label=f"{direction}, speeding up"
        )
        lag.plot(values, 1000 * found.lag_s[:, i], f"{mark}-", color=colour)
    every = list(study.changed.values())
    gain.set_ylim(np.nanmin([np.nanmin(r.speeding_up) for r in every]) - 0.05, 1.05)
    lag.set_ylim(0, 1050 * np.nanmax([np.nanmax(r.lag_s) for r in every]))
    for axes, label in ((gain, "gain"), (lag, "lag in ms")):
        axes.margins(x=0.06)
        if min(values) > 0 and max(values) > LOGARITHMIC * min(values):
            axes.set_xscale("log")
            canvas.plain(axes.xaxis)
        else:
            axes.set_xticks(values, [f"{value:g}" for value in values])
        if axes.get_subplotspec().is_first_col():  # type: ignore[union-attr]
            axes.set_ylabel(label)
    gain.set_title(LABELS[name])


def _causes(study: "Study", name: str, axes: Axes) -> None:
    """Bars: what each cause adds to a quantity, and what the wheel loop leaves without any of them."""
    label, factor = QUANTITIES[name]
    left = getattr(study.loop, name) - (0.0 if name == "lag_s" else 1.0)
    added = {"wheel loop": left} | {cause: each["share"] for cause, each in study.shares(name).items()}
    width = 0.8 / len(DIRECTIONS)
    for i in range(len(DIRECTIONS)):
        at = np.arange(1 + len(CAUSES)) + (i - 1) * width
        axes.bar(
            at,
            [factor * each[i] for each in added.values()],
            width,
            color=style.colour(i),
            hatch=HATCHES[i],
            edgecolor="white",
            lw=0,
            label=list(DIRECTIONS)[i],
        )
    axes.axhline(0, color="#888888", lw=0.8)
    axes.set_xticks(range(len(added)), list(added))
    axes.set_title(label if name == "lag_s" else f"{label}: what is missing of 1")
    axes.margins(x=0.02)

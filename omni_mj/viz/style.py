"""Colours, line styles and markers shared by figures and recordings.

A controller keeps its own in every figure, recording, film and comparison: those that ship have slots, a user's take
those left. The colours are Okabe and Ito's, then some of Tol's: distinct to the colour-blind. In grey some of them fall
together; there a controller is known by its line style and marker.
"""

from collections.abc import Iterable
from itertools import cycle
from pathlib import Path
from typing import Any

Rgb = tuple[int, int, int]  # bytes
STYLE_SHEET = Path(__file__).with_name("omni.mplstyle")
REFERENCE = "#7F7F7F"
BACKGROUND = "#C8C8C8"
COLOURS = (
    "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#999933", "#332288",
    "#661100", "#AA4499", "#117733",
)  # fmt: skip
MARKERS = "os^DvPX*ph<>"
DASHES: tuple[tuple[float, ...], ...] = ((), (4, 1.5), (6, 1.5, 1, 1.5), (1.2, 1.2), (9, 2))
SHIPPED = (
    "flc",
    "comp-flc",
    "adaptive-comp-flc",
    "mpc",
    "comp-flc-lag",
    "lqr",
    "p",
    "smith",
    "oracle",
    "inverse-flc",
)


def style_indices(controllers: Iterable[str]) -> dict[str, int]:
    """Return the slot of each controller of a run, for `colour` and `line`: those that ship have their own."""
    names = dict.fromkeys(controllers)
    shipped = {name: SHIPPED.index(name) for name in names if name in SHIPPED}
    order = [*range(len(SHIPPED), len(COLOURS)), *range(len(SHIPPED))]
    free = cycle(slot for slot in order if slot not in shipped.values())
    return {name: shipped[name] if name in shipped else next(free) for name in names}


def colour(slot: int) -> str:
    """Colour of a slot; of a robot's wheel of that number where a plot shows one controller alone."""
    return COLOURS[slot % len(COLOURS)]


def line_style(slot: int) -> dict[str, Any]:
    """Return matplotlib's properties of the line of a slot: colour, dashes and marker."""
    marker, dashes = MARKERS[slot % len(MARKERS)], DASHES[slot % len(DASHES)]
    return {
        "color": colour(slot), "linestyle": (0, dashes) if dashes else "-", "marker": marker,
        "markersize": 7.0 if marker in "PX*" else 5.0, "markeredgecolor": "white", "markeredgewidth": 0.6,
    }  # fmt: skip


def rgb(colour: str) -> Rgb:
    """Return a colour like #D55E00 as three bytes."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def mix_with_white(colour: Rgb, share: float = 0.5) -> Rgb:
    """Return a colour with a `share` of white."""
    red, green, blue = (round(c + share * (255 - c)) for c in colour)
    return red, green, blue

"""Colors, line styles and markers shared by figures, recordings and films.

A built-in controller has the same style everywhere. Users' controllers take the remaining styles.
The first six colors are Okabe and Ito's palette, the others follow Paul Tol's; all can be
distinguished by people with color vision deficiency and stand out on white and on black. In
grayscale, line style and marker identify the controller.
"""

from collections.abc import Iterable
from itertools import count
from pathlib import Path
from typing import Any

Rgb = tuple[int, ...]  # three bytes
STYLE_SHEET = Path(__file__).with_name("omni.mplstyle")
REFERENCE = "#7F7F7F"
BACKGROUND = "#C8C8C8"
COLORS = (
    "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#B0306A", "#999933",
    "#7262D8", "#8C564B", "#AA4499", "#117733",
)  # fmt: skip
MARKERS = "os^DvPX*ph<>"
LARGE_MARKERS = "PX*"  # which look smaller than others of the same size
# Lengths of dashes and gaps in line widths; empty for a solid line.
DASHES = ((), (4, 1.5), (6, 1.5, 1, 1.5), (1.2, 1.2), (9, 2))
BUILT_IN_CONTROLLERS = (
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
    """Return the style index of each controller of a run, for `color` and `line_style`."""
    names = dict.fromkeys(controllers)
    fixed = {name: i for i, name in enumerate(BUILT_IN_CONTROLLERS) if name in names}
    indices = count(len(BUILT_IN_CONTROLLERS))
    free = (index for index in indices if index % len(COLORS) not in fixed.values())
    return {name: fixed[name] if name in fixed else next(free) for name in names}


def color(index: int) -> str:
    """Return the color of a controller's style index, or of a wheel, like #D55E00."""
    return COLORS[index % len(COLORS)]


def line_style(index: int) -> dict[str, Any]:
    """Return matplotlib's line properties of a style index: color, dashes and marker."""
    marker = MARKERS[index % len(MARKERS)]
    dashes = DASHES[index % len(DASHES)]
    return {
        "color": color(index),
        "linestyle": (0, dashes) if dashes else "-",
        "marker": marker,
        "markersize": 7.0 if marker in LARGE_MARKERS else 5.0,
        "markeredgecolor": "white",
        "markeredgewidth": 0.6,
    }


def rgb(hex_color: str) -> Rgb:
    """Return a color like #D55E00 as three bytes."""
    return tuple(bytes.fromhex(hex_color[1:]))


def mix_with_white(color: Rgb, fraction: float = 0.5) -> Rgb:
    """Return a color mixed with a fraction of white."""
    return tuple(round(byte + fraction * (255 - byte)) for byte in color)

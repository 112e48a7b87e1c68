"""Colours, line styles and markers shared by figures and recordings.

The colours are Okabe and Ito's, then three of Tol's: distinct to the colour-blind. In grey some of them fall together;
there a controller is known by its line style and marker.
"""

from pathlib import Path
from typing import Any

SHEET = Path(__file__).with_name("omni.mplstyle")
REFERENCE = "#7F7F7F"
BACKGROUND = "#C8C8C8"
CONTROLLERS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#999933", "#332288")
DASHES = (
    "-",
    (0, (4, 1.5)),
    (0, (6, 1.5, 1, 1.5)),
    (0, (1.2, 1.2)),
    (0, (9, 2)),
    (0, (6, 1, 1, 1, 1, 1)),
    "-",
    (0, (2, 1)),
    (0, (3, 1, 3, 1, 1, 1)),
)
# Markers, and sizes that look alike.
MARKERS = {"o": 5.0, "s": 5.0, "^": 5.5, "D": 4.5, "v": 5.5, "P": 6.5, "X": 6.5, "*": 8.5, "p": 6.0}


def controller(index: int) -> str:
    """Colour of a run's index-th controller; of a robot's index-th wheel where a plot shows one controller alone."""
    return CONTROLLERS[index % len(CONTROLLERS)]


def line(index: int) -> dict[str, Any]:
    """Matplotlib's properties of the line of a run's index-th controller, told apart by each of the three."""
    marker, size = list(MARKERS.items())[index % len(MARKERS)]
    dashes = DASHES[index % len(DASHES)]
    return {
        "color": controller(index), "linestyle": dashes,
        "marker": marker, "markersize": size, "markeredgecolor": "white", "markeredgewidth": 0.6,
    }  # fmt: skip


def rgb(colour: str) -> tuple[int, int, int]:
    """A colour like #D55E00 as three bytes."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)

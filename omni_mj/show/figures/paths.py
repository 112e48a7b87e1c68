"""Figure of the paths: at full scale differences vanish, so each controller's largest deviation is enlarged."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from omni_control.kinematics import Array
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.first import FirstRows

HALF_WIDTH = 0.75  # of a square, in deviations
MIN_HALF_M = 0.005
MAX_HALF = 1 / 12  # of a square, in extents of the path
COLUMNS = 4
MAX_PAIRS = 500_000  # of points and pieces, to be compared at once
NUMBER_PT = 8  # width of a square's number


@dataclass(frozen=True)
class Spot:
    """Place of a controller's largest deviation from the path.

    Args:
        centre: Centre of the square that is enlarged, (2,) m.
        half: Half its width, m.
        deviation: Distance of the robot from the path, m.
    """

    centre: Array
    half: float
    deviation: float


def draw_paths(first: FirstRows, figure: Figure) -> None:
    """Draw the reference and the paths (figures 7 and 10), enlarged where each controller strays farthest."""
    reference, positions = first.reference[:, :2], first.channel("pose")[..., :2]
    count = len(first.names)
    columns = min(count, COLUMNS)
    rows = -(-count // columns)
    figure.set_size_inches(8, 5.4 + 2.5 * rows)
    numbers: Any = np.where(np.arange(rows * columns) < count, np.arange(rows * columns), -1).reshape(rows, columns)
    mosaic: Any = [["path"] * columns, *numbers.tolist()]
    grid: dict[Any, Axes] = figure.subplot_mosaic(mosaic, height_ratios=[2.2, *[1] * rows], empty_sentinel=-1)
    overview = grid.pop("path")
    _draw(overview, first, range(count))
    overview.plot(*reference[0], "o", color="black", ms=6, zorder=6, label="start")
    for i in first.failed:
        end = positions[max(first.lengths[i] - 1, 0), i]
        look: dict[str, Any] = {"color": style.colour(first.slots[i]), "ms": 8, "mec": "black", "zorder": 6}
        overview.plot(*end, "X", label=f"{first.names[i]} failed", **look)
    halo = [withStroke(linewidth=2.5, foreground="white")]
    for i, spot in enumerate(find_spots(reference, positions)):
        _draw(grid[i], first, range(count) if count <= canvas.MAX_SHARED_CURVES else {0, i}, spot.centre, 100)
        limits = (-100 * spot.half, 100 * spot.half)
        title, label = f"{i + 1} {first.names[i]}", f"{100 * spot.deviation:.3g} cm off"
        grid[i].set(xlim=limits, ylim=limits, xlabel=label, title=title)
        grid[i].spines[:].set_visible(True)
        corner, edge, width = spot.centre - spot.half, style.colour(first.slots[i]), 2 * spot.half
        overview.add_patch(Rectangle(tuple(corner), width, width, fill=False, ec=edge, lw=1, zorder=7))
        place, look = (NUMBER_PT * i, 0), {"color": edge, "weight": "bold", "zorder": 8, "path_effects": halo}
        overview.annotate(str(i + 1), tuple(corner + width), place, textcoords="offset points", **look)
    figure.subplots_adjust(0.75 / figure.get_figwidth(), right=0.98, wspace=0.25, hspace=0.35)
    overview.margins(0.06)
    overview.set(xlabel="x in m", ylabel="y in m")
    canvas.add_legend(figure, [overview])
    figure.suptitle("Path travelled, and enlarged, in cm, where each controller strays farthest")


def find_spots(reference: Array, positions: Array) -> list[Spot]:
    """Return the place where each controller is farthest from the path.

    Args:
        reference: Points of the path, (frames, 2) m.
        positions: Positions of the robots, (frames, controllers, 2) m.
    """
    everything = np.concatenate([reference, *np.nan_to_num(positions)])
    largest = max(MAX_HALF * float(np.ptp(everything, axis=0).max()), MIN_HALF_M)
    spots = []
    for travelled in np.moveaxis(positions, 1, 0):
        feet = _nearest(reference, travelled[~np.isnan(travelled[:, 0])])
        distance = np.linalg.norm(travelled[: len(feet)] - feet, axis=1)
        frame = int(distance.argmax())
        half = max(HALF_WIDTH * float(distance[frame]), MIN_HALF_M)
        # A deviation that does not fit into a square shows in the overview; the square then shows the robot.
        centre = travelled[frame] if half > largest else (travelled[frame] + feet[frame]) / 2
        spots.append(Spot(centre, min(half, largest), float(distance[frame])))
    return spots


def _nearest(path: Array, points: Array) -> Array:
    """Return the point of a path (n, 2) of straight pieces that is nearest to each of some points (m, 2)."""
    steps = np.diff(path, axis=0, append=path[-1:])
    lengths = np.maximum((steps**2).sum(1), 1e-30)
    nearest = []
    for part in np.array_split(points, 1 + len(points) * len(path) // MAX_PAIRS):
        gaps = part[:, None] - path
        share = np.clip(np.einsum("ijk,jk->ij", gaps, steps) / lengths, 0, 1)
        gaps -= share[..., None] * steps
        piece = np.einsum("ijk,ijk->ij", gaps, gaps).argmin(1)
        nearest.append(part - gaps[np.arange(len(part)), piece])
    return np.concatenate(nearest)


def _draw(
    axes: Axes, first: FirstRows, controllers: Iterable[int], origin: Array | float = 0.0, scale: float = 1.0
) -> None:
    """Draw the reference and the paths of some controllers, from an origin (2,), in 1 / `scale` m."""
    reference = scale * (first.reference[:, :2] - origin)
    axes.plot(*reference.T, color=style.BACKGROUND, lw=4, zorder=1, label="reference")
    for i in controllers:
        travelled = scale * (first.channel("pose")[:, i, :2] - origin)
        axes.plot(*travelled.T, zorder=3, label=first.names[i], **style.line(first.slots[i]) | {"marker": ""})
    axes.set_aspect("equal", adjustable="box")

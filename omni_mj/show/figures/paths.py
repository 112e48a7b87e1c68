"""Figure of the paths: at full scale differences vanish, so each controller's largest deviation is enlarged."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from scipy.spatial import cKDTree

from omni_control.kinematics import Array
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.first import FirstRows

FINER = 20  # points of the reference between two frames, to search the nearest in
HALF_WIDTH = 0.75  # of a square, in deviations
MIN_HALF_M = 0.005
MAX_HALF = 1 / 12  # of a square, in extents of the path
NEARBY = 0.08  # distance, in extents of the path, within which squares share one mark
COLUMNS = 4


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
    spots = find_spots(reference, positions)
    overview, *details = _axes(figure, len(spots))
    together = len(spots) <= canvas.MAX_SHARED_CURVES
    for i, (axes, spot) in enumerate(zip(details, spots, strict=False)):
        others = [k for k in range(len(spots)) if k != i] if together else [0] * bool(i)
        _draw(axes, first, [*others, i], spot.centre, 100)
        limits = (-100 * spot.half, 100 * spot.half)
        axes.set(
            xlim=limits, ylim=limits, xlabel=f"{100 * spot.deviation:.3g} cm off", title=f"{i + 1} {first.names[i]}"
        )
        axes.spines[:].set_visible(True)
        corner, edge = spot.centre - spot.half, style.colour(first.slots[i])
        overview.add_patch(Rectangle(tuple(corner), 2 * spot.half, 2 * spot.half, fill=False, ec=edge, lw=1, zorder=7))
    _draw(overview, first, range(len(spots)))
    overview.plot(*reference[0], "o", color="black", ms=6, zorder=6, label="start")
    for i in first.failed:
        end = positions[max(first.lengths[i] - 1, 0), i]
        look: dict[str, Any] = {"color": style.colour(first.slots[i]), "ms": 8, "mec": "black", "zorder": 6}
        overview.plot(*end, "X", label=f"{first.names[i]} failed", **look)
    halo = [withStroke(linewidth=2.5, foreground="white")]
    groups = defaultdict(list)
    for i, spot in enumerate(spots):
        cell = np.round(spot.centre / max(NEARBY * float(np.ptp(reference, axis=0).max()), MIN_HALF_M))
        groups[tuple(cell)].append(i)
    for group in groups.values():
        corner = spots[group[0]].centre + spots[group[0]].half
        numbers = " ".join(str(i + 1) for i in group)
        overview.annotate(numbers, tuple(corner), weight="bold", zorder=8, path_effects=halo, annotation_clip=False)
    figure.subplots_adjust(0.75 / figure.get_figwidth(), right=0.98, wspace=0.25, hspace=0.45)
    overview.margins(0.06)
    overview.set(xlabel="x in m", ylabel="y in m")
    canvas.add_legend(figure, [overview, *details])
    figure.suptitle("Path travelled, and enlarged, in cm, where each controller strays farthest")


def find_spots(reference: Array, positions: Array) -> list[Spot]:
    """Return the place where each controller is farthest from the path.

    Args:
        reference: Points of the path, (frames, 2) m.
        positions: Positions of the robots, (frames, controllers, 2) m.
    """
    fine_frames = np.linspace(0, len(reference) - 1, FINER * len(reference))
    fine = np.column_stack([np.interp(fine_frames, np.arange(len(reference)), column) for column in reference.T])
    tree = cKDTree(fine)
    most = max(
        MAX_HALF * float(np.ptp(np.concatenate([reference, *np.nan_to_num(positions)]), axis=0).max()), MIN_HALF_M
    )
    spots = []
    for travelled in np.moveaxis(positions, 1, 0):
        distance, nearest = tree.query(travelled[~np.isnan(travelled[:, 0])])
        frame = int(distance.argmax())
        half = max(HALF_WIDTH * float(distance[frame]), MIN_HALF_M)
        # A deviation that does not fit into a square shows in the overview; the square then shows the robot.
        centre = travelled[frame] if half > most else (travelled[frame] + fine[nearest[frame]]) / 2
        spots.append(Spot(centre, min(half, most), float(distance[frame])))
    return spots


def _axes(figure: Figure, count: int) -> list[Axes]:
    """Return the axes of the overview and of `count` squares, at its right if they are few, else below it."""
    if count <= canvas.MAX_SHARED_CURVES:
        figure.set_size_inches(9, max(4.8, 2.1 * count + 0.8))
        mosaic: Any = [["path", i] for i in range(count)]
        axes = figure.subplot_mosaic(mosaic, width_ratios=[3.4, 1])
    else:
        rows = -(-count // COLUMNS)
        figure.set_size_inches(8, 5 + 2.2 * rows)
        cells = [i if i < count else "." for i in range(rows * COLUMNS)]
        mosaic = [["path"] * COLUMNS, *(cells[k : k + COLUMNS] for k in range(0, len(cells), COLUMNS))]
        axes = figure.subplot_mosaic(mosaic, height_ratios=[2.2, *[1] * rows])
    return [axes["path"], *(axes[i] for i in range(count))]


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

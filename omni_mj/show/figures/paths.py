"""Figure of the paths: at full scale differences vanish, so each controller's largest deviation is enlarged."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.spatial import KDTree

from omni_control.kinematics import Array
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.series import FirstRows

HALF_WIDTH, MIN_HALF_M = 1.25, 0.005  # of a square, in deviations; at least
COLUMNS, TOGETHER = 4, 3  # squares in a row; controllers that a square shows at most, else its own and the first
STEP_M = 0.0005  # of points on the path, to which distances are measured


def draw_paths(first: FirstRows, figure: Figure) -> None:
    """Draw the reference and the paths (figures 7 and 10), enlarged where each controller strays farthest."""
    positions, names = first.channel("pose")[..., :2], list(first.looks)
    columns = min(len(names), COLUMNS)
    rows = -(-len(names) // columns)
    figure.set_size_inches(8, 5.4 + 2.5 * rows)
    cells = [*names, *["."] * (columns * rows - len(names))]
    squares: Any = [cells[columns * row : columns * (row + 1)] for row in range(rows)]
    grid = figure.subplot_mosaic([["path "] * columns, *squares], height_ratios=[2.2, *[1] * rows])
    overview = grid["path "]
    _draw(overview, first, names)
    overview.plot(*first.reference[0, :2], "o", color="black", ms=6, zorder=6, label="start")
    for i, name in enumerate(names):
        colour, axes = first.looks[name]["color"], grid[name]
        travelled = positions[~np.isnan(positions[:, i, 0]), i]
        if name in first.failed:
            overview.plot(*travelled[-1], "X", color=colour, ms=8, mec="black", zorder=6, label=f"{name} failed")
        distance = distance_to_path(first.reference[:, :2], travelled)
        centre, deviation = travelled[distance.argmax()], float(distance.max())
        half = max(HALF_WIDTH * deviation, MIN_HALF_M)
        _draw(axes, first, names if len(names) <= TOGETHER else {names[0], name}, centre, 100)
        limits = (-100 * half, 100 * half)
        axes.set(xlim=limits, ylim=limits, xlabel=f"{100 * deviation:.3g} cm off", title=f"{i + 1} {name}")
        axes.spines[:].set_visible(True)
        overview.add_patch(Rectangle(tuple(centre - half), 2 * half, 2 * half, fill=False, ec=colour, lw=1, zorder=7))
        place: dict[str, Any] = {"xytext": (8 * i, 0), "textcoords": "offset points"}
        overview.annotate(str(i + 1), tuple(centre + half), color=colour, weight="bold", zorder=8, **place)
    overview.margins(0.06)
    overview.set(xlabel="x in m", ylabel="y in m")
    canvas.add_legend(figure, [overview])
    figure.suptitle("Path travelled, and enlarged, in cm, where each controller strays farthest")


def distance_to_path(path: Array, points: Array) -> Array:
    """Return the distances of points (m, 2) from a path (n, 2) of straight pieces, (m,) m."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    along = np.linspace(0, arc[-1], 1 + int(arc[-1] / STEP_M))
    distance: Array = KDTree(np.column_stack([np.interp(along, arc, part) for part in path.T])).query(points)[0]
    return distance


def _draw(axes: Axes, first: FirstRows, names: Iterable[str], origin: Array | float = 0.0, scale: float = 1.0) -> None:
    """Draw the reference and the paths of some controllers, from an origin (2,), in 1 / `scale` m."""
    reference = scale * (first.reference[:, :2] - origin)
    axes.plot(*reference.T, color=style.BACKGROUND, lw=4, zorder=1, label="reference")
    for i, (name, look) in enumerate(first.looks.items()):
        if name in names:
            axes.plot(*(scale * (first.channel("pose")[:, i, :2] - origin)).T, zorder=3, label=name, **look)
    axes.set_aspect("equal", adjustable="box")

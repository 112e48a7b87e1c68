"""Figure of the paths: at full scale differences vanish, so each controller's largest deviation is enlarged."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.spatial import KDTree

from omni_control.kinematics import Array
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.series import Failures
from omni_mj.show.shown import Robot

HALF_WIDTH, MIN_HALF_M = 1.25, 0.005  # of a square, in deviations; at least
COLUMNS, TOGETHER = 4, 3  # squares in a row; controllers that a square shows at most, else its own and the first
STEP_M = 0.0005  # of points on the path, to which distances are measured


def draw_paths(robots: Sequence[Robot], failures: Failures, figure: Figure) -> None:
    """Draw the reference and the paths (figures 7 and 10), enlarged where each controller strays farthest."""
    reference = max(robots, key=lambda robot: robot.length)["ref"][:, :2]
    columns = min(len(robots), COLUMNS)
    rows = -(-len(robots) // columns)
    figure.set_size_inches(8, 5.4 + 2.5 * rows)
    grid = figure.add_gridspec(1 + rows, columns, height_ratios=[2.2, *[1] * rows])
    overview = figure.add_subplot(grid[0, :])
    _draw(overview, robots, reference)
    overview.plot(*reference[0], "o", color="black", ms=6, zorder=6, label="start")
    for i, robot in enumerate(robots):
        colour, travelled = style.colour(robot.slot), robot["pose"][:, :2]
        if robot.name in failures:
            overview.plot(*travelled[-1], "X", color=colour, ms=8, mec="black", zorder=6, label=f"{robot.name} failed")
        distance = distance_to_path(reference, travelled)
        centre, deviation = travelled[distance.argmax()], float(distance.max())
        half = max(HALF_WIDTH * deviation, MIN_HALF_M)
        axes = figure.add_subplot(grid[1 + i // columns, i % columns])
        _draw(axes, robots if len(robots) <= TOGETHER else [robots[0], robot], reference, centre, 100)
        limits = (-100 * half, 100 * half)
        axes.set(xlim=limits, ylim=limits, xlabel=f"{100 * deviation:.3g} cm off", title=f"{i + 1} {robot.name}")
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


def _draw(
    axes: Axes, robots: Iterable[Robot], reference: Array, origin: Array | float = 0.0, scale: float = 1.0
) -> None:
    """Draw the reference (frames, 2) and the paths of robots, from an origin (2,), in 1 / `scale` m."""
    axes.plot(*(scale * (reference - origin)).T, color=style.BACKGROUND, lw=4, zorder=1, label="reference")
    for robot in robots:
        travelled, look = scale * (robot["pose"][:, :2] - origin), style.line(robot.slot) | {"marker": ""}
        axes.plot(*travelled.T, zorder=3, label=robot.name, **look)
    axes.set_aspect("equal", adjustable="box")

"""Figures of a run, of each controller's first row: path, output, errors, motor correction factor."""

from collections.abc import Callable, Collection, Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import KDTree

from omni_control.kinematics import Array
from omni_mj.config.settings import FRAME_RATE_HZ
from omni_mj.results.metrics import ALPHA_WINDOW_FRAMES
from omni_mj.viz import style
from omni_mj.viz.figures import plotting
from omni_mj.viz.recorded_robots import ALPHA_RANGE, RecordedRobot

TURNED_DEG = 0.06  # error of heading from which on a robot turns
PAPER_ALPHA = (0.7, 1.0)  # section 2
HALF_WIDTH, MIN_HALF_M = 1.25, 0.005  # of a square, in deviations; at least
COLUMNS = 4  # squares in a row
STEP_M = 0.0005  # of points on the path, to which distances are measured


def draw_paths(robots: Sequence[RecordedRobot], failed: Collection[str], figure: Figure) -> None:
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
        colour, travelled = style.colour(robot.style_index), robot["pose"][:, :2]
        if robot.name in failed:
            overview.plot(
                *travelled[-1],
                "X",
                color=colour,
                ms=8,
                mec="black",
                zorder=6,
                label=f"{robot.name} failed",
            )
        distance = distance_to_path(reference, travelled)
        centre, deviation = travelled[distance.argmax()], float(distance.max())
        half = max(HALF_WIDTH * deviation, MIN_HALF_M)
        axes = figure.add_subplot(grid[1 + i // columns, i % columns])
        _draw(axes, robots, reference, centre, 100)
        limits = (-100 * half, 100 * half)
        axes.set(xlim=limits, ylim=limits, xlabel=f"{100 * deviation:.3g} cm off", title=robot.name)
        axes.spines[:].set(visible=True, color=colour, linewidth=1.5)
        # Squares at one place are around each other, so that none hides another.
        overview.plot(*centre, "s", mfc="none", mec=colour, ms=9 + 3 * i, mew=1.5, zorder=7)
    overview.margins(0.06)
    overview.set(xlabel="x in m", ylabel="y in m")
    plotting.add_legend(figure, [overview])


def draw_output(robots: Sequence[RecordedRobot], failed: Collection[str], figure: Figure) -> None:
    """Draw the velocities commanded by the controllers (figures 8 and 11) and the reference's."""
    poses = max(robots, key=lambda robot: robot.length)["ref"]
    labels = ["velocity in x, m/s", "velocity in y, m/s", "turn rate, rad/s"]
    labels = labels if np.ptp(poses[:, 2]) > 0 else labels[:2]
    reference = np.diff(poses, axis=0, append=poses[-1:]) * FRAME_RATE_HZ
    for axis, axes in enumerate(
        _compare(robots, failed, figure, labels, lambda robot: robot["command"])
    ):
        axes.plot(
            plotting.frame_times(poses),
            reference[:, axis],
            color=style.BACKGROUND,
            lw=3.5,
            zorder=1,
            label="reference",
        )
    plotting.add_legend(figure, figure.axes)


def draw_errors(robots: Sequence[RecordedRobot], failed: Collection[str], figure: Figure) -> None:
    """Draw the absolute errors of position (figures 9 and 12), and of heading if there are any."""
    labels = ["|error| in x, cm", "|error| in y, cm", "|error| of heading, deg"]
    turns = max(np.abs(robot.pose_error()[:, 2]).max() for robot in robots) > TURNED_DEG
    labels = labels if turns else labels[:2]
    for axes in _compare(robots, failed, figure, labels, lambda robot: np.abs(robot.pose_error())):
        axes.set_ylim(bottom=0)
    plotting.add_legend(figure, figure.axes)


def estimators(robots: Sequence[RecordedRobot]) -> list[RecordedRobot]:
    """Return the robots whose controllers estimate alpha."""
    return [
        robot
        for robot in robots
        if any(np.isfinite(robot.alpha(axis)[:, 3]).any() for axis in range(2))
    ]


def draw_alpha(robots: Sequence[RecordedRobot], figure: Figure) -> None:
    """Draw the estimates of alpha, and displacement achieved over commanded where robots drive."""
    grid = plotting.create_time_axes(figure, len(robots), 2, 1.4, sharey=True)
    for (row, axis), axes in np.ndenumerate(grid):
        robot = robots[row]
        ratio, low, high, estimate = robot.alpha(axis).T
        time, colour = plotting.frame_times(ratio), style.colour(robot.style_index)
        label = f"displacement achieved over commanded in {ALPHA_WINDOW_FRAMES} frames"
        axes.axhspan(
            *PAPER_ALPHA, color="#EEEEEE", lw=0, zorder=0, label="the paper's interval, 0.7 to 1"
        )
        axes.plot(time, ratio, color="black", lw=1, zorder=4, label=label)
        axes.plot(
            time,
            estimate,
            color=colour,
            lw=2,
            zorder=3,
            label="estimate, in the controller's colour",
        )
        if np.isfinite(low).any():
            axes.fill_between(
                time, low, high, color=colour, alpha=0.25, lw=0, zorder=1, label="± 2 sigma of it"
            )
        axes.set(title=f"{robot.name}, {'xy'[axis]}", ylabel="" if axis else "alpha")
    grid[0, 0].set_ylim(ALPHA_RANGE)
    plotting.add_legend(figure, grid.flat)


def _compare(
    robots: Sequence[RecordedRobot],
    failed: Collection[str],
    figure: Figure,
    labels: Sequence[str],
    values: Callable[[RecordedRobot], Array],
) -> list[Axes]:
    """Draw values (frames, axes) of all robots, a panel for each label with room for those that did not fail."""
    grid: list[Axes] = list(plotting.create_time_axes(figure, len(labels), 1, 1.8)[:, 0])
    kept = np.concatenate(
        [values(robot) for robot in robots if robot.name not in failed] or [np.zeros((1, 3))]
    )
    for axis, axes in enumerate(grid):
        axes.set_ylabel(labels[axis])
        low, high = kept[:, axis].min(initial=0.0), kept[:, axis].max(initial=1e-9)
        axes.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
        for robot in robots:
            drawn, look = (
                values(robot)[:, axis],
                style.line_style(robot.style_index) | {"marker": ""},
            )
            axes.plot(plotting.frame_times(drawn), drawn, label=robot.name, zorder=3, **look)
    return grid


def distance_to_path(path: Array, points: Array) -> Array:
    """Return the distances of points (m, 2) from a path (n, 2) of straight pieces, (m,) m."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    along = np.linspace(0, arc[-1], 1 + int(arc[-1] / STEP_M))
    distance: Array = KDTree(
        np.column_stack([np.interp(along, arc, part) for part in path.T])
    ).query(points)[0]
    return distance


def _draw(
    axes: Axes,
    robots: Iterable[RecordedRobot],
    reference: Array,
    origin: Array | float = 0.0,
    scale: float = 1.0,
) -> None:
    """Draw the reference (frames, 2) and the paths of robots, from an origin (2,), in 1 / `scale` m."""
    axes.plot(
        *(scale * (reference - origin)).T, color=style.BACKGROUND, lw=4, zorder=1, label="reference"
    )
    for robot in robots:
        travelled, look = (
            scale * (robot["pose"][:, :2] - origin),
            style.line_style(robot.style_index) | {"marker": ""},
        )
        axes.plot(*travelled.T, zorder=3, label=robot.name, **look)
    axes.set_aspect("equal", adjustable="box")

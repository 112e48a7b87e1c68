"""Figures of a run: paths, commands, errors and alpha of the first seed, and statistics of all."""

from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.config import FRAME_RATE_HZ
from omni_mj.io.atomic_files import create_folder
from omni_mj.results.result import Outcome
from omni_mj.results.result_tables import describe_plant
from omni_mj.viz import figure_helpers, style
from omni_mj.viz.displayed_robots import ALPHA_RANGE, RecordedRobot, select_robots
from omni_mj.viz.seed_figure import draw_seed_statistics

MIN_SEEDS = 3  # for a figure of statistics over seeds
TITLES = {
    "error": "Absolute errors in x, y and heading",
    "path": "Paths, and close-ups in cm at each controller's largest position error",
    "command": "Commands exceed the reference's velocity to make up for a gain below 1 and lag",
    "alpha": "Estimates of alpha, and the displacement ratio, which contains gain and lag",
}
MIN_HEADING_ERROR_DEG = 0.06  # largest error below which the heading has no panel
PAPER_ALPHA_RANGE = (0.7, 1.0)  # section 2 of the paper
# Half the width of a close-up: in largest position errors, and at least in cm.
CLOSE_UP_ERRORS, MIN_CLOSE_UP_CM = 1.25, 0.5
CLOSE_UP_COLUMNS = 4
Robots = Sequence[RecordedRobot]


def save_run_figures(outcome: Outcome, folder: Path, svg: bool) -> None:
    """Save each figure for which an outcome has data as a PNG file.

    Args:
        outcome: Outcome of a scenario; without a log nothing is drawn.
        folder: Folder for the files, created if needed.
        svg: Whether to save SVG files as well.
    """
    log = outcome.log
    if log is None or not log.lengths.any():
        return
    create_folder(folder)
    seed = log.seeds[0]
    context = f"{outcome.scenario.name}, {describe_plant(outcome.entry)}, seed {seed}"
    failures = [
        f"{failure.controller} failed at {failure.time_s:.2f} s: {failure.cause}"
        for failure in outcome.failures
        if failure.seed == seed
    ]
    for name, draw in choose_figures(outcome).items():
        title = "\n".join([f"{TITLES[name]}: {context}", *failures]) if name in TITLES else ""
        with figure_helpers.figure_file(folder / name, title, svg) as figure:
            draw(figure)


def choose_figures(outcome: Outcome) -> dict[str, partial[None]]:
    """Return, by file name, a function that draws each figure for which an outcome has data."""
    assert outcome.log
    robots = [robot for robot in select_robots(outcome.log, 1) if robot.length]
    failed_rows = {failure.row for failure in outcome.failures}
    failed = {robot.name for robot in robots if robot.row in failed_rows}
    figures = {
        "error": partial(draw_errors, robots, failed),
        "path": partial(draw_paths, robots, failed),
        "command": partial(draw_commands, robots, failed),
    }
    estimators = [
        robot
        for robot in robots
        if any(np.isfinite(robot.alpha(axis)[:, 3]).any() for axis in range(2))
    ]
    if estimators:
        figures["alpha"] = partial(draw_alpha, estimators)
    if len(outcome.log.seeds) >= MIN_SEEDS:
        name, entry = outcome.scenario.name, outcome.entry
        figures["seeds"] = partial(draw_seed_statistics, name, entry, ())
    return figures


def draw_errors(robots: Robots, failed: Collection[str], figure: Figure) -> None:
    """Draw the absolute errors of position (figures 9 and 12 of the paper), and of heading if any.

    Args:
        robots: One robot per controller.
        failed: Names of the robots that failed.
        figure: Empty figure.
    """
    labels = ["|error| in x, cm", "|error| in y, cm", "|heading error|, °"]
    largest = max(np.abs(robot.pose_error()[:, 2]).max() for robot in robots)
    labels = labels if largest > MIN_HEADING_ERROR_DEG else labels[:2]
    for axes in _draw_columns(
        robots, failed, figure, labels, lambda robot: abs(robot.pose_error())
    ):
        axes.set_ylim(bottom=0)
    figure_helpers.add_legend(figure, figure.axes)


def draw_paths(robots: Robots, failed: Collection[str], figure: Figure) -> None:
    """Draw all paths (figures 7 and 10 of the paper) and, below, a close-up for each controller.

    A close-up is centered on the robot at its largest position error. A ring marks the reference
    of the same frame.

    Args:
        robots: One robot per controller.
        failed: Names of the robots that failed.
        figure: Empty figure.
    """
    reference = max(robots, key=lambda robot: robot.length)["ref"][:, :2]
    columns = min(len(robots), CLOSE_UP_COLUMNS)
    rows = -(-len(robots) // columns)
    figure.set_size_inches(8, 4.4 + 2.5 * rows)
    grid = figure.add_gridspec(1 + rows, columns, height_ratios=[1.7, *[1] * rows])
    overview = figure.add_subplot(grid[0, :])
    _draw_path_lines(overview, robots, reference)
    overview.plot(*reference[0], "o", color="black", ms=6, zorder=6, label="start")
    for i, robot in enumerate(robots):
        color, path = style.color(robot.style_index), robot["pose"][:, :2]
        if robot.name in failed:
            label = f"{robot.name} failed"
            overview.plot(*path[-1], "X", color=color, ms=8, mec="black", zorder=6, label=label)
        errors_cm = robot.position_error()
        frame = int(errors_cm.argmax())
        center = path[frame]
        axes = figure.add_subplot(grid[1 + i // columns, i % columns])
        _draw_path_lines(axes, robots, reference, center, frame)
        ring = 100 * (robot["ref"][frame, :2] - center)
        axes.plot([0, ring[0]], [0, ring[1]], "o-", color="black", mfc=color, lw=1, zorder=5)
        label = "reference at the largest position error"
        axes.plot(*ring, "o", mfc="white", mec="black", mew=1.5, ms=8, zorder=6, label=label)
        half_width_cm = max(CLOSE_UP_ERRORS * errors_cm[frame], MIN_CLOSE_UP_CM)
        limits = (-half_width_cm, half_width_cm)
        label = f"{errors_cm[frame]:.2f} cm position error"
        axes.set(xlim=limits, ylim=limits, xlabel=label, title=robot.name)
        axes.spines[:].set(visible=True, color=color, linewidth=1.5)
        # Squares at the same point have different sizes, so that none hides another.
        overview.plot(*center, "s", mfc="none", mec=color, ms=9 + 3 * i, mew=1.5, zorder=7)
    overview.margins(0.06)
    overview.set(xlabel="x, m", ylabel="y, m")
    figure_helpers.add_legend(figure, figure.axes)


def draw_commands(robots: Robots, failed: Collection[str], figure: Figure) -> None:
    """Draw commanded velocities and the reference's (figures 8 and 11 of the paper).

    Args:
        robots: One robot per controller.
        failed: Names of the robots that failed.
        figure: Empty figure.
    """
    poses = max(robots, key=lambda robot: robot.length)["ref"]
    labels = ["velocity in x, m/s", "velocity in y, m/s", "turn rate, rad/s"]
    labels = labels if np.ptp(poses[:, 2]) > 0 else labels[:2]
    panels = _draw_columns(robots, failed, figure, labels, lambda robot: robot["command"])
    velocity = np.diff(poses, axis=0, append=poses[-1:]) * FRAME_RATE_HZ
    line_style = {"color": style.BACKGROUND, "lw": 3.5, "zorder": 1, "label": "reference"}
    for axis, axes in enumerate(panels):
        figure_helpers.plot_frames(axes, velocity[:, axis], **line_style)
    figure_helpers.add_legend(figure, figure.axes)


def draw_alpha(robots: Robots, figure: Figure) -> None:
    """Draw estimated alpha, and measured alpha where robots drive; a row of axes per robot."""
    grid = figure_helpers.create_time_axes(figure, len(robots), 2, 1.4, sharey=True)
    estimate_label = "estimate, in the controller's color"
    for (row, axis), axes in np.ndenumerate(grid):
        robot = robots[row]
        alpha = robot.alpha(axis)
        measured, low, high, estimate = alpha.T
        color = style.color(robot.style_index)
        paper_label = "range of the paper, 0.7 to 1"
        axes.axhspan(*PAPER_ALPHA_RANGE, color="#EEEEEE", lw=0, zorder=0, label=paper_label)
        measured_label = "displacement ratio, achieved / commanded in 0.25 s (gain and lag)"
        measured_style = {"color": "black", "lw": 1, "zorder": 4, "label": measured_label}
        figure_helpers.plot_frames(axes, measured, **measured_style)
        figure_helpers.plot_frames(axes, estimate, color=color, lw=2, zorder=3)
        if np.isfinite(low).any():
            frames = figure_helpers.choose_frames(low)
            band = frames / FRAME_RATE_HZ, low[frames], high[frames]
            axes.fill_between(*band, color=color, alpha=0.25, lw=0, zorder=1, label="_2 sigma")
            estimate_label = "estimate and ± 2 sigma, in the controller's color"
        title = f"{robot.name}, {'xy'[axis]}"
        if (np.abs(alpha - np.mean(ALPHA_RANGE)) > np.ptp(ALPHA_RANGE) / 2).any():
            title += f"; from {np.nanmin(alpha):.2f} to {np.nanmax(alpha):.2f}"
        axes.set(title=title, ylabel="" if axis else "alpha")
    grid[0, 0].set_ylim(ALPHA_RANGE)
    grid[0, 0].plot([], color="#888888", lw=2, label=estimate_label)  # legend: no robot's color
    figure_helpers.add_legend(figure, grid.flat)


def _draw_columns(
    robots: Robots,
    failed: Collection[str],
    figure: Figure,
    labels: Sequence[str],
    values: Callable[[RecordedRobot], Array],
) -> list[Axes]:
    """Draw the columns of an array over time for all robots, and return the axes.

    The limits of the axes fit the robots that did not fail.

    Args:
        robots: One robot per controller.
        failed: Names of the robots that failed.
        figure: Empty figure.
        labels: Labels of the panels, one per column.
        values: Function of a robot that returns an array (frames, columns).
    """
    panels = list(figure_helpers.create_time_axes(figure, len(labels), 1, 1.8)[:, 0])
    limits = np.zeros((1, 3))  # extremes of the robots that did not fail
    for robot in robots:
        if robot.name not in failed:
            array = values(robot)
            limits = np.concatenate([limits, [array.min(0), array.max(0)]])
    for column, axes in enumerate(panels):
        axes.set_ylabel(labels[column])
        low, high = limits[:, column].min(), limits[:, column].max(initial=1e-9)
        margin = 0.08 * (high - low)
        axes.set_ylim(low - margin, high + margin)
        for robot in robots:
            line = values(robot)[:, column]
            line_style = style.line_style(robot.style_index) | {"marker": ""}
            figure_helpers.plot_frames(axes, line, label=robot.name, zorder=3, **line_style)
    return panels


def _draw_path_lines(
    axes: Axes,
    robots: Iterable[RecordedRobot],
    reference: Array,
    origin: Array | float = 0.0,
    center: int | None = None,
) -> None:
    """Draw the reference path and the paths of robots.

    Of paths of more than `MAX_POINTS` frames, an overview shows frames at equal distances, and a
    close-up those before and after its frame.

    Args:
        axes: Empty axes.
        robots: Robots to draw.
        reference: Positions of the reference, (frames, 2) m.
        origin: Position that becomes the origin of the axes, (2,) m.
        center: Frame of a close-up, whose axes are in cm. Default: an overview in m.
    """
    limit, scale = figure_helpers.MAX_POINTS, 1.0 if center is None else 100.0
    frames = slice(None, None, -(-len(reference) // limit))
    if center is not None:
        frames = slice(max(center - limit // 2, 0), center + limit // 2)
    path = scale * (reference[frames] - origin)
    axes.plot(*path.T, color=style.BACKGROUND, lw=4, zorder=1, label="reference")
    for robot in robots:
        path = scale * (robot["pose"][frames, :2] - origin)
        line_style = style.line_style(robot.style_index) | {"marker": ""}
        axes.plot(*path.T, zorder=3, label=robot.name, **line_style)
    axes.set_aspect("equal", adjustable="box")

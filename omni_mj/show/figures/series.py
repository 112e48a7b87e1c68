"""Figures over time: the controllers' output, the errors, the motor correction factor alpha."""

import numpy as np
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.measure import metrics
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.simulate.log import Trajectory

PAPER_ALPHA = (0.7, 1.0)  # section 2
ESTIMATE = style.CONTROLLERS[5]


def output(trajectory: Trajectory) -> Figure:
    """Velocities commanded by the controllers (figures 8 and 11), over the reference's."""
    poses = trajectory.channel("ref")[:, 0, 0]
    turns = np.ptp(poses[:, 2]) > 0
    reference = np.diff(poses, axis=0, append=poses[-1:]) * FRAME_RATE_HZ
    labels = ["$v_x$ in m/s", "$v_y$ in m/s", r"$\omega$ in rad/s"][: 3 if turns else 2]
    figure = _compare(trajectory, trajectory.channel("command")[:, :, 0], labels, reference)
    figure.suptitle("Velocities commanded")
    return figure


def error(trajectory: Trajectory) -> Figure:
    """Absolute position errors (figures 9 and 12), with the greatest labelled."""
    errors = 100 * metrics.absolute_errors(trajectory)[:, :, 0]
    labels = [f"$|{axis}_r - {axis}|$ in cm" for axis in metrics.AXES]
    figure = _compare(trajectory, errors, labels, None)
    figure.suptitle("Absolute position errors")
    return figure


def alpha(trajectory: Trajectory) -> Figure:
    """Displacement achieved over commanded in windows of 0.25 s, and the controllers' estimate of it."""
    true = _alpha_at_the_end(trajectory)
    estimate = trajectory.channel("alpha_hat")[:, :, 0]
    figure, grid = canvas.over_time(trajectory.length, len(trajectory.controllers), 2, 1.5, "all")
    for i, name in enumerate(trajectory.controllers):
        for j, axes in enumerate(grid[i]):
            axes.axhspan(*PAPER_ALPHA, color="#EEEEEE", lw=0, zorder=0, label="the paper's interval, 0.7 to 1")
            estimates = bool((estimate[:, i, j] != 1).any())
            if estimates:
                axes.plot(*canvas.thin(estimate[:, i, j]), color=ESTIMATE, lw=2.8, label="the controller's estimate")
            axes.plot(*canvas.thin(true[:, i, j]), color="black", lw=1, zorder=3, label="alpha over 15 frames")
            axes.set_title(f"{name}, ${metrics.AXES[j]}$" + ("" if estimates else " (estimates none)"))
        grid[i, 0].set_ylabel("alpha")
    grid[0, 0].set_ylim(*_alpha_limits(true))
    canvas.legend(figure, list(grid.flat))
    figure.suptitle("Motor correction factor alpha")
    return figure


def _alpha_at_the_end(trajectory: Trajectory) -> Array:
    """The alpha of the window that ends in each frame, (frames, controllers, 2); NaN before the first end."""
    position, applied = trajectory.channel("pose")[:, :, 0, :2], trajectory.channel("applied")[:, :, 0, :2]
    alpha = np.full_like(position, np.nan)
    if len(alpha) > metrics.ALPHA_WINDOW_FRAMES:
        alpha[metrics.ALPHA_WINDOW_FRAMES :] = metrics.alpha_windows(position, applied)
    return alpha


def _alpha_limits(alpha: Array) -> tuple[float, float]:
    """Limits that show the paper's interval and nearly all values; where the command turns, alpha is far beyond."""
    known = alpha[~np.isnan(alpha)]
    low, high = np.percentile(known, (5, 95)) if known.size else PAPER_ALPHA
    return max(0.0, min(0.6, low - 0.05)), min(2.0, max(1.1, high + 0.05))


def _compare(trajectory: Trajectory, values: Array, labels: list[str], reference: Array | None) -> Figure:
    """All controllers' values (frames, controllers, axes): together, or when there are many each over the first.

    Without a reference, the values are errors: they start at zero and the greatest is written beside it.
    """
    names = trajectory.controllers
    together = len(names) <= canvas.TOGETHER
    if together:
        figure, grid = canvas.over_time(len(values), len(labels))
    else:
        figure, grid = canvas.over_time(len(values), len(names), len(labels), 1.3, "col")
    for i, name in enumerate(names):
        for j, label in enumerate(labels):
            axes = grid[j, 0] if together else grid[i, j]
            axes.set_ylabel(label)
            if reference is not None and (i == 0 or not together):
                axes.plot(*canvas.thin(reference[:, j]), color=style.BACKGROUND, lw=3.5, zorder=1, label="reference")
            if i and not together:
                axes.plot(*canvas.thin(values[:, 0, j]), color=style.REFERENCE, lw=0.8, label=f"{names[0]}, to compare")
            greatest = f"{values[:, i, j].max():.2f}"
            if not together:
                axes.plot(*canvas.thin(values[:, i, j]), color=style.controller(i), zorder=3)
                axes.set_title(name if reference is not None else f"{name}, at most {greatest} cm")
                continue
            canvas.curve(axes, values[:, i, j], i, name)
            if reference is None:
                canvas.mark_greatest(axes, values[:, i, j], i, greatest)
    if reference is None:
        for j, column in enumerate(grid[:, :1] if together else grid.T[:, :1]):
            column[0].set_ylim(0, 1.15 * max(values[..., j].max(), 1e-9))
    canvas.legend(figure, list(grid.flat))
    return figure

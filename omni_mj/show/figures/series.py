"""Figures over time: the controllers' output, the errors, the motor correction factor alpha."""

from textwrap import wrap

import numpy as np
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.measure import metrics
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.first import FirstRows

PAPER_ALPHA = (0.7, 1.0)  # section 2
ALPHA_AXES = ("x", "y")
BESIDE = canvas.TO_COMPARE | {"ls": (0, (4, 1.5))}  # curves that are solid
SIGMA = "own_alpha_sigma"  # a controller's own, in its estimate
RATIO = f"displacement achieved over commanded in {metrics.ALPHA_WINDOW_FRAMES} frames"
ALPHA_SAID = (
    "An estimate with a band is a gain: what comes of a command that lasts. The ratio of displacements, shown where a"
    " robot is driven, has lag in it: it is lower where a robot gains speed and higher where it brakes. An estimate"
    " without a band is the paper's equation 8, which is that ratio, cut off at 0.5 and 1.1."
)
# Axis of an error -> its label, its unit, and how many of that are 1 m or 1 rad.
ERRORS = {
    "x": ("|error| in x", "cm", 100.0),
    "y": ("|error| in y", "cm", 100.0),
    "heading": ("|error| of heading", "deg", 180 / np.pi),
}


def output(first: FirstRows) -> Figure:
    """Velocities commanded by the controllers (figures 8 and 11), over the reference's."""
    poses = first.reference
    turns = np.ptp(poses[:, 2]) > 0
    reference = np.diff(poses, axis=0, append=poses[-1:]) * FRAME_RATE_HZ
    labels = ["velocity in x, m/s", "velocity in y, m/s", "turn rate, rad/s"][: 3 if turns else 2]
    figure = _compare(first, first.channel("command"), labels, reference)
    figure.suptitle("Velocities commanded")
    return figure


def error(first: FirstRows) -> Figure:
    """Absolute errors of position (figures 9 and 12), and of heading if there are any; above them, the greatest."""
    axes = [axis for axis in ERRORS if axis != "heading" or first.turns]
    errors = np.stack([ERRORS[axis][2] * first.errors(axis) for axis in axes], axis=-1)
    figure = _compare(first, errors, [f"{ERRORS[axis][0]}, {ERRORS[axis][1]}" for axis in axes], None)
    figure.suptitle("Absolute errors")
    return figure


def estimating(first: FirstRows) -> list[int]:
    """Which of the controllers estimate alpha."""
    estimate = np.nan_to_num(first.channel("alpha_hat")[..., :2], nan=1.0)
    return [i for i in range(len(first.names)) if (estimate[:, i] != 1).any()]


def alpha(first: FirstRows) -> Figure:
    """What the controllers that estimate alpha believe, and displacement achieved over commanded where robots drive."""
    shown = estimating(first)
    true, estimate = _driven_alpha(first), first.channel("alpha_hat")
    sigma = first.channel(SIGMA) if SIGMA in first.log.columns else np.full_like(estimate, np.nan)
    figure, grid = canvas.over_time(first.length, len(shown), 2, 1.4, "all")
    for i, line in zip(shown, grid, strict=True):
        slot = first.slots[i]
        for j, axes in enumerate(line):
            axes.axhspan(*PAPER_ALPHA, color="#EEEEEE", lw=0, zorder=0, label="the paper's interval, 0.7 to 1")
            axes.plot(*canvas.thin(true[:, i, j]), color="black", lw=1, zorder=4, label=RATIO)
            axes.plot(*canvas.thin(estimate[:, i, j]), color=style.colour(slot), lw=2, zorder=3)
            low, high = estimate[:, i, j] - 2 * sigma[:, i, j], estimate[:, i, j] + 2 * sigma[:, i, j]
            if not np.isnan(low).all():
                within = {"color": style.colour(slot), "alpha": 0.25, "lw": 0, "zorder": 1}
                axes.fill_between(np.arange(len(low)), low, high, **within)
            axes.set_title(f"{first.names[i]}, {ALPHA_AXES[j]}")
            if i in first.failed:
                canvas.mark_failure(axes, _end(first, i), slot, first.names[i])
        line[0].set_ylabel("alpha")
    # In the legend, of no controller's colour.
    grid[0, 0].plot([], [], color=style.REFERENCE, lw=2, label="estimate")
    if not np.isnan(sigma[:, shown]).all():
        grid[0, 0].fill_between([], [], [], color=style.REFERENCE, alpha=0.4, lw=0, label="± 2 sigma of it")
    grid[0, 0].set_ylim(*_alpha_limits(true[:, shown]))
    canvas.legend(figure, list(grid.flat))
    figure.suptitle("Motor correction factor alpha")
    return figure


def _driven_alpha(first: FirstRows) -> Array:
    """The ratio of the window that ends in each frame, (frames, controllers, 2); NaN where a robot is not driven."""
    position, applied = first.channel("pose")[..., :2], first.channel("applied")[..., :2]
    alpha = np.full_like(position, np.nan)
    if len(alpha) > metrics.ALPHA_WINDOW_FRAMES:
        alpha[metrics.ALPHA_WINDOW_FRAMES :] = metrics.driven_alpha(position, applied)
    return alpha


def _alpha_limits(alpha: Array) -> tuple[float, float]:
    """Limits that show the paper's interval and nearly all values; where the command turns, alpha is far beyond."""
    known = alpha[~np.isnan(alpha)]
    low, high = np.percentile(known, (5, 95)) if known.size else PAPER_ALPHA
    return max(0.0, min(0.6, low - 0.05)), min(2.0, max(1.1, high + 0.05))


def _end(first: FirstRows, controller: int) -> int:
    """The last frame that a controller's row has, or the first where it has none."""
    return max(int(first.log.lengths[first.rows[controller]]) - 1, 0)


def _compare(first: FirstRows, values: Array, labels: list[str], reference: Array | None) -> Figure:
    """All controllers' values (frames, controllers, axes): together, or when there are many each over the first.

    Without a reference, the values are errors: they start at zero and the greatest is written above them.
    """
    names, failed = first.names, list(first.failed)
    together = len(names) <= canvas.TOGETHER
    if together:
        figure, grid = canvas.over_time(len(values), len(labels))
    else:
        figure, grid = canvas.over_time(len(values), len(names), len(labels), 1.0, "col")
    for i, name in enumerate(names):
        for j, label in enumerate(labels):
            axes = grid[j, 0] if together else grid[i, j]
            if together or i == len(names) // 2:
                axes.set_ylabel(label)
            if reference is not None and (i == 0 or not together):
                axes.plot(*canvas.thin(reference[:, j]), color=style.BACKGROUND, lw=3.5, zorder=1, label="reference")
            if i and not together:
                axes.plot(*canvas.thin(values[:, 0, j]), label=f"{names[0]}, to compare", **BESIDE)
            if together:
                canvas.curve(axes, values[:, i, j], i, first.slots[i], name)
            else:
                axes.plot(*canvas.thin(values[:, i, j]), color=style.colour(first.slots[i]), zorder=3)
                own = name if j == 0 else ""
                axes.set_title(own if reference is not None else _said(first, i, own, values[..., j], label))
            if i in failed:
                canvas.mark_failure(axes, _end(first, i), first.slots[i], name)
    for j, axes in enumerate(grid[:, 0] if together else grid[0]):
        shown = values[..., j] if reference is None else np.column_stack([values[..., j], reference[:, j]])
        low, high = canvas.reach(shown, failed)
        room = max(0.08 * (high - low), 1e-9)
        axes.set_ylim(0 if reference is None else low - room, high + room)
        if together and reference is None:
            said = "; ".join(_said(first, i, name, values[..., j], labels[j]) for i, name in enumerate(names))
            axes.set_title("\n".join(wrap(said, round(canvas.SMALL_PER_IN * canvas.WIDTH_IN), break_on_hyphens=False)))
    canvas.legend(figure, list(grid.flat))
    return figure


def _said(first: FirstRows, i: int, name: str, errors: Array, label: str) -> str:
    """A controller's name and the greatest of its errors (frames, controllers), in the unit that ends the label."""
    if i in first.failed:
        return f"{name} failed".strip()
    greatest = float(np.nanmax(errors[:, i], initial=0.0))
    beyond = greatest > canvas.reach(errors, list(first.failed))[1]
    return f"{name} at most {greatest:.2f} {label.split()[-1]}".strip() + ", beyond the scale" * beyond

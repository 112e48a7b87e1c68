"""Figures over time: output, errors, causes of errors, motor correction factor alpha."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.measure import causes, metrics
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.show.figures.first import FirstRows

PAPER_ALPHA = (0.7, 1.0)  # section 2
SIGMA = "own_alpha_sigma"  # channel of a controller's own, standard deviation of its estimate
RATIO = f"displacement achieved over commanded in {metrics.ALPHA_WINDOW_FRAMES} frames"


def draw_output(first: FirstRows, figure: Figure) -> None:
    """Draw the velocities commanded by the controllers (figures 8 and 11) and the reference's."""
    poses = first.reference
    labels = ["velocity in x, m/s", "velocity in y, m/s", "turn rate, rad/s"]
    labels = labels if np.ptp(poses[:, 2]) > 0 else labels[:2]
    reference = np.diff(poses, axis=0, append=poses[-1:]) * FRAME_RATE_HZ
    _compare(first, figure, first.channel("command"), labels, reference)
    figure.suptitle("Velocities commanded")


def draw_errors(first: FirstRows, figure: Figure) -> None:
    """Draw the absolute errors of position (figures 9 and 12), and of heading if there are any."""
    axes = {axis: style.ERROR_AXES[axis] for axis in ("x", "y", "heading") if axis != "heading" or first.turns()}
    errors = np.stack([axis.factor * first.errors(name) for name, axis in axes.items()], axis=-1)
    _compare(first, figure, errors, [f"|error| {axis.phrase}, {axis.unit}" for axis in axes.values()])
    figure.suptitle("Absolute errors")


def draw_causes(first: FirstRows, figure: Figure) -> None:
    """Draw each controller's error in the plane, and below it the frames in which something is at its limit."""
    error = 100 * first.errors("distance")
    grid = canvas.time_axes(figure, len(first.names), 1, 1.15, right=1.5, sharey=True)[:, 0]
    top = max(canvas.visible_range(error, first.failed)[1], 1e-9)
    for i, (axes, name) in enumerate(zip(grid, first.names, strict=True)):
        duty = first.channel("duty_peak")[:, i, 0]
        title = [f"{name} {_describe(first, i, error, 'cm')}"]
        title += [f"mean {mean:.2f} cm" for mean in _mean(error[:, i])]
        title += [f"mean duty {100 * mean:.0f} %" for mean in _mean(duty)]
        axes.plot(canvas.seconds(error), error[:, i], color=style.colour(first.slots[i]))
        axes.set_title(", ".join(title))
        axes.axhline(0, color="#888888", lw=0.8)
        active = causes.of_row(first.log, first.rows[i])
        for line, (cause, frames) in enumerate(active.items(), start=1):
            spans = [(PERIOD_S * frame, PERIOD_S) for frame in np.flatnonzero(frames)]
            y = -0.19 * top * (line - 0.35)
            axes.broken_barh(spans, (y - 0.06 * top, 0.12 * top), color="#333333", lw=0)
            axes.annotate(
                f"{causes.CAUSES[cause]}  {100 * frames.mean():.1f} %", (1, y), (5, 0), fontsize=8, va="center",
                xycoords=("axes fraction", "data"), textcoords="offset points", annotation_clip=False,
            )  # fmt: skip
        axes.set_ylim(-0.19 * top * (len(active) + 0.3), 1.05 * top)
        axes.locator_params(axis="y", nbins=6)
        axes.set_yticks([tick for tick in axes.get_yticks() if 0 <= tick <= 1.05 * top])
        _mark_failure(axes, first, i)
    grid[len(grid) // 2].set_ylabel("error in the plane, cm")
    figure.suptitle("Why: errors, and the frames in which something is at its limit")


def estimators(first: FirstRows) -> list[int]:
    """Return the indices of the controllers that estimate alpha."""
    estimate = np.nan_to_num(first.channel("alpha_hat")[..., :2], nan=1.0)
    return list(np.flatnonzero((estimate != 1).any(axis=(0, 2))))


def draw_alpha(first: FirstRows, figure: Figure) -> None:
    """Draw the estimates of alpha, and displacement achieved over commanded where robots drive."""
    shown = estimators(first)
    estimate, position = first.channel("alpha_hat"), first.channel("pose")[..., :2]
    ratio = np.full_like(position, np.nan)
    if len(ratio) > metrics.ALPHA_WINDOW_FRAMES:
        windows = metrics.driven_alpha(position, first.channel("applied")[..., :2])
        ratio[metrics.ALPHA_WINDOW_FRAMES :] = windows
    sigma = first.channel(SIGMA) if SIGMA in first.log.columns else np.full_like(estimate, np.nan)
    grid = canvas.time_axes(figure, len(shown), 2, 1.4, sharey=True)
    for (row, column), axes in np.ndenumerate(grid):
        i = shown[row]
        colour, time = style.colour(first.slots[i]), canvas.seconds(estimate)
        middle, half = estimate[:, i, column], 2 * sigma[:, i, column]
        axes.axhspan(*PAPER_ALPHA, color="#EEEEEE", lw=0, zorder=0, label="the paper's interval, 0.7 to 1")
        axes.plot(time, ratio[:, i, column], color="black", lw=1, zorder=4, label=RATIO)
        axes.plot(time, middle, color=colour, lw=2, zorder=3, label="estimate, in the controller's colour")
        if not np.isnan(half).all():
            band = (middle - half, middle + half)
            axes.fill_between(time, *band, color=colour, alpha=0.25, lw=0, zorder=1, label="± 2 sigma of it")
        axes.set(title=f"{first.names[i]}, {'xy'[column]}", ylabel="" if column else "alpha")
        _mark_failure(axes, first, i)
    known = ratio[:, shown][~np.isnan(ratio[:, shown])]
    low, high = np.percentile(known, (5, 95)) if known.size else PAPER_ALPHA
    grid[0, 0].set_ylim(max(0.0, min(0.6, low - 0.05)), min(2.0, max(1.1, high + 0.05)))
    canvas.add_legend(figure, grid.flat)
    figure.suptitle("Motor correction factor alpha")


def _compare(
    first: FirstRows, figure: Figure, values: Array, labels: list[str], reference: Array | None = None
) -> None:
    """Draw values (frames, controllers, axes): together, or if there are many each next to the first.

    Without a reference, the values are errors: they start at zero, and titles state the largest.
    """
    names = first.names
    together = len(names) <= canvas.MAX_SHARED_CURVES
    rows, columns = (len(labels), 1) if together else (len(names), len(labels))
    grid = canvas.time_axes(figure, rows, columns, 1.8 if together else 1.0, sharey="none" if together else "col")
    time = canvas.seconds(values)
    for (row, column), axes in np.ndenumerate(grid):
        axis = row if together else column
        shown, controllers = values[..., axis], range(len(names)) if together else [row]
        if reference is not None:
            axes.plot(time, reference[:, axis], color=style.BACKGROUND, lw=3.5, zorder=1, label="reference")
            shown = np.column_stack([shown, reference[:, axis]])
        if not together and row:
            axes.plot(time, values[:, 0, axis], label=f"{names[0]}, to compare", **canvas.COMPARED)
        for i in controllers:
            canvas.plot_curve(axes, values[:, i, axis], i, first.slots[i], names[i])
            _mark_failure(axes, first, i)
        low, high = canvas.visible_range(shown, first.failed)
        room = max(0.08 * (high - low), 1e-9)
        axes.set_ylim(0 if reference is None else low - room, high + room)
        if together or row == rows // 2:
            axes.set_ylabel(labels[axis])
        unit = labels[axis].split()[-1]
        described = [f"{names[i]} " + _describe(first, i, values[..., axis], unit) for i in controllers]
        axes.set_title("; ".join(described) if reference is None else "" if together else names[row])
    canvas.add_legend(figure, grid.flat)


def _describe(first: FirstRows, i: int, errors: Array, unit: str) -> str:
    """Return the largest of a controller's errors (frames, controllers) in words, or that it failed."""
    if i in first.failed:
        return "failed"
    largest = np.nanmax(errors[:, i], initial=0.0)
    beyond = largest > canvas.visible_range(errors, first.failed)[1]
    return f"at most {largest:.2f} {unit}" + ", beyond the scale" * bool(beyond)


def _mean(values: Array) -> list[float]:
    """Return the mean of the values that are numbers, if any is."""
    known = values[~np.isnan(values)]
    return [float(known.mean())] if known.size else []


def _mark_failure(axes: Axes, first: FirstRows, i: int) -> None:
    """Draw a line at the frame in which a controller's row was stopped, if it was."""
    if i in first.failed:
        end, colour = PERIOD_S * max(first.lengths[i] - 1, 0), style.colour(first.slots[i])
        axes.axvline(end, color=colour, lw=1, ls=(0, (1, 1)), zorder=2, label=f"{first.names[i]} failed")

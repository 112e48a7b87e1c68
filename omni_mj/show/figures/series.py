"""Figures over time of each controller's first row: output, errors, causes of errors, motor correction factor alpha."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_control.kinematics import Array
from omni_mj.measure import causes, metrics
from omni_mj.measure.metrics import errors
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.show import style
from omni_mj.show.figures import canvas
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Failure

TURNED_DEG = 0.06  # error of heading from which on a robot turns
PAPER_ALPHA = (0.7, 1.0)  # section 2
SIGMA = "own_alpha_sigma"  # channel of a controller's own, standard deviation of its estimate
RATIO = f"displacement achieved over commanded in {metrics.ALPHA_WINDOW_FRAMES} frames"
CAUSE_SHARE = 0.19  # height of a line of causes, of that of the errors


@dataclass(frozen=True)
class FirstRows:
    """The first row of each controller; arrays hold NaN after the end of a row.

    Args:
        log: Log of the run.
        failures: Rows that were stopped before their end.
    """

    log: Log
    failures: Sequence[Failure] = ()

    @property
    def looks(self) -> dict[str, dict[str, Any]]:
        """Properties of each controller's line, by its name."""
        return {name: style.line(slot) | {"marker": ""} for name, slot in style.slots(self.log.controllers).items()}

    @property
    def rows(self) -> list[int]:
        """Rows of the controllers in the log."""
        return [self.log.first(name) for name in self.log.controllers]

    @property
    def lengths(self) -> np.ndarray:
        """Number of frames of each row, (controllers,)."""
        return np.asarray(self.log.lengths)[self.rows]

    @property
    def reference(self) -> Array:
        """Poses (frames, 3) of the reference of the longest row."""
        return self.channel("ref")[:, self.lengths.argmax()]

    @property
    def failed(self) -> dict[str, Failure]:
        """Failures by their controllers."""
        by_row = {failure.row: failure for failure in self.failures}
        return {name: by_row[row] for name, row in zip(self.log.controllers, self.rows, strict=True) if row in by_row}

    def channel(self, name: str) -> Array:
        """Return a channel of the log, (frames, controllers, columns)."""
        return self.log.channel(name)[: self.lengths.max(), self.rows]

    def errors(self, axis: str) -> Array:
        """Return absolute errors along one of `style.ERROR_AXES` in its unit, (frames, controllers)."""
        return style.ERROR_AXES[axis].factor * errors(self.log)[axis][: self.lengths.max(), self.rows]

    def visible(self, values: Array) -> tuple[float, float]:
        """Return the limits of values (frames, controllers, ...), without those of controllers that failed."""
        kept = [i for i, name in enumerate(self.log.controllers) if name not in self.failed] or slice(None)
        return np.nanmin(values[:, kept], initial=0.0), np.nanmax(values[:, kept], initial=1e-9)


def draw_output(first: FirstRows, figure: Figure) -> None:
    """Draw the velocities commanded by the controllers (figures 8 and 11) and the reference's."""
    poses = first.reference
    labels = ["velocity in x, m/s", "velocity in y, m/s", "turn rate, rad/s"]
    labels = labels if np.ptp(poses[:, 2]) > 0 else labels[:2]
    reference = np.diff(poses, axis=0, append=poses[-1:]) * FRAME_RATE_HZ
    command = first.channel("command")
    for axis, axes in enumerate(_compare(first, figure, command, labels)):
        axes.plot(
            canvas.seconds(poses), reference[:, axis], color=style.BACKGROUND, lw=3.5, zorder=1, label="reference"
        )
        low, high = first.visible(command[..., axis])
        axes.set_ylim(*(np.array([-0.08, 0.08]) * (high - low) + (low, high)))
    canvas.add_legend(figure, figure.axes)
    figure.suptitle("Velocities commanded")


def draw_errors(first: FirstRows, figure: Figure) -> None:
    """Draw the absolute errors of position (figures 9 and 12), and of heading if there are any."""
    shown = [(axis, first.errors(axis)) for axis in ("x", "y", "heading")]
    shown = [(axis, error) for axis, error in shown if axis != "heading" or np.nanmax(error, initial=0) > TURNED_DEG]
    labels = [f"|error| {style.ERROR_AXES[axis].phrase}, {style.ERROR_AXES[axis].unit}" for axis, _ in shown]
    panels = _compare(first, figure, np.stack([error for _, error in shown], axis=-1), labels)
    for axes, (axis, error) in zip(panels, shown, strict=True):
        unit = style.ERROR_AXES[axis].unit
        largest = zip(first.looks, np.nanmax(error, axis=0, initial=0.0), strict=True)
        texts = (f"{name} failed" if name in first.failed else f"{name} {value:.2f}" for name, value in largest)
        axes.set_title(canvas.wrapped(f"largest, {unit}: {', '.join(texts)}", figure))
        axes.set_ylim(0, 1.08 * first.visible(error)[1])
    canvas.add_legend(figure, figure.axes)
    figure.suptitle("Absolute errors")


def draw_causes(first: FirstRows, figure: Figure) -> None:
    """Draw each controller's error in the plane, and below it the frames in which something is at its limit."""
    error = first.errors("distance")
    top = first.visible(error)[1]
    grid = canvas.time_axes(figure, len(first.looks), 1, 1.15, sharey=True)[:, 0]
    for i, (axes, (name, look)) in enumerate(zip(grid, first.looks.items(), strict=True)):
        axes.plot(canvas.seconds(error), error[:, i], color=look["color"])
        known, duty = error[: first.lengths[i], i], first.channel("duty_peak")[: first.lengths[i], i, 0]
        title = f"{name}{' failed' * (name in first.failed)}: largest {known.max():.2f} cm, mean {known.mean():.2f} cm"
        axes.set_title(title + (f", mean duty {np.nanmean(duty):.0%}" if np.isfinite(duty).any() else ""))
        axes.axhline(0, color="#888888", lw=0.8)
        active = causes.of_row(first.log, first.rows[i])
        for line, (cause, frames) in enumerate(active.items(), start=1):
            y = -CAUSE_SHARE * top * (line - 0.35)
            spans = [(PERIOD_S * frame, PERIOD_S) for frame in np.flatnonzero(frames)]
            axes.broken_barh(spans, (y - 0.06 * top, 0.12 * top), color="#333333", lw=0)
            text = f" {causes.CAUSES[cause]}  {frames.mean():.1%}"
            axes.text(1, y, text, fontsize=8, va="center", transform=axes.get_yaxis_transform())
        axes.set_ylim(-CAUSE_SHARE * top * (len(active) + 0.3), 1.05 * top)
        axes.set_yticks([tick for tick in axes.get_yticks() if 0 <= tick <= 1.05 * top])
        _mark_failure(axes, first, name)
    grid[len(grid) // 2].set_ylabel("error in the plane, cm")
    figure.suptitle("Why: errors, and the frames in which something is at its limit")


def estimators(first: FirstRows) -> list[int]:
    """Return the indices of the controllers that estimate alpha."""
    estimate = np.nan_to_num(first.channel("alpha_hat")[..., :2], nan=1.0)
    return list(np.flatnonzero((estimate != 1).any(axis=(0, 2))))


def draw_alpha(first: FirstRows, figure: Figure) -> None:
    """Draw the estimates of alpha, and displacement achieved over commanded where robots drive."""
    shown, window = estimators(first), metrics.ALPHA_WINDOW_FRAMES
    estimate, position = first.channel("alpha_hat"), first.channel("pose")[..., :2]
    ratio = np.full_like(position, np.nan)
    if len(ratio) > window:
        ratio[window:] = metrics.driven_alpha(position, first.channel("applied")[..., :2])
    sigma = first.channel(SIGMA) if SIGMA in first.log.columns else np.full_like(estimate, np.nan)
    grid, time = canvas.time_axes(figure, len(shown), 2, 1.4, sharey=True), canvas.seconds(estimate)
    for (row, column), axes in np.ndenumerate(grid):
        i = shown[row]
        name = first.log.controllers[i]
        middle, half, colour = estimate[:, i, column], 2 * sigma[:, i, column], first.looks[name]["color"]
        axes.axhspan(*PAPER_ALPHA, color="#EEEEEE", lw=0, zorder=0, label="the paper's interval, 0.7 to 1")
        axes.plot(time, ratio[:, i, column], color="black", lw=1, zorder=4, label=RATIO)
        axes.plot(time, middle, color=colour, lw=2, zorder=3, label="estimate, in the controller's colour")
        if np.isfinite(half).any():
            band = (middle - half, middle + half)
            axes.fill_between(time, *band, color=colour, alpha=0.25, lw=0, zorder=1, label="± 2 sigma of it")
        axes.set(title=f"{name}, {'xy'[column]}", ylabel="" if column else "alpha")
        _mark_failure(axes, first, name)
    low, high = np.nanpercentile([*ratio[:, shown].ravel(), *PAPER_ALPHA], (5, 95))
    grid[0, 0].set_ylim(max(0.0, min(0.6, low - 0.05)), min(2.0, max(1.1, high + 0.05)))
    canvas.add_legend(figure, grid.flat)
    figure.suptitle("Motor correction factor alpha")


def _compare(first: FirstRows, figure: Figure, values: Array, labels: Sequence[str]) -> list[Axes]:
    """Draw values (frames, controllers, axes) of all controllers, a panel for each of the labelled axes."""
    grid: list[Axes] = list(canvas.time_axes(figure, len(labels), 1, 1.8)[:, 0])
    for axis, axes in enumerate(grid):
        axes.set_ylabel(labels[axis])
        for i, (name, look) in enumerate(first.looks.items()):
            axes.plot(canvas.seconds(values), values[:, i, axis], label=name, zorder=3, **look)
            _mark_failure(axes, first, name)
    return grid


def _mark_failure(axes: Axes, first: FirstRows, name: str) -> None:
    """Draw a line at the frame in which a controller's row was stopped, if it was."""
    if name in first.failed:
        colour = first.looks[name]["color"]
        label = f"{name} failed"
        axes.axvline(first.failed[name].time_s, color=colour, lw=1, ls=(0, (1, 1)), zorder=2, label=label)

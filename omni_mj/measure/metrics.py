"""What is measured of each row of a log: errors, effort, settling, peaks, and the motor correction factor alpha."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.measure import causes
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.log import Log

if TYPE_CHECKING:
    from omni_mj.simulate.simulation import Failure

AXES = ("x", "y", "distance", "along", "across", "heading")  # distance: in the plane; along and across: the path
UNITS = dict.fromkeys(AXES, "m") | {"heading": "rad"}
PERCENTILE = 99
STATISTICS = ("max", f"p{PERCENTILE}", "mean", "rms")
STILL_M = 1e-6  # from the frame before to the frame after: 30 um/s, at which a reference has no direction
PEAKS = {"peak_voltage_v": "voltage_peak", "peak_current_a": "current_peak", "peak_winding_c": "winding"}
ALPHA_AXES = ("x", "y")
ALPHA_WINDOW_FRAMES = 15  # 0.25 s
ALPHA_MIN_SPEED_M_S = 0.1  # below this mean commanded speed a window's ratio is mostly noise
ALPHA_PERCENTILES = (5, 50, 95)
ALPHA_START_FRAMES = 9  # 0.15 s: the lag of a robot's wheels and their creep, in which it has not answered yet
SETTLED_M = 0.01


def errors(log: Log) -> dict[str, Array]:
    """Absolute difference between the true pose and the timed reference, axis of `AXES` -> (frames, n) m or rad.

    Distance is that in the plane; along is the part of it in the direction of `travel`, across the part to the left of
    that; headings that differ by full turns are equal. Not a number where a row has no frame.
    """
    reference = log.channel("ref")
    difference = log.channel("pose") - reference
    x, y, turn = np.moveaxis(difference, -1, 0)
    cosine, sine = np.moveaxis(travel(reference[..., :2]), -1, 0)
    return {
        "x": np.abs(x),
        "y": np.abs(y),
        "distance": np.hypot(x, y),
        "along": np.abs(cosine * x + sine * y),
        "across": np.abs(cosine * y - sine * x),
        "heading": np.abs(wrap_angle(turn)),
    }


def travel(reference: Array) -> Array:
    """The direction in which timed references travel: from the frame before to the frame after.

    At rest it is the last direction, before the first move that of the first, and x where there is no move at all.

    Args:
        reference: positions (frames, n, 2), m; not a number where a row has no frame.

    Returns:
        Unit vectors (frames, n, 2).
    """
    if not len(reference):
        return np.empty_like(reference)
    before, after = (
        np.concatenate(ends) for ends in ((reference[:1], reference[:-1]), (reference[1:], reference[-1:]))
    )
    step = np.where(np.isnan(after), reference, after) - before
    length = np.hypot(step[..., :1], step[..., 1:])
    moves = length > STILL_M
    along_x = np.broadcast_to((1.0, 0.0), step.shape).copy()
    unit = np.divide(step, length, out=along_x, where=moves)
    last = np.maximum.accumulate(np.where(moves, np.arange(len(step))[:, None, None], -1))
    direction: Array = np.take_along_axis(unit, np.where(last < 0, moves.argmax(0), last), axis=0)
    return direction


def error_statistics(error: Array) -> dict[str, Array]:
    """Maximum, 99th percentile, mean and root mean square over the frames that each row has.

    Args:
        error: (frames, n), not a number where a row has no frame.

    Returns:
        Statistic of `STATISTICS` -> (n,), not a number for a row without any frame.
    """
    known = ~np.isnan(error)
    frames = known.sum(0)
    zeroed = np.where(known, error, 0.0)
    with np.errstate(invalid="ignore"):  # no frames: 0 / 0
        mean, rms = zeroed.sum(0) / frames, np.sqrt((zeroed**2).sum(0) / frames)
    greatest = np.where(frames > 0, zeroed.max(0, initial=0.0), np.nan)
    return dict(zip(STATISTICS, (greatest, _percentile(error, frames > 0), mean, rms), strict=True))


def _percentile(error: Array, rows: np.ndarray) -> Array:
    """Of the `rows` (n,) that have frames, linear between the two nearest; not a number for the others."""
    found = np.full(len(rows), np.nan)
    if rows.any():
        found[rows] = np.nanpercentile(error[:, rows], PERCENTILE, axis=0)
    return found


def control_effort(command: Array) -> Array:
    """Root mean square over the frames of the change of a command per second.

    Args:
        command: velocities sent (frames, ..., axes), m/s; before the first frame it is zero, and not a number where a
            row has no frame.

    Returns:
        (...) m/s^2, of the magnitude over all axes.
    """
    change = np.diff(command, axis=0, prepend=np.zeros_like(command[:1])) / PERIOD_S
    squared = (change**2).sum(-1)
    known = ~np.isnan(squared)
    with np.errstate(invalid="ignore"):  # no frames: 0 / 0
        effort: Array = np.sqrt(np.where(known, squared, 0.0).sum(0) / known.sum(0))
    return effort


def excess_effort(command: Array, reference: Array) -> Array:
    """What `control_effort` is above that of the reference's own velocities, as a root of the squares' difference.

    Squares, since that of a command is the reference's plus that of all that is added to it, as far as the two are
    unrelated. It compares no frame with another, so that it is the same however early a controller sends what the
    reference needs; a difference frame by frame would depend on a dead time and a lag that controllers believe in
    each their own way. Who asks for less than the reference has none.

    Args:
        command: translational velocities sent (frames, n, 2), m/s.
        reference: positions of each row's timed reference (frames, n, 2), m.

    Returns:
        (n,) m/s^2; zero for the reference's own velocities, whenever they are sent.
    """
    after = np.concatenate([reference[1:], reference[-1:]])
    velocity = (np.where(np.isnan(after), reference, after) - reference) / PERIOD_S
    squares = control_effort(command) ** 2 - control_effort(velocity) ** 2
    excess: Array = np.sqrt(np.maximum(squares, 0.0))
    return excess


def settling_times(reference: Array, error: Array) -> Array:
    """Time from the end of the reference's last move until the error in the plane stays below 1 cm to the last frame.

    Args:
        reference: poses of each row's timed reference, (frames, n, 3).
        error: in the plane (frames, n), m; not a number where a row has no frame.

    Returns:
        (n,) s; zero for a robot that is that near from the end of the move on, infinite for one that is not in its last
        frame: it never settles; not a number for one without any frame.
    """
    frames = np.arange(1, len(error) + 1)[:, None]
    length = (~np.isnan(error)).sum(0)
    change = np.diff(reference, axis=0)
    moves = ((change != 0) & ~np.isnan(change)).any(-1)
    rest = np.where(moves, frames[:-1], 0).max(0, initial=0)
    near_from = np.where(error >= SETTLED_M, frames, 0).max(0, initial=0)  # after the last frame that is not near
    times = np.where(near_from < length, np.maximum(near_from - rest, 0) * PERIOD_S, np.inf)
    return np.where(length > 0, times, np.nan)


def row_metrics(log: Log, failures: "Iterable[Failure]" = ()) -> dict[str, Array]:
    """Each row in single numbers, name -> (n,).

    `x_max_m`, `distance_mean_m`, `across_p99_m`, `heading_rms_rad` and the like, `effort_m_s2`, `excess_effort_m_s2`,
    `settle_s`, `greatest_at_s` (when the error in the plane is greatest), the peaks and the shares of `causes`. A row
    that failed has errors, efforts and a time to settle without bound, so that no average gets better by failing; when
    its error was greatest, its peaks and its shares are not comparable: not a number, as for a row without any frame.
    """
    error = errors(log)
    found = {
        f"{axis}_{statistic}_{UNITS[axis]}": values
        for axis in AXES
        for statistic, values in error_statistics(error[axis]).items()
    }
    command, reference = log.channel("command")[..., :2], log.channel("ref")
    found["effort_m_s2"] = control_effort(command)
    found["excess_effort_m_s2"] = excess_effort(command, reference[..., :2])
    found["settle_s"] = settling_times(reference, error["distance"])
    unbounded = set(found)
    at = np.nan_to_num(error["distance"], nan=-1.0)
    found["greatest_at_s"] = at.argmax(0) * PERIOD_S if log.length else np.full(len(log.rows), np.nan)
    found |= {name: _peaks(log.channel(channel)) for name, channel in PEAKS.items()} | causes.row_metrics(log)
    failed = [failure.row for failure in failures]
    for name, values in found.items():
        values[log.lengths == 0] = np.nan
        values[failed] = np.inf if name in unbounded else np.nan
    return found


def _peaks(values: Array) -> Array:
    """The largest of (frames, n, columns) per row; not a number where there is none."""
    known = ~np.isnan(values)
    peak: Array = np.where(known, values, -np.inf).max((0, 2), initial=-np.inf)
    return np.where(known.any((0, 2)), peak, np.nan)


def alpha_windows(position: Array, command: Array) -> Array:
    """Displacement achieved over displacement commanded, in every window of 15 frames.

    Args:
        position: true positions (frames, ..., axes), m.
        command: the commands that acted from each frame to the next, same shape, m/s.

    Returns:
        (frames - 15, ..., axes); not a number where less than 0.1 m/s was commanded on average.
    """
    w = ALPHA_WINDOW_FRAMES
    travelled = np.cumsum(np.concatenate([np.zeros_like(command[:1]), command]), axis=0) * PERIOD_S
    achieved = position[w:] - position[:-w]
    commanded = travelled[w : len(position)] - travelled[: len(position) - w]
    moving = np.abs(commanded) > ALPHA_MIN_SPEED_M_S * w * PERIOD_S
    return np.divide(achieved, commanded, out=np.full_like(achieved, np.nan), where=moving)


def driven_alpha(position: Array, command: Array) -> Array:
    """`alpha_windows` where a robot is driven: not a number near standstill, where what is missing is lag, not gain.

    That is where, in the window or the 0.15 s before it, 0.1 m/s or less was commanded.
    """
    w, before = ALPHA_WINDOW_FRAMES, ALPHA_START_FRAMES
    driven = np.pad(np.abs(command) > ALPHA_MIN_SPEED_M_S, [(before, 0)] + [(0, 0)] * (command.ndim - 1))
    throughout = np.asarray(np.lib.stride_tricks.sliding_window_view(driven, before + w, axis=0).all(-1))
    alpha = alpha_windows(position, command)
    return np.where(throughout[: len(alpha)], alpha, np.nan)


def alpha_percentiles(log: Log, rows: np.ndarray) -> dict[str, dict[str, float | None]] | None:
    """Per axis the percentiles of `alpha_windows` over some rows; None where nothing moved, or for a short log."""
    if log.length <= ALPHA_WINDOW_FRAMES:
        return None
    alpha = alpha_windows(log.channel("pose")[:, rows, :2], log.channel("applied")[:, rows, :2])
    axes: dict[str, dict[str, float | None]] = {}
    for j, axis in enumerate(ALPHA_AXES):
        values = alpha[..., j][~np.isnan(alpha[..., j])]
        axes[axis] = {f"p{p}": float(np.percentile(values, p)) if values.size else None for p in ALPHA_PERCENTILES}
    return axes

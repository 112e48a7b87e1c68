"""What is measured of each row of a log: errors, effort, settling, peaks, and the motor correction factor alpha."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.log import Log

if TYPE_CHECKING:
    from omni_mj.simulate.simulation import Failure

AXES = ("x", "y", "distance", "heading")  # distance: in the plane
UNITS = {"x": "m", "y": "m", "distance": "m", "heading": "rad"}
STATISTICS = ("max", "mean", "rms")
PEAKS = {"peak_voltage_v": "voltage_peak", "peak_current_a": "current_peak", "peak_winding_c": "winding"}
ALPHA_AXES = ("x", "y")
ALPHA_WINDOW_FRAMES = 15  # 0.25 s
ALPHA_MIN_SPEED_M_S = 0.1  # below this mean commanded speed a window's ratio is mostly noise
ALPHA_PERCENTILES = (5, 50, 95)
ALPHA_START_FRAMES = 9  # 0.15 s: the lag of a robot's wheels and their creep, in which it has not answered yet
SETTLED_M = 0.01


def errors(log: Log) -> dict[str, Array]:
    """Absolute difference between the true pose and the timed reference, axis of `AXES` -> (frames, n) m or rad.

    Distance is that in the plane; headings that differ by full turns are equal. Not a number where a row has no frame.
    """
    difference = log.channel("pose") - log.channel("ref")
    x, y = np.abs(difference[..., 0]), np.abs(difference[..., 1])
    return {"x": x, "y": y, "distance": np.hypot(x, y), "heading": np.abs(wrap_angle(difference[..., 2]))}


def error_statistics(error: Array) -> dict[str, Array]:
    """Maximum, mean and root mean square over the frames that each row has.

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
    return {"max": np.where(frames > 0, zeroed.max(0, initial=0.0), np.nan), "mean": mean, "rms": rms}


def control_effort(command: Array) -> Array:
    """Root mean square over the frames of the change of a command per second; smooth driving alone costs some.

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


def settling_times(reference: Array, error: Array) -> Array:
    """Time from the end of the reference's last move until the error in the plane stays below 1 cm to the last frame.

    Args:
        reference: poses of each row's timed reference, (frames, n, 3).
        error: in the plane (frames, n), m; not a number where a row has no frame.

    Returns:
        (n,) s; zero for a robot that is that near from the end of the move on, not a number for one that is not in its
        last frame.
    """
    frames = np.arange(1, len(error) + 1)[:, None]
    length = (~np.isnan(error)).sum(0)
    change = np.diff(reference, axis=0)
    moves = ((change != 0) & ~np.isnan(change)).any(-1)
    rest = np.where(moves, frames[:-1], 0).max(0, initial=0)
    near_from = np.where(error >= SETTLED_M, frames, 0).max(0, initial=0)  # after the last frame that is not near
    return np.where(near_from < length, np.maximum(near_from - rest, 0) * PERIOD_S, np.nan)


def row_metrics(log: Log, failures: "Iterable[Failure]" = ()) -> dict[str, Array]:
    """Each row in single numbers, name -> (n,).

    `x_max_m`, `distance_mean_m`, `heading_rms_rad` and the like, `effort_m_s2`, `settle_s`, `greatest_at_s` (when the
    error in the plane is greatest) and the peaks. A row that failed has errors without bound, so that no average gets
    better by failing; what else it did in its time is not comparable: not a number, as for a row without any frame.
    """
    error = errors(log)
    found = {
        f"{axis}_{statistic}_{UNITS[axis]}": values
        for axis in AXES
        for statistic, values in error_statistics(error[axis]).items()
    }
    names = set(found)
    found["effort_m_s2"] = control_effort(log.channel("command")[..., :2])
    found["settle_s"] = settling_times(log.channel("ref"), error["distance"])
    at = np.nan_to_num(error["distance"], nan=-1.0)
    found["greatest_at_s"] = at.argmax(0) * PERIOD_S if log.length else np.full(len(log.rows), np.nan)
    found |= {name: _peaks(log.channel(channel)) for name, channel in PEAKS.items()}
    failed = [failure.row for failure in failures]
    for name, values in found.items():
        if name not in names:
            values[log.lengths == 0] = np.nan
        values[failed] = np.inf if name in names else np.nan
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

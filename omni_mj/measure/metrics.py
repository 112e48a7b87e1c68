"""What is measured of each row: errors, effort, settling, peaks, causes, recovery; and the motor correction factor."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure import causes, recovery
from omni_mj.measure.errors import UNITS, errors, mean, statistics
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.log import Log

if TYPE_CHECKING:
    from omni_mj.simulate.simulation import Failure

PEAKS = {"peak_voltage_v": "voltage_peak", "peak_current_a": "current_peak", "peak_winding_c": "winding"}
ALPHA_AXES = ("x", "y")
ALPHA_WINDOW_FRAMES = 15  # 0.25 s
ALPHA_MIN_SPEED_M_S = 0.1  # below this mean commanded speed a window's ratio is mostly noise
ALPHA_PERCENTILES = (5, 50, 95)
ALPHA_START_FRAMES = 9  # 0.15 s: the lag of a robot's wheels and their creep, in which it has not answered yet
SETTLED_M = 0.01


def row_metrics(log: Log, failures: "Iterable[Failure]" = ()) -> dict[str, Array]:
    """Each row in single numbers, name -> (n,).

    `x_max_m`, `distance_mean_m`, `across_p99_m`, `heading_rms_rad` and the like, `effort_m_s2`, `excess_effort_m_s2`,
    `settle_s`, the peaks, the shares of `causes` and what `recovery` tells of faults. A row that failed has errors,
    efforts and a time to settle without bound, so that no average gets better by failing; its peaks and its shares are
    not comparable: not a number, as for a row without any frame.
    """
    error, failed = errors(log), [failure.row for failure in failures]
    found = {
        f"{axis}_{statistic}_{UNITS[axis]}": values
        for axis, of_axis in statistics(error, log.lengths).items()
        for statistic, values in of_axis.items()
    }
    reference, distance = log.channel("ref"), error["distance"]
    effort = _effort_square(log.channel("command")[..., :2])
    found["effort_m_s2"] = np.sqrt(effort)
    found["excess_effort_m_s2"] = np.sqrt(np.maximum(effort - _effort_square(_velocity(reference)), 0.0))
    found["settle_s"] = _settling_times(reference, distance, log.lengths)
    unbounded = set(found)
    for name, channel in PEAKS.items():
        found[name] = np.fmax.reduce(log.channel(channel), axis=(0, 2), initial=np.nan)
    found |= causes.shares(log)
    for name, values in found.items():
        values[log.lengths == 0] = np.nan
        values[failed] = np.inf if name in unbounded else np.nan
    return found | recovery.measured(log.rows, distance, failed)


def _effort_square(velocity: Array) -> Array:
    """Return the mean square of the change of velocities (frames, n, 2) per second, (n,); from zero on."""
    change = np.diff(velocity, axis=0, prepend=np.zeros((1, *velocity.shape[1:]))) / PERIOD_S
    return mean((change**2).sum(-1))


def _velocity(reference: Array) -> Array:
    """Return the velocities (frames, n, 2) of timed references, zero in their last frames.

    Excess effort compares the squares of two efforts, and no frame with another: it is the same however early a
    controller sends what the reference needs.
    """
    velocity = np.diff(reference[..., :2], axis=0, append=np.full((1, *reference.shape[1:-1], 2), np.nan)) / PERIOD_S
    ends = np.isnan(velocity) & ~np.isnan(reference[..., :2])
    return np.where(ends, 0.0, velocity)


def _settling_times(reference: Array, distance: Array, lengths: np.ndarray) -> Array:
    """Return the time from the end of the reference's last move until the error in the plane stays below 1 cm, (n,) s.

    Zero for a robot that is that near from the end of the move on, infinite for one that is not in its last frame: it
    never settles.
    """
    step = np.diff(reference, axis=0)
    rest = _frames_until_last((step != 0).any(-1) & ~np.isnan(step[..., 0]))
    near = _frames_until_last(distance >= SETTLED_M)
    return np.where(near < lengths, np.maximum(near - rest, 0) * PERIOD_S, np.inf)


def _frames_until_last(happens: np.ndarray) -> np.ndarray:
    """Return the number of frames up to the last in which it happens (frames, n), (n,)."""
    number = np.arange(1, len(happens) + 1)[:, None]
    return np.asarray(np.max(np.where(happens, number, 0), axis=0, initial=0))


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

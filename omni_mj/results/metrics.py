"""What is measured of each row: errors, effort, settling, peaks, causes, recovery; and the motor correction factor."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config.faults import compute_frame_span
from omni_mj.config.rows import Row
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.results import saturation
from omni_mj.simulation.log import Log

if TYPE_CHECKING:
    from omni_mj.simulation.simulation import Failure

AXES = (
    "x",
    "y",
    "position",
    "along_track",
    "cross_track",
    "heading",
)  # distance: in the plane; along and across: the path
UNITS = dict.fromkeys(AXES, "m") | {"heading": "rad"}
PERCENTILE = 99
STATISTICS = ("max", f"p{PERCENTILE}", "mean", "rms")
# From the frame before to the frame after: 30 um/s, at which a reference has no direction
STILL_M = 1e-6
PEAKS = {
    "peak_voltage_v": "voltage_peak",
    "peak_current_a": "current_peak",
    "peak_winding_temperature_c": "winding",
}
ALPHA_AXES = ("x", "y")
ALPHA_WINDOW_FRAMES = 15  # 0.25 s
# 0.15 s: the lag of a robot's wheels and their creep, in which it has not answered yet
ALPHA_START_FRAMES = 9
ALPHA_MIN_SPEED_M_S = 0.1  # below this mean commanded speed a window's ratio is mostly noise
ALPHA_PERCENTILES = (5, 50, 95)
SETTLED_M = 0.01
RECOVERY_WINDOW_S, RECOVERED_M = (
    2.0,
    0.02,
)  # how long recovery from a fault is watched after it; what counts as recovered
EXCURSION, RECOVERY = "excursion_m", "recovery_s"


def row_metrics(log: Log, failures: "Iterable[Failure]" = ()) -> dict[str, Array]:
    """Each row in single numbers, name -> (n,).

    `x_max_m`, `position_mean_m`, `cross_track_p99_m`, `heading_rms_rad` and the like, `effort_m_s2`,
    `excess_effort_m_s2`, `settle_s`, the peaks, the shares of `causes`, `fault_1_excursion_m` and
    `fault_1_recovery_s`. A row that failed has errors, efforts and a time to settle without bound,
    so that no average gets better by failing; its peaks and its shares are not comparable: not a
    number, as for a row without any frame.
    """
    error, failed = tracking_errors(log), [failure.row for failure in failures]
    found = _statistics(error, log.lengths)
    reference, distance = log.channel("ref"), error["position"]
    effort = _effort_square(log.channel("command")[..., :2])
    found["effort_m_s2"] = np.sqrt(effort)
    found["excess_effort_m_s2"] = np.sqrt(
        np.maximum(effort - _effort_square(_velocity(reference)), 0.0)
    )
    found["settle_s"] = _settling_times(reference, distance, log.lengths)
    unbounded = set(found)
    for name, channel in PEAKS.items():
        found[name] = np.fmax.reduce(log.channel(channel), axis=(0, 2), initial=np.nan)
    found |= saturation.saturation_metrics(log)
    for name, values in found.items():
        values[log.lengths == 0] = np.nan
        values[failed] = np.inf if name in unbounded else np.nan
    return found | _recoveries(log.rows, distance, failed)


def tracking_errors(log: Log) -> dict[str, Array]:
    """Absolute difference between the true pose and the timed reference, axis of `AXES` -> (frames, n) m or rad.

    Distance is that in the plane; along is the part of it in the direction of `travel_direction`, across the
    part to the left of that; headings that differ by full turns are equal. Not a number where a row
    has no frame.
    """
    reference = log.channel("ref")
    x, y, turn = np.moveaxis(log.channel("pose") - reference, -1, 0)
    cosine, sine = np.moveaxis(travel_direction(reference[..., :2]), -1, 0)
    return {
        "x": np.abs(x),
        "y": np.abs(y),
        "position": np.hypot(x, y),
        "along_track": np.abs(cosine * x + sine * y),
        "cross_track": np.abs(cosine * y - sine * x),
        "heading": np.abs(wrap_angle(turn)),
    }


def travel_direction(reference: Array) -> Array:
    """The direction in which timed references travel: from the frame before to the frame after.

    At rest it is the last direction, before the first move that of the first, and x where there is
    no move at all.

    Args:
        reference: positions (frames, n, 2), m; not a number where a row has no frame.

    Returns:
        Unit vectors (frames, n, 2).
    """
    if not len(reference):
        return np.empty_like(reference)
    before = np.concatenate([reference[:1], reference[:-1]])
    after = np.concatenate([reference[1:], reference[-1:]])
    step = np.where(np.isnan(after), reference, after) - before
    length = np.hypot(step[..., :1], step[..., 1:])
    moves = length > STILL_M
    along_x = np.broadcast_to((1.0, 0.0), step.shape).copy()
    unit = np.divide(step, length, out=along_x, where=moves)
    last = np.maximum.accumulate(np.where(moves, np.arange(len(step))[:, None, None], -1))
    direction: Array = np.take_along_axis(unit, np.where(last < 0, moves.argmax(0), last), axis=0)
    return direction


def _statistics(errors_of_rows: Mapping[str, Array], lengths: np.ndarray) -> dict[str, Array]:
    """Return `x_max_m` and so on of errors (frames, n) by axis, (n,); NaN for a row without frames.

    Rows are computed one by one, so that other rows do not change the rounding.
    """
    found = {
        f"{axis}_{name}_{UNITS[axis]}": np.full(len(lengths), np.nan)
        for axis in AXES
        for name in STATISTICS
    }
    for row in np.flatnonzero(lengths):
        error = np.stack([axis[: lengths[row], row] for axis in errors_of_rows.values()])
        p99 = np.percentile(error, PERCENTILE, axis=1)
        numbers = np.stack([error.max(1), p99, error.mean(1), np.sqrt((error**2).mean(1))], axis=1)
        for values, value in zip(found.values(), numbers.ravel(), strict=True):
            values[row] = value
    return found


def _effort_square(velocity: Array) -> Array:
    """Return the mean square of the change of velocities (frames, n, 2) per second, (n,); from zero on."""
    change = np.diff(velocity, axis=0, prepend=np.zeros((1, *velocity.shape[1:]))) / PERIOD_S
    known = [column[~np.isnan(column)] for column in (change**2).sum(-1).T]
    return np.array([column.mean() if column.size else np.nan for column in known])


def _velocity(reference: Array) -> Array:
    """Return the velocities (frames, n, 2) of timed references, zero in their last frames.

    Excess effort compares the squares of two efforts, and no frame with another: it is the same
    however early a controller sends what the reference needs.
    """
    velocity = (
        np.diff(reference[..., :2], axis=0, append=np.full((1, *reference.shape[1:-1], 2), np.nan))
        / PERIOD_S
    )
    ends = np.isnan(velocity) & ~np.isnan(reference[..., :2])
    return np.where(ends, 0.0, velocity)


def _settling_times(reference: Array, distance: Array, lengths: np.ndarray) -> Array:
    """Return the time from the end of the reference's last move until the error in the plane stays below 1 cm, (n,) s.

    Zero for a robot that is that near from the end of the move on, infinite for one that is not in
    its last frame: it never settles.
    """
    step = np.diff(reference, axis=0)
    rest = _frames_until_last((step != 0).any(-1) & ~np.isnan(step[..., 0]))
    near = _frames_until_last(distance >= SETTLED_M)
    return np.where(near < lengths, np.maximum(near - rest, 0) * PERIOD_S, np.inf)


def _frames_until_last(happens: np.ndarray) -> np.ndarray:
    """Return the number of frames up to the last in which it happens (frames, n), (n,)."""
    number = np.arange(1, len(happens) + 1)[:, None]
    return np.asarray(np.max(np.where(happens, number, 0), axis=0, initial=0))


def _recoveries(rows: Sequence[Row], distance: Array, failed: Collection[int]) -> dict[str, Array]:
    """Return how far each row strayed after each fault and how long it took to come back, name -> (n,).

    A fault is looked at from its first frame until 2 s after its last, or the end of the run. Time
    counts from its first frame, not from its end: some last until the end of the run, and a
    controller may well cope with one that goes on. Whatever else happens in that time counts too.
    NaN of a fault that a row does not have or did not come to; of a row that failed the excursion
    is infinite, as its errors are, and so is the time of one that does not recover.

    Args:
        rows: One per robot; their faults are numbered as in their settings.
        distance: Errors in the plane, (frames, n) m; NaN where a row has no frame.
        failed: Numbers of the rows that failed.
    """
    count = max((len(row.settings.fault) for row in rows), default=0)
    found = {
        f"fault_{i + 1}_{key}": np.full(len(rows), np.nan)
        for i in range(count)
        for key in (EXCURSION, RECOVERY)
    }
    for k, row in enumerate(rows):
        for i, fault in enumerate(row.settings.fault, start=1):
            first, end = compute_frame_span(fault)
            stop = min(end + RECOVERY_WINDOW_S * FRAME_RATE_HZ, len(distance))
            error = distance[int(min(first, stop)) : int(stop), k]
            error = error[~np.isnan(error)]
            if not fault.affects(row.slot) or not (error.size or k in failed):
                continue
            excursion, recovery = np.inf, np.inf
            if k not in failed:
                excursion, far = error.max(), np.flatnonzero(error >= RECOVERED_M)
                if not far.size or far[-1] + 1 < error.size:
                    recovery = (far[-1] + 1) * PERIOD_S if far.size else 0.0
            found[f"fault_{i}_{EXCURSION}"][k], found[f"fault_{i}_{RECOVERY}"][k] = (
                excursion,
                recovery,
            )
    return found


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
    """Return `alpha_windows` where a robot is driven, and NaN near standstill, where lag is missing and not gain.

    That is where, in the window or the 0.15 s before it, 0.1 m/s or less was commanded.
    """
    width, before = ALPHA_WINDOW_FRAMES, ALPHA_START_FRAMES
    driven = np.pad(
        np.abs(command) > ALPHA_MIN_SPEED_M_S, [(before, 0)] + [(0, 0)] * (command.ndim - 1)
    )
    throughout = np.asarray(
        np.lib.stride_tricks.sliding_window_view(driven, before + width, axis=0).all(-1)
    )
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
        axes[axis] = {
            f"p{p}": float(np.percentile(values, p)) if values.size else None
            for p in ALPHA_PERCENTILES
        }
    return axes

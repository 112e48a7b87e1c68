"""Metrics of each row: tracking errors, effort, settling time, peaks, recovery from faults."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.rows import Row
from omni_mj.results.saturation import saturation_metrics
from omni_mj.simulation.log import Failure, Log

# Components of the tracking error. "position" is the distance in the plane. "along_track" and
# "cross_track" are its parts along and across the direction of the reference.
AXES = ("x", "y", "position", "along_track", "cross_track", "heading")
UNITS = dict.fromkeys(AXES, "m") | {"heading": "rad"}
PERCENTILE = 99
STATISTICS = ("max", f"p{PERCENTILE}", "mean", "rms")
# The reference rests if its positions in the previous and next frame are at most this far apart.
STANDSTILL_M = 1e-6
PEAKS = {  # metric, the largest value of a robot's motors -> channel of the log
    "peak_voltage_v": "voltage_peak",
    "peak_current_a": "current_peak",
    "peak_winding_temperature_c": "winding",
}
SETTLED_M = 0.01  # position error below which a robot has settled
RECOVERY_WINDOW_S = 2.0  # time after a fault in which its effects are counted
RECOVERED_M = 0.02  # position error below which a robot has recovered from a fault
EXCURSION, RECOVERY = "excursion_m", "recovery_s"  # suffixes of the names of faults' metrics


def row_metrics(log: Log, failures: Sequence[Failure]) -> dict[str, Array]:
    """Return the metrics of each row, name -> shape (n,).

    Names: `x_max_m`, `position_mean_m`, `cross_track_p99_m`, `heading_rms_rad` and so on,
    `effort_m_s2`, `excess_effort_m_s2`, `settle_s`, the keys of `PEAKS` and of
    `saturation_metrics`, `fault_1_excursion_m`, `fault_1_recovery_s` and so on.

    Effort is the root mean square of the commanded acceleration. Excess effort is the root of its
    mean square minus that of the reference's acceleration, at least 0.

    Errors, efforts, settling time and recoveries of a failed row are infinite, so that failing
    improves no average. Its other metrics are NaN, because they are not comparable. All metrics of
    a row without frames are NaN, except for those that are infinite because it failed.

    Args:
        log: The log.
        failures: Failures of rows.
    """
    errors, failed = tracking_errors(log), [failure.row for failure in failures]
    metrics = _error_statistics(errors, log.lengths, log.has_true_poses)
    reference, position_error = log.channel("ref"), errors["position"]
    mean_square = _mean_square_acceleration(log.channel("command")[..., :2])
    metrics["effort_m_s2"] = np.sqrt(mean_square)
    metrics["excess_effort_m_s2"] = np.sqrt(
        np.maximum(mean_square - _mean_square_acceleration(_reference_velocity(reference)), 0.0)
    )
    metrics["settle_s"] = _settling_times(reference, position_error, log.lengths)
    infinite_if_failed = set(metrics)
    for name, channel in PEAKS.items():
        metrics[name] = np.fmax.reduce(log.channel(channel), axis=(0, 2), initial=np.nan)
    metrics |= saturation_metrics(log)
    for name, values in metrics.items():
        values[log.lengths == 0] = np.nan
        values[failed] = np.inf if name in infinite_if_failed else np.nan
    return metrics | _recoveries(log.rows, position_error, failed)


def tracking_errors(log: Log) -> dict[str, Array]:
    """Return the absolute differences between the true pose and the timed reference.

    The heading error is the smallest angle between both headings.

    Returns:
        Axis of `AXES` -> shape (frames, n), m or rad. NaN where a row has no frame, or no
        detection if true poses are unknown.
    """
    reference, difference = log.channel("ref"), log.channel("pose") - log.channel("ref")
    if not log.has_true_poses:
        difference[~log.channel("vision_valid")[..., 0]] = np.nan
    x, y, heading = np.moveaxis(difference, -1, 0)
    cosine, sine = np.moveaxis(_compute_travel_directions(reference[..., :2]), -1, 0)
    return {
        "x": np.abs(x),
        "y": np.abs(y),
        "position": np.hypot(x, y),
        "along_track": np.abs(cosine * x + sine * y),
        "cross_track": np.abs(cosine * y - sine * x),
        "heading": np.abs(wrap_angle(heading)),
    }


def _compute_travel_directions(reference: Array) -> Array:
    """Return the directions in which timed references travel, as unit vectors.

    The direction in a frame is that from the previous to the next frame. While the reference
    rests, its last direction counts; before its first motion, the direction of that motion. If it
    never moves, the direction is x.

    Args:
        reference: Positions, shape (frames, n, 2), m. NaN where a row has no frame.

    Returns:
        Unit vectors, shape (frames, n, 2).
    """
    if not len(reference):
        return np.empty_like(reference)
    previous = np.concatenate([reference[:1], reference[:-1]])
    following = np.concatenate([reference[1:], reference[-1:]])
    step = np.where(np.isnan(following), reference, following) - previous
    length = np.hypot(step[..., :1], step[..., 1:])
    is_moving = length > STANDSTILL_M
    x_axis = np.broadcast_to((1.0, 0.0), step.shape).copy()
    unit = np.divide(step, length, out=x_axis, where=is_moving)
    frames = np.arange(len(step))[:, None, None]
    last_motion = np.maximum.accumulate(np.where(is_moving, frames, -1))
    source_frames = np.where(last_motion < 0, is_moving.argmax(0), last_motion)
    return np.take_along_axis(unit, source_frames, axis=0)


def _error_statistics(
    errors: Mapping[str, Array], lengths: np.ndarray, has_true_poses: bool
) -> dict[str, Array]:
    """Return maximum, percentile, mean and RMS of errors, name -> shape (n,).

    Rows are computed one by one, so that other rows do not change the rounding. A row without
    frames has NaN.

    Args:
        errors: Axis -> shape (frames, n), m or rad.
        lengths: Number of frames of each row, shape (n,).
        has_true_poses: If not, frames without an error do not count.
    """
    names = [f"{axis}_{statistic}_{UNITS[axis]}" for axis in AXES for statistic in STATISTICS]
    metrics = {name: np.full(len(lengths), np.nan) for name in names}
    for row in np.flatnonzero(lengths):
        error = np.stack([errors[axis][: lengths[row], row] for axis in AXES])
        if not has_true_poses:
            error = error[:, ~np.isnan(error[0])]
        if not error.size:
            continue
        percentile = np.percentile(error, PERCENTILE, axis=1)
        rms = np.sqrt((error**2).mean(1))
        statistics = np.stack([error.max(1), percentile, error.mean(1), rms], axis=1)
        for name, value in zip(names, statistics.ravel(), strict=True):
            metrics[name][row] = value
    return metrics


def _mean_square_acceleration(velocity: Array) -> Array:
    """Return the mean square of the acceleration of velocities that start from rest, shape (n,).

    Args:
        velocity: Shape (frames, n, 2), m/s. NaN where a row has no frame.
    """
    zero = np.zeros((1, *velocity.shape[1:]))
    acceleration = np.diff(velocity, axis=0, prepend=zero) / PERIOD_S
    rows = [column[~np.isnan(column)] for column in (acceleration**2).sum(-1).T]
    return np.array([squares.mean() if squares.size else np.nan for squares in rows])


def _reference_velocity(reference: Array) -> Array:
    """Return the velocities of timed references, zero in their last frames.

    They are not shifted by the dead time: excess effort compares mean squares, which do not depend
    on when a controller sends its commands.

    Args:
        reference: Poses, shape (frames, n, 3).

    Returns:
        Velocities, shape (frames, n, 2), m/s.
    """
    end = np.full((1, *reference.shape[1:-1], 2), np.nan)
    velocity = np.diff(reference[..., :2], axis=0, append=end) / PERIOD_S
    is_last = np.isnan(velocity) & ~np.isnan(reference[..., :2])
    return np.where(is_last, 0.0, velocity)


def _settling_times(reference: Array, position_error: Array, lengths: np.ndarray) -> Array:
    """Return the time from the reference's last motion until the position error stays below 1 cm.

    Args:
        reference: Poses, shape (frames, n, 3).
        position_error: Shape (frames, n), m.
        lengths: Number of frames of each row, shape (n,).

    Returns:
        Shape (n,), s. Zero for a robot that is settled when the motion ends; infinite for a robot
            whose last frame is not settled.
    """
    step = np.diff(reference, axis=0)
    motion_end = frames_until_last((step != 0).any(-1) & ~np.isnan(step[..., 0]))
    settling_end = frames_until_last(position_error >= SETTLED_M)
    return np.where(
        settling_end < lengths, np.maximum(settling_end - motion_end, 0) * PERIOD_S, np.inf
    )


def frames_until_last(condition: np.ndarray) -> np.ndarray:
    """Return the number of frames up to and including the last one that meets a condition.

    Args:
        condition: Shape (frames, ...).

    Returns:
        Shape (...). Zero if no frame of a row meets it.
    """
    frame_numbers = np.arange(1, len(condition) + 1)
    return (condition.T * frame_numbers).max(-1, initial=0).T


def _recoveries(
    rows: Sequence[Row], position_error: Array, failed: Collection[int]
) -> dict[str, Array]:
    """Return the excursion and recovery time of each row for each fault, name -> shape (n,).

    A fault counts from its first frame until 2 s after its last, or the end of the run. Recovery
    time starts with its first frame: a controller can recover while the fault lasts, and some
    faults last until the end of the run. Other disturbances in that time are included.

    Values are NaN for a fault that a row does not have or did not reach. They are infinite for a
    failed row. The recovery time is infinite for a row that does not recover.

    Args:
        rows: Rows, with the faults in their settings.
        position_error: Shape (frames, n), m. NaN where a row has no frame.
        failed: Indices of the failed rows.
    """
    n_faults = max((len(row.settings.fault) for row in rows), default=0)
    metrics = {
        f"fault_{i + 1}_{key}": np.full(len(rows), np.nan)
        for i in range(n_faults)
        for key in (EXCURSION, RECOVERY)
    }
    for k, row in enumerate(rows):
        for i, fault in enumerate(row.settings.fault, start=1):
            start, end = fault.frame_span
            stop = min(end + RECOVERY_WINDOW_S * FRAME_RATE_HZ, len(position_error))
            error = position_error[int(start) : int(stop), k]
            error = error[~np.isnan(error)]
            if fault.affects(row.slot) and (error.size or k in failed):
                excursion, recovery = (np.inf, np.inf) if k in failed else _recovery(error)
                metrics[f"fault_{i}_{EXCURSION}"][k] = excursion
                metrics[f"fault_{i}_{RECOVERY}"][k] = recovery
    return metrics


def _recovery(error: Array) -> tuple[float, float]:
    """Return the largest error, m, and the time until the error stays below 2 cm, s.

    Args:
        error: Position error of each frame from the start of the fault, m. At least one frame.
    """
    frames = int(frames_until_last(error >= RECOVERED_M))
    return float(error.max()), frames * PERIOD_S if frames < len(error) else np.inf

"""Metrics of each row: tracking errors, effort, settling time, peaks, recovery from faults."""

from collections.abc import Iterator, Sequence

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.rows import Row
from omni_mj.results.saturation import METRIC_LABELS, saturation_metrics
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
    `saturation.METRIC_LABELS`, `fault_1_excursion_m`, `fault_1_recovery_s` and so on.

    Effort is the root mean square of the commanded acceleration. Excess effort is the root of its
    mean square minus that of the reference's acceleration, at least 0.

    Errors, efforts, settling time and recoveries of a failed row are infinite, so that failing
    improves no average. Its other metrics are NaN, because they are not comparable. All metrics of
    a row without frames are NaN, except for those that are infinite because it failed.

    Rows are computed one by one. This limits the memory, and other rows do not change the rounding.

    Args:
        log: The log.
        failures: Failures of rows.
    """
    failed = {failure.row for failure in failures}
    names = [f"{axis}_{statistic}_{UNITS[axis]}" for axis in AXES for statistic in STATISTICS]
    infinite_if_failed = [*names, "effort_m_s2", "excess_effort_m_s2", "settle_s"]
    names = [*infinite_if_failed, *PEAKS, *METRIC_LABELS]
    n_faults = max((len(row.settings.fault) for row in log.rows), default=0)
    names += [f"fault_{i + 1}_{key}" for i in range(n_faults) for key in (EXCURSION, RECOVERY)]
    metrics = {name: np.full(len(log.rows), np.nan) for name in names}
    for row, source in enumerate(log.rows):
        if row in failed:
            values = dict.fromkeys(infinite_if_failed, np.inf)
            position_error = np.empty(0)
        elif log.lengths[row]:
            values, position_error = _measure_row(log, row)
        else:
            continue
        values |= _recoveries(source, position_error, row in failed)
        for name, value in values.items():
            metrics[name][row] = value
    return metrics


def _measure_row(log: Log, row: int) -> tuple[dict[str, float], Array]:
    """Return the metrics of a row without its recoveries, and its position errors."""
    metrics: dict[str, float] = {}
    position_error = np.empty(0)
    for axis, error in tracking_errors(log, row):
        if axis == "position":
            position_error = error
        statistics = _error_statistics(error if log.has_true_poses else error[~np.isnan(error)])
        for statistic, value in zip(STATISTICS, statistics, strict=True):
            metrics[f"{axis}_{statistic}_{UNITS[axis]}"] = value
    mean_square = _mean_square_acceleration(log.channel_of_row("command", row)[:, :2])
    reference = log.channel_of_row("ref", row)
    # Zero in the last frame, and not shifted by the dead time: excess effort compares mean squares,
    # which do not depend on when a controller sends its commands.
    reference_velocity = np.diff(reference[:, :2], axis=0, append=reference[-1:, :2]) / PERIOD_S
    excess = mean_square - _mean_square_acceleration(reference_velocity)
    metrics["effort_m_s2"] = np.sqrt(mean_square)
    metrics["excess_effort_m_s2"] = np.sqrt(max(excess, 0.0))
    metrics["settle_s"] = _settling_time(reference, position_error)
    for name, channel in PEAKS.items():
        metrics[name] = np.fmax.reduce(log.channel_of_row(channel, row), axis=None)
    return metrics | saturation_metrics(log, row), position_error


def tracking_errors(log: Log, row: int) -> Iterator[tuple[str, Array]]:
    """Yield the absolute differences between the true pose of a row and the timed reference.

    The heading error is the smallest angle between both headings.

    Yields:
        Axis of `AXES`, and the errors, shape (frames,), m or rad. NaN where a row has no detection
        if true poses are unknown.
    """
    reference = log.channel_of_row("ref", row)
    difference = log.channel_of_row("pose", row)
    difference -= reference
    if not log.has_true_poses:
        difference[~log.channel_of_row("vision_valid", row)[:, 0]] = np.nan
    x, y, heading = difference.T
    yield "x", np.abs(x)
    yield "y", np.abs(y)
    yield "position", np.hypot(x, y)
    yield "heading", np.abs(wrap_angle(heading))
    cosine, sine = _compute_travel_directions(reference[:, :2]).T
    yield "along_track", np.abs(cosine * x + sine * y)
    yield "cross_track", np.abs(cosine * y - sine * x)


def _compute_travel_directions(reference: Array) -> Array:
    """Return the directions in which a timed reference travels, as unit vectors.

    The direction in a frame is that from the previous to the next frame. While the reference
    rests, its last direction counts; before its first motion, the direction of that motion. If it
    never moves, the direction is x.

    Args:
        reference: Positions, shape (frames, 2), m. At least one frame.

    Returns:
        Unit vectors, shape (frames, 2).
    """
    step = np.concatenate([reference[1:], reference[-1:]])
    step -= np.concatenate([reference[:1], reference[:-1]])
    length = np.hypot(*step.T)
    moving_frames = np.flatnonzero(length > STANDSTILL_M)
    if not moving_frames.size:
        return np.tile([1.0, 0.0], (len(step), 1))
    last_motion = np.searchsorted(moving_frames, np.arange(len(step)), side="right") - 1
    source_frames = moving_frames[np.maximum(last_motion, 0)]
    return step[source_frames] / length[source_frames, None]


def _error_statistics(error: Array) -> Sequence[float]:
    """Return maximum, percentile, mean and RMS of errors, shape (n,); NaN if there are none."""
    if not error.size:
        return [np.nan] * len(STATISTICS)
    return error.max(), np.percentile(error, PERCENTILE), error.mean(), np.sqrt((error**2).mean())


def _mean_square_acceleration(velocity: Array) -> float:
    """Return the mean square of the acceleration of velocities that start from rest.

    Args:
        velocity: Shape (frames, 2), m/s.
    """
    acceleration = np.diff(velocity, axis=0, prepend=np.zeros((1, 2))) / PERIOD_S
    return (acceleration**2).sum(-1).mean()


def _settling_time(reference: Array, position_error: Array) -> float:
    """Return the time from the reference's last motion until the position error stays below 1 cm.

    Args:
        reference: Poses, shape (frames, 3).
        position_error: Shape (frames,), m.

    Returns:
        Seconds; zero for a robot that is settled when the motion ends; infinite for one that is not
        settled in its last frame.
    """
    motion_end = frames_until_last((np.diff(reference, axis=0) != 0).any(-1))
    settling_end = frames_until_last(position_error >= SETTLED_M)
    if settling_end == len(position_error):
        return np.inf
    return max(settling_end - motion_end, 0) * PERIOD_S


def frames_until_last(condition: np.ndarray) -> int:
    """Return the number of frames up to and including the last one that meets a condition.

    Args:
        condition: Shape (frames,).

    Returns:
        The number; zero if no frame meets the condition.
    """
    frames = np.flatnonzero(condition)
    return int(frames[-1]) + 1 if frames.size else 0


def _recoveries(row: Row, position_error: Array, has_failed: bool) -> dict[str, float]:
    """Return the excursion and recovery time of a row for each fault that it has and reached.

    A fault counts from its first frame until 2 s after its last, or the end of the run. Recovery
    time starts with its first frame: a controller can recover while the fault lasts, and some
    faults last until the end of the run. Other disturbances in that time are included.

    Both are infinite for a failed row. The recovery time is infinite for a row that does not
    recover.

    Args:
        row: The row, with the faults in its settings.
        position_error: Shape (frames,), m.
        has_failed: Whether the row failed.
    """
    metrics: dict[str, float] = {}
    for i, fault in enumerate(row.settings.fault, start=1):
        start, end = fault.frame_span
        stop = min(end + RECOVERY_WINDOW_S * FRAME_RATE_HZ, len(position_error))
        error = position_error[int(start) : int(stop)]
        error = error[~np.isnan(error)]
        if fault.affects(row.slot) and (error.size or has_failed):
            excursion, recovery = (np.inf, np.inf) if has_failed else _recovery(error)
            metrics |= {f"fault_{i}_{EXCURSION}": excursion, f"fault_{i}_{RECOVERY}": recovery}
    return metrics


def _recovery(error: Array) -> tuple[float, float]:
    """Return the largest error, m, and the time until the error stays below 2 cm, s.

    Args:
        error: Position error of each frame from the start of the fault, m. At least one frame.
    """
    frames = frames_until_last(error >= RECOVERED_M)
    return float(error.max()), frames * PERIOD_S if frames < len(error) else np.inf

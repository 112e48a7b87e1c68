"""By how much robots miss their timed references, frame by frame and as statistics of each row."""

from collections.abc import Mapping

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.simulate.log import Log

AXES = ("x", "y", "distance", "along", "across", "heading")  # distance: in the plane; along and across: the path
UNITS = dict.fromkeys(AXES, "m") | {"heading": "rad"}
PERCENTILE = 99
STATISTICS = ("max", f"p{PERCENTILE}", "mean", "rms")
STILL_M = 1e-6  # from the frame before to the frame after: 30 um/s, at which a reference has no direction


def errors(log: Log) -> dict[str, Array]:
    """Absolute difference between the true pose and the timed reference, axis of `AXES` -> (frames, n) m or rad.

    Distance is that in the plane; along is the part of it in the direction of `travel`, across the part to the left of
    that; headings that differ by full turns are equal. Not a number where a row has no frame.
    """
    reference = log.channel("ref")
    x, y, turn = np.moveaxis(log.channel("pose") - reference, -1, 0)
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


def statistics(errors_of_rows: Mapping[str, Array], lengths: np.ndarray) -> dict[str, dict[str, Array]]:
    """Return each statistic of `STATISTICS` of errors, axis -> statistic -> (n,); NaN for a row without frames.

    Rows are computed one by one, so that other rows do not change the rounding.

    Args:
        errors_of_rows: Axis -> (frames, n).
        lengths: Frames of the rows, (n,).
    """
    values = np.full((len(errors_of_rows), len(STATISTICS), len(lengths)), np.nan)
    for row in np.flatnonzero(lengths):
        error = np.stack([axis[: lengths[row], row] for axis in errors_of_rows.values()])
        values[..., row] = np.stack([
            error.max(1), np.percentile(error, PERCENTILE, axis=1), error.mean(1), np.sqrt((error**2).mean(1)),
        ], axis=1)  # fmt: skip
    return {
        axis: dict(zip(STATISTICS, of_axis, strict=True)) for axis, of_axis in zip(errors_of_rows, values, strict=True)
    }


def mean(values: Array) -> Array:
    """Return the mean of the known values (frames, n) of each row, (n,); NaN if none is known."""
    known = [column[~np.isnan(column)] for column in values.T]
    return np.array([column.mean() if column.size else np.nan for column in known])

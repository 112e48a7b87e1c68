"""By how much robots miss their timed references, frame by frame and as statistics of each row."""

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


def statistics(error: Array) -> dict[str, Array]:
    """Return each statistic of `STATISTICS` of errors (frames, n), (n,); NaN for a row without frames.

    The percentile is linear between the two nearest values.
    """
    count = (~np.isnan(error)).sum(0)
    ordered = np.sort(error, axis=0)  # NaN last
    position = PERCENTILE / 100 * (count - 1)
    below = np.floor(position).astype(int)
    low, high = (_ranked(ordered, np.clip(rank, 0, np.maximum(count - 1, 0))) for rank in (below, below + 1))
    values = (
        _ranked(ordered, np.maximum(count - 1, 0)),
        low + (position - below) * (high - low),
        mean(error),
        np.sqrt(mean(error**2)),
    )
    return dict(zip(STATISTICS, values, strict=True))


def mean(values: Array) -> Array:
    """Return the mean of the known values (frames, ...) over the frames, (...); NaN where none is known.

    Sums are made frame by frame: another order, which numpy may choose by the number of rows, would round otherwise.
    """
    known = ~np.isnan(values)
    total = np.cumsum(np.where(known, values, 0.0), axis=0)[-1:].sum(0)
    with np.errstate(invalid="ignore"):  # 0 / 0
        result: Array = total / known.sum(0)
    return result


def _ranked(ordered: Array, rank: np.ndarray) -> Array:
    """Return the value of a rank (n,) in each column of ordered values (frames, n)."""
    if not len(ordered):
        return np.full(len(rank), np.nan)
    chosen: Array = np.take_along_axis(ordered, rank[None], axis=0)[0]
    return chosen

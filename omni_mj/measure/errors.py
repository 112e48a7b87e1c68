"""By how much robots miss their timed references."""

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.measure.way import travel
from omni_mj.simulate.log import Log

AXES = ("x", "y", "distance", "along", "across", "heading")  # distance: in the plane; along and across: the path
UNITS = dict.fromkeys(AXES, "m") | {"heading": "rad"}


def errors(log: Log, direction: Array | None = None) -> dict[str, Array]:
    """Absolute difference between the true pose and the timed reference, axis of `AXES` -> (frames, n) m or rad.

    Distance is that in the plane; along is the part of it in the direction of `travel`, across the part to the left of
    that; headings that differ by full turns are equal. Not a number where a row has no frame.

    Args:
        log: what was recorded, or a part of it.
        direction: in which references travel, (frames, n, 2). [as the log has them, from its start to its end]
    """
    reference = log.channel("ref")
    difference = log.channel("pose") - reference
    x, y, turn = np.moveaxis(difference, -1, 0)
    cosine, sine = np.moveaxis(travel(reference[..., :2]) if direction is None else direction, -1, 0)
    return {
        "x": np.abs(x),
        "y": np.abs(y),
        "distance": np.hypot(x, y),
        "along": np.abs(cosine * x + sine * y),
        "across": np.abs(cosine * y - sine * x),
        "heading": np.abs(wrap_angle(turn)),
    }

"""The limits of a motion, and the one rule by which a reference moves within them (section 3-A).

`approach` moves a point towards a set-point as fast as the limits let it and stops it there exactly, in whole frames.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array


@dataclass(frozen=True)
class MotionLimits:
    """Limits of a reference or of commands: m/s and m/s^2 along the path, rad/s and rad/s^2 in heading.

    The defaults are those of the paper's reference (section 2), with a turn rate and acceleration to match.
    """

    speed: float = 3.159
    acceleration: float = 0.826
    turn_rate: float = 6.0
    turn_acceleration: float = 12.0

    def __post_init__(self) -> None:
        """Check the limits.

        Raises:
            OmniError: a limit is not a positive number.
        """
        for name, value in vars(self).items():
            if not 0 < value < np.inf:
                raise OmniError(f"the limit of {name.replace('_', ' ')} must be a positive number, not {value}")


def stopping_speed(distance: Array, acceleration: float, period: float) -> Array:
    """Highest speed (m/s) from which `distance` (m, >= 0) is covered exactly while braking at most at `acceleration`.

    A point that moves s, s - 1, s - 2, ... units of a T^2 in successive frames of length T covers m (m + 1) / 2 in m
    frames; between these distances the speed is linear, which makes it fall by exactly one unit each frame
    but the last.
    """
    unit = acceleration * period**2
    d = np.asarray(distance, float) / unit
    m = np.floor(np.sqrt(0.25 + 2 * d) - 0.5)
    return (m + (d - m * (m + 1) / 2) / (m + 1)) * unit / period


def approach(offset: Array, velocity: Array, speed: float, acceleration: float, period: float) -> Array:
    """Velocity for the next frame of a point that shall stop at a set-point.

    Args:
        offset: set-point minus position, (n, d) m.
        velocity: velocity of the last frame, (n, d) m/s.
        speed: highest speed, m/s.
        acceleration: highest change of velocity per second, m/s^2.
        period: length of a frame, s.

    Returns:
        (n, d) m/s: no faster than `speed`, changed by at most `acceleration * period`. That is shared between braking
        what leads past the set-point and the speed towards it, whose gain counts for no more than one frame's.
    """
    step = acceleration * period
    distance = _size(offset)
    direction = np.divide(offset, distance, out=np.zeros_like(offset), where=distance > 0)
    along = (velocity * direction).sum(-1, keepdims=True)
    across = velocity - along * direction
    wanted = np.minimum(speed, stopping_speed(distance, acceleration, period))
    change = np.minimum(wanted - along, step) * direction - across
    return velocity + change * (step / np.maximum(_size(change), step))


def approach_pose(pose: Array, twist: Array, target: Array, limits: MotionLimits, period: float) -> Array:
    """`approach` for position and heading of (n, 3) poses, each within its own limits; headings count full turns."""
    offset = target - pose
    xy = approach(offset[:, :2], twist[:, :2], limits.speed, limits.acceleration, period)
    turn = approach(offset[:, 2:], twist[:, 2:], limits.turn_rate, limits.turn_acceleration, period)
    return np.concatenate([xy, turn], axis=1)


def checked_waypoints(waypoints: Sequence[Sequence[float]]) -> Array:
    """Way-points as an array (points, 3).

    Raises:
        OmniError: there are none, or one is not three finite numbers.
    """
    if not len(waypoints) or any(len(point) != 3 for point in waypoints) or not np.isfinite(waypoints).all():
        raise OmniError("a reference needs at least one way-point, each three finite numbers [x, y, heading]")
    return np.array(waypoints, float)


def _size(vector: Array) -> Array:
    return np.sqrt((vector**2).sum(-1, keepdims=True))

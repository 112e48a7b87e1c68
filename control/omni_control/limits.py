"""What the team's computer may command: speed and acceleration limits on the way to the radio."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from omni_control.kinematics import FEW, Array
from omni_control.reference.limits import MotionLimits


class CommandLimits:
    """Limits velocity commands and their change per frame, translation by its norm and rotation by itself.

    Args:
        limits: those of each of n robots.
        period: length of a frame T, s.
    """

    def __init__(self, limits: Sequence[MotionLimits], period: float) -> None:
        speed, acceleration, turn_rate, turn_acceleration = np.array(
            [[s.speed, s.acceleration * period, s.turn_rate, s.turn_acceleration * period] for s in limits]
        ).T[..., None]
        self._highest, self._step = (speed, turn_rate), (acceleration, turn_acceleration)  # (n, 1) each
        self._each = np.concatenate([speed, turn_rate, acceleration, turn_acceleration], axis=1).tolist()

    def __call__(self, command: Array, last: Array) -> Array:
        """Return the commands (n, 3) that may be sent, given those wanted and those sent in the frame before."""
        if len(command) <= FEW:
            each = zip(command.tolist(), last.tolist(), self._each, strict=True)
            return np.array([_limited(wanted, sent, *limits) for wanted, sent, limits in each])
        with np.errstate(over="ignore"):  # one that is too large to be squared stops the robot
            allowed = _clip(command, *self._highest)
        return last + _clip(allowed - last, *self._step)


def _clip(vector: Array, translation: Array, rotation: Array) -> Array:
    squares, clipped = vector[:, :2] ** 2, np.empty_like(vector)
    size = np.sqrt(squares[:, :1] + squares[:, 1:])
    scale = np.minimum(translation / np.maximum(size, 1e-300), 1.0)
    np.multiply(vector[:, :2], scale, out=clipped[:, :2])
    np.minimum(np.maximum(vector[:, 2:], -rotation), rotation, out=clipped[:, 2:])
    return clipped


def _limited(
    wanted: list[float], last: list[float], speed: float, turn_rate: float, change: float, turn_change: float
) -> list[float]:
    """What may be sent to one robot, to the same bits."""
    allowed = _clipped(wanted, speed, turn_rate)
    changes = [now - before for now, before in zip(allowed, last, strict=True)]
    return [before + more for before, more in zip(last, _clipped(changes, change, turn_change), strict=True)]


def _clipped(vector: list[float], translation: float, rotation: float) -> list[float]:
    """As `_clip`, of one robot."""
    x, y, turn = vector
    scale = min(translation / max(math.sqrt(x * x + y * y), 1e-300), 1.0)
    return [x * scale, y * scale, min(max(turn, -rotation), rotation)]


def within_rate(wanted: Array, step: float) -> Array:
    """The middle one of successive commands, changed so that none need change by more than `step` from one to the next.

    Of all sequences that keep to the step, the one that stays nearest to those wanted (least largest difference) is
    the mean of the highest below and the lowest above them (E. J. McShane, Bull. Amer. Math. Soc. 40, 1934, for
    functions of bounded slope). It is the same where they keep to it, and leads symmetrically over a jump.

    Args:
        wanted: commands of an odd number of frames, (frames, ...), the middle one being that of now.
        step: largest change of a component per frame.

    Returns:
        (...), the component-wise nearest.
    """
    reach = _reach(len(wanted), step, wanted.ndim - 1)
    return (np.minimum.reduce(wanted + reach) + np.maximum.reduce(wanted - reach)) / 2


@lru_cache
def _reach(frames: int, step: float, dimensions: int) -> Array:
    """How far commands may be from the middle one of so many, (frames, 1, ...)."""
    reach = step * np.abs(np.arange(frames) - frames // 2).reshape(-1, *[1] * dimensions)
    reach.flags.writeable = False
    return reach

"""What the team's computer may command: speed and acceleration limits on the way to the radio."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from omni_control.kinematics import FEW, Array
from omni_control.reference.limits import MotionLimits


class CommandLimits:
    """Limits velocity commands and their change per frame, translation by its norm and rotation by itself.

    Args:
        limits: those of each of n robots.
        period: length of a frame T, s.
        compiled: see `Told`.
    """

    def __init__(
        self,
        limits: Sequence[MotionLimits],
        period: float,
        compiled: Callable[[Callable[..., Any]], Callable[..., Any]] | None = None,
    ) -> None:
        self._each = np.array(
            [[s.speed, s.turn_rate, s.acceleration * period, s.turn_acceleration * period] for s in limits]
        )
        self._few = self._each.tolist()
        speed, turn_rate, acceleration, turn_acceleration = self._each.T[..., None]
        self._highest, self._step = (speed, turn_rate), (acceleration, turn_acceleration)  # (n, 1) each
        self._loop = None if compiled is None else compiled(_limit)

    def __call__(self, command: Array, last: Array) -> Array:
        """Return the commands (n, 3) that may be sent, given those wanted and those sent in the frame before."""
        if self._loop is not None:
            sent = np.empty_like(command)
            self._loop(command, last, self._each, sent)
            return sent
        if len(command) <= FEW:
            each = zip(command.tolist(), last.tolist(), self._few, strict=True)
            return np.array([_limited(wanted, sent, limits) for wanted, sent, limits in each])
        with np.errstate(over="ignore"):  # one that is too large to be squared stops the robot
            allowed = _clip(command, *self._highest)
        return last + _clip(allowed - last, *self._step)


def _limit(command: Array, last: Array, limits: Array, sent: Array) -> None:
    """As `CommandLimits`, robot by robot, for a compiler; what may be sent is written."""
    for i in range(len(command)):
        wanted, before = (command[i, 0], command[i, 1], command[i, 2]), (last[i, 0], last[i, 1], last[i, 2])
        each = limits[i, 0], limits[i, 1], limits[i, 2], limits[i, 3]
        sent[i, 0], sent[i, 1], sent[i, 2] = _limited(wanted, before, each)


def _clip(vector: Array, translation: Array, rotation: Array) -> Array:
    squares, clipped = vector[:, :2] ** 2, np.empty_like(vector)
    size = np.sqrt(squares[:, :1] + squares[:, 1:])
    scale = np.minimum(translation / np.maximum(size, 1e-300), 1.0)
    np.multiply(vector[:, :2], scale, out=clipped[:, :2])
    np.minimum(np.maximum(vector[:, 2:], -rotation), rotation, out=clipped[:, 2:])
    return clipped


def _limited(wanted: Sequence[float], last: Sequence[float], limits: Sequence[float]) -> tuple[float, float, float]:
    """What may be sent to one robot, to the same bits."""
    (wanted_x, wanted_y, wanted_turn), (last_x, last_y, last_turn) = wanted, last
    speed, turn_rate, change, turn_change = limits
    x, y, turn = _clipped(wanted_x, wanted_y, wanted_turn, speed, turn_rate)
    x, y, turn = _clipped(x - last_x, y - last_y, turn - last_turn, change, turn_change)
    return last_x + x, last_y + y, last_turn + turn


def _clipped(x: float, y: float, turn: float, translation: float, rotation: float) -> tuple[float, float, float]:
    """As `_clip`, of one robot."""
    scale = min(translation / max(math.sqrt(x * x + y * y), 1e-300), 1.0)
    return x * scale, y * scale, min(max(turn, -rotation), rotation)

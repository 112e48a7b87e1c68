"""The ways along which tests of controllers drive, and what the controllers are told."""

import numpy as np
from closed_loop import T

from omni_control import IteratedReference, MotionLimits, TimedReference, Told
from omni_control.kinematics import Array
from omni_control.reference import Reference

PATH = np.array([[0.0, 0.0, 0.0], [0.8, 0.3, 1.0], [0.2, 0.6, -0.5]])
STRAIGHT = [[0, 0, 0], [20, 0, 0]]
LIMITS = MotionLimits()
REST = TimedReference([[0, 0, 0]], LIMITS, T)
TIMED = TimedReference(PATH.tolist(), LIMITS, T)
KINDS = ("timed", "iterated")


def along(kind: str, n: int = 1, side: Array | float = 1.0) -> Reference:
    """The way along `side` times PATH, "timed", known in advance, or "iterated", planned anew in each frame."""
    if kind == "timed":
        return TIMED if np.all(side == 1) else TimedReference((side * PATH).tolist(), LIMITS, T)
    return IteratedReference((side * PATH).tolist(), LIMITS, T, n)


def told(delay: int, lag: float = 0.02, noisy: bool = False) -> Told:
    """What is told of robots with this dead time, frames, and lag, s; vision that is not `noisy` is trusted."""
    noise = (0.0013, 0.01) if noisy else (0.0, 0.0)
    return Told(T, delay, lag, *noise)

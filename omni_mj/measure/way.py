"""What is measured of a timed reference alone: where it travels, its own effort, and when it moved last."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.running import Effort
from omni_mj.scenarios.settings import PERIOD_S

STILL_M = 1e-6  # from the frame before to the frame after: 30 um/s, at which a reference has no direction


class Way:
    """A timed reference, as far as robots that follow it are measured against it.

    Args:
        reference: its poses (frames, 3), m, rad.

    Attributes:
        frames: that it has.
        direction: of `travel` in each, (frames, 2).
        effort_square: of its own velocities, as `Effort` has it, m^2/s^4.
        rest: the frame from which on it does not move any more.
    """

    def __init__(self, reference: Array) -> None:
        self.frames = len(reference)
        self.direction = travel(reference[:, None, :2])[:, 0]
        own = Effort((2,))
        own.add(np.diff(reference[:, :2], axis=0, append=reference[-1:, :2]) / PERIOD_S)
        self.effort_square = float(own.square)
        moves = np.flatnonzero((np.diff(reference, axis=0) != 0).any(-1))
        self.rest = int(moves[-1]) + 1 if moves.size else 0


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
    before, after = (
        np.concatenate(ends) for ends in ((reference[:1], reference[:-1]), (reference[1:], reference[-1:]))
    )
    step = np.where(np.isnan(after), reference, after) - before
    length = np.hypot(step[..., :1], step[..., 1:])
    moves = length > STILL_M
    along_x = np.broadcast_to((1.0, 0.0), step.shape).copy()
    unit = np.divide(step, length, out=along_x, where=moves)
    last = np.maximum.accumulate(np.where(moves, np.arange(len(step))[:, None, None], -1))
    direction: Array = np.take_along_axis(unit, np.where(last < 0, moves.argmax(0), last), axis=0)
    return direction

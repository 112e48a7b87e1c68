"""Commands that set out in time; and what adaptive-comp-flc commands, by loops over robots, for a compiler."""

from typing import Any

import numpy as np

from omni_control.estimation.motion import Plane, pairs, plane
from omni_control.kinematics import Number

NONE_M = 1e-12  # an error that is none


def in_time(coming: Plane, step: float) -> Plane:
    """The command of now from which those that come are missed by least, if it changes by `step` a frame at most.

    A command of the k-th frame from now is missed by as much as it is farther than k steps. Where none would be missed,
    the command of now is as it is wanted. Otherwise it is the one that halves the largest miss, between what is wanted
    now and what will be: the middle of the highest and the lowest that come, each less what can be made up for until
    then. That is done along the direction in which most would be missed, and across it.

    Args:
        coming: commands that are wanted, now first, (frames, n) m/s.
        step: largest change in a frame, m/s.

    Returns:
        (n,) m/s.
    """
    ways, reach = coming - coming[0], step * np.arange(len(coming))[:, None]
    sizes = np.abs(ways)
    worst = (sizes - reach).argmax(0), np.arange(coming.shape[1])
    along = np.divide(ways[worst], sizes[worst], out=np.ones_like(coming[0]), where=sizes[worst] > 0)
    parts, reach = pairs(ways * along.conj()), reach[..., None]
    return coming[0] + plane((parts + reach).min(0) + (parts - reach).max(0)) / 2 * along


def lead(effort: Number, late: Number, stiffness: float) -> Number:
    """Lead times T, s, of efforts g and time constants lag / g, for a correction of a stiffness k, 1/s."""
    lag = effort * late
    return 2 * lag / (effort + np.sqrt(effort**2 + 2 * stiffness * lag))


def fade(correction: Any, error: Any, period: float) -> Number:
    """What a period leaves of a correction, m/s, as it takes an error away, m: fast near none, and slowly from afar."""
    return np.exp(-period * np.abs(correction) / np.maximum(np.abs(error), NONE_M))

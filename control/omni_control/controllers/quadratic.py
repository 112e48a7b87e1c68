"""Quadratic programs over the commands of some frames, which neither may exceed a speed nor change too fast.

Of one robot: minimize w' H w / 2 + c' w over commands w (N pairs) such that, of the commands s = planned + w sent,

    |s(k) - s(k-1)| <= step,  |s(k)| <= speed

for which octagons stand in the place of circles: they have their corners on them, one of them along the way, where
most is asked for; half-way between corners 8 % are given away. There always is a solution, since going on with the
last command is one: where that lies beyond a side of the octagon of speeds, the side is moved out to it.

Where the minimum without limits keeps to them, it is the solution, and found by linear equations. Where it does
not, piqp's interior point method finds it (R. Schwan, Y. Jiang, D. Kuhn and C. N. Jones, IEEE CDC 2023).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.kinematics import Array

_NORMALS = np.pi * (np.arange(4) / 4 + 1 / 8)  # of half the octagon's sides; the others are opposite
_INNER = np.cos(np.pi / 8)  # of the circle about an octagon, in the circle within
EXACT = 1e-9  # to which piqp solves, of residuals and of the gap between primal and dual
SLACK_M_S = 1e-8  # by which what is found without limits may miss them


class Limits(NamedTuple):
    """What commands of n robots must keep to, in N frames.

    Attributes:
        last: command sent before the first frame, (n, 2) m/s.
        planned: commands that w adds to, (N, n, 2) m/s.
        directions: unit vectors along the way, (N, n, 2).
        step: largest change from frame to frame, m/s.
        speed: highest, m/s.
    """

    last: Array
    planned: Array
    directions: Array
    step: float
    speed: float


def minimize(hessian: Array, gradient: Array, limits: Limits) -> tuple[Array, NDArray[np.bool_]]:
    """Return the best w of each robot, (n, N, 2), and which of them limits bind, (n,).

    Robots are solved one by one, each from the start, so that none depends on what others, or former frames, were.
    Where piqp says anything but solved, w is not a number.

    Args:
        hessian: H, (n, 2 N, 2 N), positive definite.
        gradient: c, (n, 2 N).
        limits: of the commands.
    """
    best: Array = -np.linalg.solve(hessian, gradient[..., None])[..., 0].astype(float)
    bound = np.zeros(len(best), bool)
    for robot in range(len(best)):
        rows, low, high = _rows(limits, robot)
        reached = rows @ best[robot]
        bound[robot] = ((reached < low - SLACK_M_S) | (reached > high + SLACK_M_S)).any()
        if bound[robot]:
            best[robot] = _solve(hessian[robot], gradient[robot], rows, low, high)
    return best.reshape(len(best), -1, 2), bound


def _rows(limits: Limits, robot: int) -> tuple[Array, Array, Array]:
    """Return rows (8 N, 2 N), and the bounds (8 N,) of rows w of one robot: of changes, then of speeds."""
    planned, directions = limits.planned[:, robot], limits.directions[:, robot]
    frames, last = len(planned), limits.last[robot]
    angles = np.arctan2(directions[:, 1], directions[:, 0])[:, None] + _NORMALS
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # (N, 4, 2)
    frame = np.arange(frames)
    speeds = np.zeros((frames, 4, frames, 2))
    speeds[frame, :, frame] = normals
    changes = speeds.copy()
    changes[frame[1:], :, frame[:-1]] = -normals[1:]
    sent = (normals @ planned[..., None])[..., 0]
    changed = (normals @ np.diff(planned, axis=0, prepend=last[None])[..., None])[..., 0]
    highest = np.maximum(_INNER * limits.speed, np.abs(normals @ last))
    most = np.concatenate([np.full(4 * frames, _INNER * limits.step), highest.ravel()])
    offset = np.concatenate([changed.ravel(), sent.ravel()])
    return np.concatenate([changes, speeds]).reshape(8 * frames, -1), -most - offset, most - offset


def _solve(hessian: Array, gradient: Array, rows: Array, low: Array, high: Array) -> Array:
    """Return the best w (2 N,) with `low` <= `rows` w <= `high`; not a number unless piqp says that it is."""
    import piqp  # here, since only who needs it must have it

    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = EXACT
    solver.settings.eps_duality_gap_abs = solver.settings.eps_duality_gap_rel = EXACT
    solver.setup(np.asfortranarray(hessian), gradient, None, None, np.asfortranarray(rows), low, high)
    solved = solver.solve() == piqp.PIQP_SOLVED
    return np.array(solver.result.x) if solved else np.full(len(gradient), np.nan)

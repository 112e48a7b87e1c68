"""Quadratic programs over the commands of some frames, which neither may exceed a speed nor change too fast.

Of one robot: minimise w' H w / 2 + c' w over commands w (N pairs) such that, of the commands s = planned + w sent,

    |s(k) - s(k-1)| <= step,  |s(k)| <= speed

for which octagons stand in the place of circles: they have their corners on them, one of them along the way, where most
is asked for; half-way between corners 8 % are given away. There always is a solution, since going on with the last
command is one: where that lies beyond a side of the octagon of speeds, the side is moved out to it.

Where the minimum without limits keeps to them, it is the solution, and found by linear equations. Where it does not,
piqp's interior point method finds it (R. Schwan, Y. Jiang, D. Kuhn and C. N. Jones, IEEE CDC 2023), with the limits of
speed only where it would exceed them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.estimation.motion import Plane, pairs, plane
from omni_control.kinematics import Array

Truth = NDArray[np.bool_]

_SIDES = np.exp(1j * np.pi * (np.arange(4) / 4 + 1 / 8))  # normals of half the octagon's sides; the others are opposite
_INNER = np.cos(np.pi / 8)  # of the circle about an octagon, in the circle within
EXACT = 1e-9  # to which piqp solves, of residuals and of the gap between primal and dual
SLACK_M_S = 1e-8  # by which what is found may miss limits that it was not told of


class Limits(NamedTuple):
    """What commands of n robots must keep to, in N frames.

    Attributes:
        last: command sent before the first frame, (n,) m/s.
        planned: commands that w adds to, (N, n) m/s.
        ways: unit vectors along the way, (N, n).
        step: largest change from frame to frame, m/s.
        speed: highest, m/s.
    """

    last: Plane
    planned: Plane
    ways: Plane
    step: float
    speed: float


def minimise(hessian: Array, gradient: Array, limits: Limits) -> tuple[Plane, Truth]:
    """The best w of each robot, (n, N), and which of them limits bind, (n,).

    Robots are solved one by one, each from the start, so that none depends on what others, or former frames, were.
    Where piqp says anything but solved, w is not a number.

    Args:
        hessian: H, (n, 2 N, 2 N), positive definite.
        gradient: c, (n, 2 N).
        limits: of the commands.
    """
    free = -np.linalg.solve(hessian, gradient[..., None]).astype(float)
    best = plane(free.reshape(len(gradient), -1, 2))
    last, planned, ways, step, speed = limits
    sides = ways[..., None] * _SIDES  # (N, n, 4)
    changes = np.concatenate([last[None], planned])
    changed, sent = _across(sides, changes[1:] - changes[:-1]), _across(sides, planned)
    highest = np.maximum(_INNER * speed, np.abs(_across(sides, last)))

    def kept(w: Plane, robots: slice) -> tuple[Truth, Truth]:
        """Whether robots' changes, and speeds, are within limits."""
        more, own = np.diff(w, axis=1, prepend=0).T, sides[:, robots]
        change, total = changed[:, robots] + _across(own, more), sent[:, robots] + _across(own, w.T)
        slow = np.abs(total) <= highest[:, robots] + SLACK_M_S
        return (np.abs(change) <= _INNER * step + SLACK_M_S).all((0, 2)), slow.all((0, 2))

    steady, slow = kept(best, slice(None))
    bound = ~(steady & slow)
    for robot in np.flatnonzero(bound):
        one = slice(robot, robot + 1)
        on_change, on_speed = _rows(sides[:, robot])
        least, most = ((sign * _INNER * step - changed[:, robot]).ravel() for sign in (-1, 1))
        best[robot] = _solved(hessian[robot], gradient[robot], on_change, least, most)
        if not kept(best[one], one)[1][0]:
            low, high = ((sign * highest[:, robot] - sent[:, robot]).ravel() for sign in (-1, 1))
            rows, low, high = (np.concatenate(each) for each in ((on_change, on_speed), (least, low), (most, high)))
            best[robot] = _solved(hessian[robot], gradient[robot], rows, low, high)
    return best, bound


def _across(sides: Plane, vectors: Plane) -> Array:
    """Components of vectors (..., n) along the normals of sides (N, n, 4)."""
    return (sides.conj() * vectors[..., None]).real


def _rows(sides: Plane) -> tuple[Array, Array]:
    """Of one robot, the components of changes, and of w itself, along sides (N, 4), as linear forms (4 N, 2 N) of w."""
    frames = len(sides)
    speeds, own, normals = np.zeros((frames, 4, frames, 2)), np.arange(frames), pairs(sides)
    speeds[own, :, own] = normals
    changes = speeds.copy()
    changes[own[1:], :, own[:-1]] = -normals[1:]
    return changes.reshape(4 * frames, -1), speeds.reshape(4 * frames, -1)


def _solved(hessian: Array, gradient: Array, rows: Array, low: Array, high: Array) -> Plane:
    """The best w (N,) of one robot with `low` <= `rows` w <= `high`; not a number unless piqp says that it is."""
    import piqp  # here, since only who needs it must have it

    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = EXACT
    solver.settings.eps_duality_gap_abs = solver.settings.eps_duality_gap_rel = EXACT
    solver.setup(np.asfortranarray(hessian), gradient, None, None, np.asfortranarray(rows), low, high)
    solved = solver.solve() == piqp.PIQP_SOLVED
    return plane((np.array(solver.result.x) if solved else np.full(len(gradient), np.nan)).reshape(-1, 2))

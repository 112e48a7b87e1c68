"""Plan better commands for a run by the model of its departures, within the limits of what may be commanded.

With e the errors of a run, u its commands and dp = G du the departures (`DepartureModel`), the plan minimizes

    |e + G du|^2 + rho |du|^2    subject to    |u + du| <= v,   |change of u + du in a frame| <= a T

Limits are lengths of vectors in the plane. The alternating direction method of multipliers (S. Boyd et al.,
Distributed optimization and statistical learning via ADMM, 2011, chapter 5) splits the problem into a sparse linear
system that stays the same and projections in closed form.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from omni_control.kinematics import Array
from omni_control.reference import MotionLimits
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.limit.model import DepartureModel

ARM_M = 0.1  # at which a turn counts as a length: a point of the robot's hull
STEPS = 400
RELAXATION = 1.6  # Boyd et al., section 3.4.3
RHO, PULL_COMMAND, PULL_CHANGE = 2e-8, 2e-5, 2e-4  # s^2; the pulls only decide how fast the method converges
SCALE = np.array([1.0, 1.0, ARM_M])


def improve(model: DepartureModel, limits: MotionLimits, errors: Array, commands: Array) -> tuple[Array, Array]:
    """Return better commands for n runs, and the errors expected of them.

    Args:
        model: Departures of the runs.
        limits: Of what may be commanded.
        errors: Poses less the reference, (F, n, 3).
        commands: Sent commands, (F, n, 3).
    """
    frames, n, _ = errors.shape
    size = 3 * frames
    off, sent = (values.swapaxes(1, 2).reshape(size, n) for values in (errors, commands))
    motion, push = model.operators()
    weights = sp.diags(np.tile(SCALE**2, frames))
    both = sp.vstack([sp.eye(size), sp.eye(size) - sp.eye(size, k=-3)])  # commands, and their changes in a frame
    pull = both.T @ sp.diags(np.concatenate([PULL_COMMAND * weights.diagonal(), PULL_CHANGE * weights.diagonal()]))
    cost = sp.block_diag([RHO * weights + pull @ both, weights, sp.csc_matrix((size, size))])
    constraint = sp.hstack([-push, motion])
    order = np.arange(5 * size).reshape(5, -1, 3).swapaxes(0, 1).ravel()  # frame by frame: a narrow band
    system = sp.bmat([[cost, constraint.T], [constraint, None]]).tocsc()[order][:, order]
    solve = splu(system.tocsc()).solve
    limit = [[limits.speed, limits.turn_rate], [limits.acceleration * PERIOD_S, limits.turn_acceleration * PERIOD_S]]
    bounds = np.repeat(limit, frames, axis=0)
    start = both @ sent
    allowed, owed = start.copy(), np.zeros_like(start)
    right, solution = np.zeros((5 * size, n)), np.empty((5 * size, n))
    right[size : 2 * size] = -weights @ off
    for _ in range(STEPS):
        right[:size] = pull @ (allowed - owed - start)
        solution[order] = solve(right[order])
        now = start + both @ solution[:size]
        relaxed = RELAXATION * now + (1 - RELAXATION) * allowed + owed
        allowed = _within(relaxed, bounds)
        owed = relaxed - allowed
    planned, expected = sent + solution[:size], off + solution[size : 2 * size]
    return planned.reshape(frames, 3, n).swapaxes(1, 2), expected.reshape(frames, 3, n).swapaxes(1, 2)


def _within(columns: Array, bounds: Array) -> Array:
    """Return vectors (3 k, n) shortened to the bounds (k, 2) of the plane and of turning."""
    vectors = columns.reshape(-1, 3, columns.shape[1]).copy()
    plane = np.hypot(vectors[:, 0], vectors[:, 1])
    vectors[:, :2] *= np.minimum(1.0, bounds[:, :1] / np.maximum(plane, 1e-12))[:, None]
    vectors[:, 2] = np.clip(vectors[:, 2], -bounds[:, 1:], bounds[:, 1:])
    return vectors.reshape(columns.shape)

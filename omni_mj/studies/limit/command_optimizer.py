"""Optimization of a run's commands under limits of speed and acceleration.

With the errors e of a run, its commands u, and the deviations dp = G du of a `DeviationModel`, the
optimal change minimizes

    |e + G du|^2 + rho |du|^2    subject to    |u + du| <= v,   |change of u + du in a frame| <= a T

The limits v and a apply to lengths of vectors in the plane. The alternating direction method of
multipliers (ADMM; S. Boyd et al., Distributed optimization and statistical learning via ADMM, 2011,
chapter 5) splits the problem into a sparse linear system with constant coefficients and projections
in closed form.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from omni_control.kinematics import Array
from omni_control.reference import MotionLimits
from omni_mj.config.settings import PERIOD_S
from omni_mj.studies.limit.deviation_model import SCALE, DeviationModel

ITERATIONS = 400
RELAXATION = 1.6  # Boyd et al., section 3.4.3
RHO = 2e-8  # s^2
# Penalties of ADMM on commands and their changes; they only affect the speed of convergence
COMMAND_PENALTY, CHANGE_PENALTY = 2e-5, 2e-4


def optimize_commands(
    model: DeviationModel, limits: MotionLimits, errors: Array, commands: Array
) -> tuple[Array, Array]:
    """Return the commands that minimize the errors of a run.

    Args:
        model: Deviations from the run.
        limits: Limits of the commands.
        errors: Poses of the run minus the reference, (F, 3).
        commands: Its sent commands, (F, 3).

    Returns:
        The optimal commands (F, 3), and the predicted errors (F, 3).
    """
    size = errors.size
    motion, inputs = model.operators()
    weights = sp.diags(np.tile(SCALE**2, len(errors)))
    differences = sp.eye(size) - sp.eye(size, k=-3)  # from frame to frame
    constrained = sp.vstack([sp.eye(size), differences])
    penalty = sp.hstack([COMMAND_PENALTY * weights, CHANGE_PENALTY * differences.T @ weights])
    no_cost = sp.csc_matrix((size, size))
    cost = sp.block_diag([RHO * weights + penalty @ constrained, weights, no_cost])
    constraint = sp.hstack([-inputs, motion])
    solve = splu(sp.bmat([[cost, constraint.T], [constraint, None]]).tocsc()).solve
    start = constrained @ commands.ravel()
    projection, dual, right_side = start, np.zeros(2 * size), np.zeros(5 * size)
    right_side[size : 2 * size] = -weights @ errors.ravel()
    for _ in range(ITERATIONS):
        right_side[:size] = penalty @ (projection - dual - start)
        solution = solve(right_side)
        updated = start + constrained @ solution[:size]
        relaxed = RELAXATION * updated + (1 - RELAXATION) * projection + dual
        projection = _project(relaxed, limits)
        dual = relaxed - projection
    command_change = solution[:size].reshape(-1, 3)
    deviation = solution[size : 2 * size].reshape(-1, 3)
    return commands + command_change, errors + deviation


def _project(vectors: Array, limits: MotionLimits) -> Array:
    """Return commands and their changes per frame, stacked in (6F,), within the limits."""
    plane = np.array([[limits.speed], [limits.acceleration * PERIOD_S]])
    turn = np.array([limits.turn_rate, limits.turn_acceleration * PERIOD_S])[:, None, None]
    vectors = vectors.reshape(2, -1, 3)
    length = np.maximum(np.hypot(vectors[..., 0], vectors[..., 1]), 1e-12)
    short = vectors[..., :2] * np.minimum(1.0, plane / length)[..., None]
    return np.concatenate([short, np.clip(vectors[..., 2:], -turn, turn)], axis=2).ravel()

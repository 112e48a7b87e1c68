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
    shape, size = errors.shape, 3 * model.frames
    scaled_errors, sent = (_columns(values * SCALE) for values in (errors, commands))
    scale = sp.diags(np.tile(SCALE, model.frames))
    inverse = sp.diags(np.tile(1 / SCALE, model.frames))
    motion, push = model.operators()
    motion = sp.block_diag([scale, scale]) @ motion @ sp.block_diag([inverse, inverse])
    push = sp.block_diag([scale, scale]) @ push @ inverse
    differences = sp.eye(size) - sp.eye(size, k=-3)
    cost = sp.block_diag(
        [
            (RHO + PULL_COMMAND) * sp.eye(size) + PULL_CHANGE * differences.T @ differences,
            sp.eye(size),
            sp.csc_matrix((size, size)),
        ]
    )
    constraint = sp.hstack([-push, motion])
    order = np.arange(5 * size).reshape(5, -1, 3).swapaxes(0, 1).ravel()  # frame by frame: a narrow band
    system = sp.bmat([[cost, constraint.T], [constraint, None]]).tocsc()[order][:, order]
    solve = splu(system.tocsc()).solve
    bounds = (
        (limits.speed, limits.turn_rate * ARM_M),
        (limits.acceleration * PERIOD_S, limits.turn_acceleration * ARM_M * PERIOD_S),
    )
    base = [sent, differences @ sent]
    allowed = [values.copy() for values in base]
    owed = [np.zeros_like(values) for values in base]
    right = np.zeros((5 * size, shape[1]))
    right[size : 2 * size] = -scaled_errors
    for _ in range(STEPS):
        speeds, changes = (a - o - b for a, o, b in zip(allowed, owed, base, strict=True))
        right[:size] = PULL_COMMAND * speeds + PULL_CHANGE * (differences.T @ changes)
        solution = np.empty_like(right)
        solution[order] = solve(right[order])
        change = solution[:size]
        for i, now in enumerate((change, differences @ change)):
            relaxed = RELAXATION * (base[i] + now) + (1 - RELAXATION) * allowed[i] + owed[i]
            allowed[i] = _within(relaxed, bounds[i])
            owed[i] = relaxed - allowed[i]
    return (
        _frames(sent + change, shape) / SCALE,
        _frames(scaled_errors + solution[size : 2 * size], shape) / SCALE,
    )


def _columns(values: Array) -> Array:
    """Return runs (F, n, 3) as columns (3 F, n)."""
    return values.swapaxes(1, 2).reshape(-1, values.shape[1])


def _frames(columns: Array, shape: tuple[int, ...]) -> Array:
    return columns.reshape(shape[0], 3, shape[1]).swapaxes(1, 2)


def _within(columns: Array, bounds: tuple[float, float]) -> Array:
    """Return vectors (3 F, n) shortened to the bounds of the plane and of turning."""
    vectors = columns.reshape(-1, 3, columns.shape[1]).copy()
    plane = np.hypot(vectors[:, 0], vectors[:, 1])
    vectors[:, :2] *= np.minimum(1.0, bounds[0] / np.maximum(plane, 1e-12))[:, None]
    vectors[:, 2] = np.clip(vectors[:, 2], -bounds[1], bounds[1])
    return vectors.reshape(columns.shape)

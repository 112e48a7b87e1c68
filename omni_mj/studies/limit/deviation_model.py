"""Linear model of how a robot departs from a known run if its commands change, and the plan of better commands.

Near a run, a change du of the commands changes the robot's velocity v and pose p by

    dv(k) = A(k) dv(k-1) + B0(k) du(k-D) + B1(k) du(k-D-1),      dp(k+1) = dp(k) + T dv(k)

with D the dead time: a first-order lag between two samples. Wheels that creep lag more at speed, so A and B are
polynomials of the reference's speed, acceleration and turn rate in the body frame.

With e the errors of a run, u its commands and dp = G du the departures, the plan minimizes

    |e + G du|^2 + rho |du|^2    subject to    |u + du| <= v,   |change of u + du in a frame| <= a T

Limits are lengths of vectors in the plane. The alternating direction method of multipliers (S. Boyd et al.,
Distributed optimization and statistical learning via ADMM, 2011, chapter 5) splits the problem into a sparse linear
system that stays the same and projections in closed form.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from omni_control.kinematics import Array, body_to_world
from omni_control.reference import MotionLimits
from omni_mj.config.settings import PERIOD_S

SMOOTHING_FRAMES = 11
TURN_SCALE_RAD_S = 5.0  # turn rate that counts as one in the polynomial
ARM_M = 0.1  # at which a turn counts as a length: a point of the robot's hull
STEPS = 400
RELAXATION = 1.6  # Boyd et al., section 3.4.3
RHO, PULL_COMMAND, PULL_CHANGE = (
    2e-8,
    2e-5,
    2e-4,
)  # s^2; the pulls only decide how fast the method converges
SCALE = np.array([1.0, 1.0, ARM_M])


@dataclass(frozen=True, eq=False)
class DeviationModel:
    """Matrices of F frames in the world frame; m, rad, s.

    Attributes:
        velocity: A, shape (F, 3, 3).
        command: B0 and B1, shape (2, F, 3, 3).
        delay: D, frames.
    """

    velocity: Array
    command: Array
    delay: int

    @property
    def frames(self) -> int:
        """Return F."""
        return len(self.velocity)

    @classmethod
    def prior(cls, frames: int, delay: int, lag_s: float) -> "DeviationModel":
        """Return the model of a robot that follows its commands with a first-order lag."""
        decay = np.exp(-PERIOD_S / lag_s) if lag_s else 0.0
        # Share of a frame's path due to the velocity before
        carried = lag_s * (1 - decay) / PERIOD_S
        shares = np.array([1 - carried, carried - decay])
        return cls(
            np.tile(decay * np.eye(3), (frames, 1, 1)),
            shares[:, None, None, None] * np.tile(np.eye(3), (frames, 1, 1)),
            delay,
        )

    @classmethod
    def fit(cls, reference: Array, delay: int, poses: Array, commands: Array) -> "DeviationModel":
        """Fit the model by least squares to how runs differ from one of them.

        Args:
            reference: Poses (F, 3) near which all runs are.
            delay: Dead time, frames.
            poses: Pose differences, (F, n, 3).
            commands: Differences of the sent commands, (F, n, 3).
        """
        body_axes = body_to_world(np.eye(3), reference[:, 2:]).swapaxes(
            1, 2
        )  # in the world frame, (F, 3, 3)
        basis = _basis(reference)
        velocity = np.diff(poses, axis=0) / PERIOD_S
        inputs = _delayed(velocity, 1), _delayed(commands, delay), _delayed(commands, delay + 1)
        in_body = [
            np.einsum("kji,knj->kni", body_axes[:-1], x[: len(velocity)])
            for x in (velocity, *inputs)
        ]
        regressors = np.concatenate(in_body[1:], axis=2)[..., None] * basis[:-1, None, None]
        rows = regressors.reshape(-1, regressors[0, 0].size)
        solution = scipy.linalg.lstsq(rows, in_body[0].reshape(-1, 3), cond=1e-4)[0]
        blocks = solution.reshape(3, 3, basis.shape[1], 3)
        fitted = np.einsum("mjbi,kb->mkij", blocks, basis)
        world = body_axes @ fitted @ body_axes.swapaxes(-1, -2)
        return cls(world[0], world[1:], delay)

    def operators(self) -> tuple[sp.csc_matrix, sp.csc_matrix]:
        """Return sparse M (6F, 6F) and N (6F, 3F) of M [dp; dv] = N du, frame after frame."""
        size = 3 * self.frames

        def shift(frames: int) -> sp.spmatrix:
            return sp.eye(size, k=-3 * frames)

        lag = sp.eye(size) - sp.block_diag(self.velocity) @ shift(1)
        push = sp.block_diag(self.command[0]) @ shift(self.delay)
        push = push + sp.block_diag(self.command[1]) @ shift(self.delay + 1)
        motion = sp.bmat([[sp.eye(size) - shift(1), -PERIOD_S * shift(1)], [None, lag]])
        return motion.tocsc(), sp.vstack([sp.csc_matrix((size, size)), push]).tocsc()


def _basis(reference: Array) -> Array:
    """Return the terms of the polynomials in each frame, (F, terms)."""
    velocity = np.gradient(reference, PERIOD_S, axis=0)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    window = np.hanning(SMOOTHING_FRAMES + 2)[1:-1]
    acceleration = np.gradient(velocity[:, :2], PERIOD_S, axis=0)
    smooth = [np.convolve(axis, window / window.sum(), "same") for axis in acceleration.T]
    turn = np.abs(velocity[:, 2]) / TURN_SCALE_RAD_S
    return np.stack([np.ones_like(speed), speed, speed**2, np.hypot(*smooth), turn], axis=1)


def _delayed(values: Array, frames: int) -> Array:
    """Return the values so many frames later, zero before."""
    return np.pad(values, [(frames, 0), (0, 0), (0, 0)])


def improve(
    model: DeviationModel, limits: MotionLimits, errors: Array, commands: Array
) -> tuple[Array, Array]:
    """Return better commands for a run, and the errors expected of them.

    Args:
        model: Departures of the run.
        limits: Of what may be commanded.
        errors: Poses less the reference, (F, 3).
        commands: Sent commands, (F, 3).
    """
    size = errors.size
    motion, push = model.operators()
    weights = sp.diags(np.tile(SCALE**2, len(errors)))
    changes = sp.eye(size) - sp.eye(size, k=-3)  # of commands in a frame
    both = sp.vstack([sp.eye(size), changes])
    pull = sp.hstack([PULL_COMMAND * weights, PULL_CHANGE * changes.T @ weights])
    cost = sp.block_diag([RHO * weights + pull @ both, weights, sp.csc_matrix((size, size))])
    constraint = sp.hstack([-push, motion])
    solve = splu(sp.bmat([[cost, constraint.T], [constraint, None]]).tocsc()).solve
    plane = np.array([[limits.speed], [limits.acceleration * PERIOD_S]])
    turn = np.array([limits.turn_rate, limits.turn_acceleration * PERIOD_S])[:, None, None]
    start = both @ commands.ravel()
    allowed, owed, right = start, np.zeros(2 * size), np.zeros(5 * size)
    right[size : 2 * size] = -weights @ errors.ravel()
    for _ in range(STEPS):
        right[:size] = pull @ (allowed - owed - start)
        solution = solve(right)
        relaxed = RELAXATION * (start + both @ solution[:size]) + (1 - RELAXATION) * allowed + owed
        vectors = relaxed.reshape(2, -1, 3)
        length = np.maximum(np.hypot(vectors[..., 0], vectors[..., 1]), 1e-12)
        short = vectors[..., :2] * np.minimum(1.0, plane / length)[..., None]
        allowed = np.concatenate([short, np.clip(vectors[..., 2:], -turn, turn)], axis=2).ravel()
        owed = relaxed - allowed
    return commands + solution[:size].reshape(-1, 3), errors + solution[size : 2 * size].reshape(
        -1, 3
    )

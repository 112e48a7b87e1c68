"""The next commands to try: by what is known of deviations, the least error that the limits of commands allow.

Of errors e that a run had, commands u it was sent, and dp = G du of `Deviations`, wanted are changes du with

    the least  f(e + dp) + rho/2 |du|^2    so that    |u + du| <= v,   |change of u + du in a frame| <= a T

where f is the greatest error in the plane over all frames, or the mean one. Limits and errors are lengths of vectors
in the plane, so that this is a second-order cone program; the method of multipliers (S. Boyd et al., Distributed
optimization and statistical learning via ADMM, 2011, chapters 3 and 6) splits it into a sparse linear system that stays
the same, and projections that are known in closed form. Turning has limits and an error of its own, at an arm's length.
"""

from typing import Literal

import numpy as np
import scipy.sparse as sp

from omni_control.kinematics import Array
from omni_control.reference import MotionLimits
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.limit.deviations import Deviations

Aim = Literal["max", "mean"]
AIMS: tuple[Aim, ...] = ("max", "mean")
ARM_M = 0.1  # at which turning counts as a length: that of a point of the robot's hull
STEPS = 400
RELAXED = 1.6  # Boyd et al., section 3.4.3
# The method's own weights of errors, commands, their changes in a frame, and rho, over the errors' size. Tried on
# `rect` and `league`: ten times more or less cost a few per cent.
PULL = {"max": (1.0, 2e-5, 2e-4, 2e-8), "mean": (1.0, 2e-4, 2e-3, 2e-8)}
TINY_M = 1e-9


class Planner:
    """Plans for runs of which the deviations are known.

    Args:
        deviations: of a run's poses by its commands.
        limits: of what may be commanded.
    """

    def __init__(self, deviations: Deviations, limits: MotionLimits) -> None:
        frames = deviations.frames
        self._scale = np.array([1.0, 1.0, ARM_M])
        scale = sp.diags(np.tile(self._scale, frames))
        back = sp.diags(np.tile(1 / self._scale, frames))
        poses, commands = deviations.operators()
        self._poses, self._commands = scale @ poses @ back, scale @ commands @ back
        self._change = sp.kron(sp.eye(frames) - sp.eye(frames, k=-1), sp.eye(3)).tocsc()
        self._highest = limits.speed, limits.turn_rate * ARM_M
        self._step = limits.acceleration * PERIOD_S, limits.turn_acceleration * ARM_M * PERIOD_S

    def improve(self, errors: Array, commands: Array, aim: Aim) -> tuple[Array, Array]:
        """Plan for n runs.

        Args:
            errors: poses less where they should have been, (F, n, 3).
            commands: that were sent, (F, n, 3).
            aim: what shall be least.

        Returns:
            Commands (F, n, 3) within the limits, and the errors expected of them.
        """
        from scipy.sparse.linalg import splu

        frames, n, _ = errors.shape
        shape = frames, n, 3
        start, sent = ((values * self._scale).transpose(0, 2, 1).reshape(-1, n) for values in (errors, commands))
        size = np.hypot(errors[..., 0], errors[..., 1])
        typical = float(np.median(size.max(0) if aim == "max" else size.mean(0)))
        share = 1 / max(typical, TINY_M)
        pull = share * np.array(PULL[aim])
        system = self._system(pull)
        solve = splu(system).solve

        changes = self._change @ sent
        kept = [start.copy(), sent.copy(), changes.copy()]
        owed = [np.zeros_like(start) for _ in kept]
        change = moved = np.zeros_like(start)
        for _ in range(STEPS):
            wanted = [k - o for k, o in zip(kept, owed, strict=True)]
            right = pull[1] * (wanted[1] - sent) + self._change.T @ (pull[2] * (wanted[2] - changes))
            both = solve(_interleaved(right, pull[0] * (wanted[0] - start), np.zeros_like(start)))
            change, moved = _apart(both)
            reached = (start + moved, sent + change, changes + self._change @ change)
            for i, now in enumerate(reached):
                mixed = RELAXED * now + (1 - RELAXED) * kept[i] + owed[i]
                vectors = mixed.reshape(frames, 3, n).transpose(0, 2, 1)
                fixed = self._nearest(i, vectors, aim, share)
                kept[i] = fixed.transpose(0, 2, 1).reshape(-1, n)
                owed[i] = mixed - kept[i]
        planned = (sent + change).reshape(frames, 3, n).transpose(0, 2, 1)
        planned = self._allowed(planned)
        follow = splu(self._poses.tocsc()).solve
        moved = follow(self._commands @ (planned.transpose(0, 2, 1).reshape(-1, n) - sent))
        expected = (start + moved).reshape(frames, 3, n).transpose(0, 2, 1)
        assert planned.shape == expected.shape == shape
        return planned / self._scale, expected / self._scale

    def _system(self, pull: Array) -> sp.csc_matrix:
        """Conditions of the least, for changes, poses and multipliers of each frame side by side: a band."""
        size = self._poses.shape[0]
        unit = sp.eye(size)
        commands = (pull[3] + pull[1]) * unit + pull[2] * (self._change.T @ self._change)
        blocks = [
            [commands, None, -self._commands.T],
            [None, pull[0] * unit, self._poses.T],
            [-self._commands, self._poses, None],
        ]
        order = _order(size)
        return sp.bmat(blocks).tocsc()[order][:, order].tocsc()

    def _nearest(self, which: int, vectors: Array, aim: Aim, share: float) -> Array:
        """Errors that `aim` likes better, or commands or their changes that are allowed, near vectors (F, n, 3)."""
        plane, turn = vectors[..., :2], vectors[..., 2:]
        if which:
            limits = self._highest if which == 1 else self._step
            return np.concatenate([_within(plane, limits[0]), _within(turn, limits[1])], axis=-1)
        shrink = _flatten if aim == "max" else _soften
        return np.concatenate([shrink(plane, 1 / share), shrink(turn, 1 / share)], axis=-1)

    def _allowed(self, commands: Array) -> Array:
        """The commands (F, n, 3) as limits would let them pass; see `CommandLimits`."""
        last, passed = np.zeros_like(commands[0]), np.empty_like(commands)
        for k, wanted in enumerate(commands):
            plane, turn = _within(wanted[..., :2], self._highest[0]), _within(wanted[..., 2:], self._highest[1])
            step = np.concatenate([plane, turn], axis=-1) - last
            step = np.concatenate([_within(step[..., :2], self._step[0]), _within(step[..., 2:], self._step[1])], -1)
            passed[k] = last = last + step
        return passed


def _within(vectors: Array, length: float | Array) -> Array:
    """Vectors (..., d), those that are longer cut to a length."""
    return vectors * np.minimum(1.0, length / np.maximum(_size(vectors), 1e-300))


def _soften(vectors: Array, by: float) -> Array:
    """The proximal map of the sum of lengths: each shorter by as much."""
    return vectors * np.maximum(0.0, 1 - by / np.maximum(_size(vectors), 1e-300))


def _flatten(vectors: Array, by: float) -> Array:
    """The proximal map of the greatest length over the first axis: the longest are cut to one level, by `by` in all."""
    size = _size(vectors)
    falling = -np.sort(-size, axis=0)
    count = np.arange(1, len(size) + 1).reshape(-1, *[1] * (size.ndim - 1))
    levels = (np.cumsum(falling, axis=0) - by) / count
    level = np.maximum(levels.max(0), 0.0)  # of all, the one that its own count of vectors reaches is the greatest
    return _within(vectors, level)


def _size(vectors: Array) -> Array:
    return np.sqrt((vectors**2).sum(-1, keepdims=True))


def _order(size: int) -> np.ndarray:
    """Where changes, poses and multipliers go when they are put side by side frame by frame."""
    return np.arange(3 * size).reshape(3, -1, 3).transpose(1, 0, 2).ravel()


def _interleaved(changes: Array, poses: Array, multipliers: Array) -> Array:
    return np.concatenate([changes, poses, multipliers])[_order(len(changes))]


def _apart(both: Array) -> tuple[Array, Array]:
    frames, n = len(both) // 9, both.shape[1]
    parts = both.reshape(frames, 3, 3, n)
    return parts[:, 0].reshape(-1, n), parts[:, 1].reshape(-1, n)

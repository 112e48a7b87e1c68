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
_SCALE = np.array([1.0, 1.0, ARM_M])


class Planner:
    """Plans for runs of which the deviations are known.

    Args:
        deviations: of a run's poses by its commands.
        limits: of what may be commanded.
    """

    def __init__(self, deviations: Deviations, limits: MotionLimits) -> None:
        frames = deviations.frames
        scale, back = (sp.diags(np.tile(by, frames)) for by in (_SCALE, 1 / _SCALE))
        poses, commands = deviations.operators()
        self._poses, self._commands = (scale @ poses @ back).tocsc(), (scale @ commands @ back).tocsc()
        self._limits = [
            None,
            (limits.speed, limits.turn_rate * ARM_M),
            (limits.acceleration * PERIOD_S, limits.turn_acceleration * ARM_M * PERIOD_S),
        ]

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

        start, sent = (np.ascontiguousarray((values * _SCALE).swapaxes(1, 2)) for values in (errors, commands))
        frames, _, n = start.shape
        size = np.hypot(start[:, 0], start[:, 1])
        share = 1 / max(float(np.median(size.max(0) if aim == "max" else size.mean(0))), TINY_M)
        pull = share * np.array(PULL[aim])
        solve = splu(self._system(pull)).solve

        # Errors, commands and their changes: as they follow from each other, and as they are liked or allowed.
        base = [start, sent, _changes(sent)]
        kept, owed = [values.copy() for values in base], [np.zeros_like(start) for _ in base]
        right, change = np.zeros((frames, 3, 3, n)), np.zeros_like(start)
        for _ in range(STEPS):
            poses, speeds, changes = (k - o - b for k, o, b in zip(kept, owed, base, strict=True))
            right[:, 0] = pull[1] * speeds + pull[2] * _changed(changes)
            right[:, 1] = pull[0] * poses
            both = solve(right.reshape(-1, n)).reshape(right.shape)
            change = both[:, 0]
            for i, now in enumerate((both[:, 1], change, _changes(change))):
                mixed = RELAXED * (base[i] + now) + (1 - RELAXED) * kept[i] + owed[i]
                kept[i] = self._nearest(i, mixed, aim, 1 / share)
                owed[i] = mixed - kept[i]
        planned = self._allowed(sent + change)
        moved = splu(self._poses).solve(self._commands @ (planned - sent).reshape(-1, n)).reshape(start.shape)
        return planned.swapaxes(1, 2) / _SCALE, (start + moved).swapaxes(1, 2) / _SCALE

    def _system(self, pull: Array) -> sp.csc_matrix:
        """Conditions of the least, for changes, poses and multipliers of each frame side by side: a band."""
        size = self._poses.shape[0]
        unit, frames = sp.eye(size), size // 3
        change = sp.kron(sp.eye(frames) - sp.eye(frames, k=-1), sp.eye(3))
        commands = (pull[3] + pull[1]) * unit + pull[2] * (change.T @ change)
        blocks = [
            [commands, None, -self._commands.T],
            [None, pull[0] * unit, self._poses.T],
            [-self._commands, self._poses, None],
        ]
        order = np.arange(3 * size).reshape(3, -1, 3).swapaxes(0, 1).ravel()
        return sp.bmat(blocks).tocsc()[order][:, order].tocsc()

    def _nearest(self, which: int, vectors: Array, aim: Aim, by: float) -> Array:
        """Errors that `aim` likes better, or commands or their changes that are allowed, near vectors (F, 3, n)."""
        plane, turn = vectors[:, :2], vectors[:, 2:]
        if limits := self._limits[which]:
            return np.concatenate([_within(plane, limits[0]), _within(turn, limits[1])], axis=1)
        shrink = flatten if aim == "max" else soften
        return np.concatenate([shrink(plane, by), shrink(turn, by)], axis=1)

    def _allowed(self, commands: Array) -> Array:
        """The commands (F, 3, n) as limits would let them pass; see `CommandLimits`."""
        last, passed = np.zeros_like(commands[:1]), np.empty_like(commands)
        for k in range(len(commands)):
            wanted = self._nearest(1, commands[k : k + 1], "max", 0.0)
            passed[k : k + 1] = last = last + self._nearest(2, wanted - last, "max", 0.0)
        return passed


def soften(vectors: Array, by: float) -> Array:
    """The proximal map of the sum of lengths of vectors (F, d, n) over F: each is made shorter by as much."""
    return vectors * np.maximum(0.0, 1 - by / np.maximum(_size(vectors), 1e-300))


def flatten(vectors: Array, by: float) -> Array:
    """The proximal map of the greatest length of vectors (F, d, n) over F: the longest are cut to one level.

    What is cut off adds up to `by`.
    """
    size = _size(vectors)
    falling = -np.sort(-size, axis=0)
    levels = (np.cumsum(falling, axis=0) - by) / np.arange(1, len(size) + 1)[:, None, None]
    return _within(vectors, np.maximum(levels.max(0), 0.0))  # of all, the level that its own count reaches is greatest


def _within(vectors: Array, length: float | Array) -> Array:
    """Vectors (F, d, n), those that are longer cut to a length."""
    return vectors * np.minimum(1.0, length / np.maximum(_size(vectors), 1e-300))


def _size(vectors: Array) -> Array:
    return np.abs(vectors) if vectors.shape[1] == 1 else np.hypot(vectors[:, :1], vectors[:, 1:])


def _changes(values: Array) -> Array:
    """Of values (F, ...) from frame to frame, from zero on."""
    changes = values.copy()
    changes[1:] -= values[:-1]
    return changes


def _changed(changes: Array) -> Array:
    """The transpose of `_changes`."""
    values = changes.copy()
    values[:-1] -= changes[1:]
    return values

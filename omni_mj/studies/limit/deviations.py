"""How a robot departs from a run that is known, if it is sent other commands: linear, and new in every frame.

Around a run, a robot's speed v in a frame answers to changes of its commands as

    dv(k) = A(k) dv(k-1) + B0(k) du(k-D) + B1(k) du(k-D-1),      dp(k+1) = dp(k) + T dv(k)

with D the dead time: what a lag of first order does between two samples. On wheels that creep the lag grows with
speed, so that A and B are polynomials of it, in the body's axes; the one part of the law of creep (docs/physics.md)
that is not, is that speeding up costs gain, a change along the way costing most.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S

ORDER = 2  # commands that act on a frame
SMOOTH_FRAMES = 11  # over which the reference's acceleration is averaged
TURN_SCALE_RAD_S = 5.0  # of a turn rate that counts as one
SLOW_M_S = 0.05  # below which a way has no direction
RIDGE = 1e-6  # of a regressor's mean square


@dataclass(frozen=True, eq=False)
class Deviations:
    """The matrices of F frames, world frame: m, rad, s.

    Attributes:
        keep: A, (F, 3, 3).
        push: B0 and B1, (2, F, 3, 3).
        delay: D, frames.
    """

    keep: Array
    push: Array
    delay: int

    @property
    def frames(self) -> int:
        """F."""
        return len(self.keep)

    @classmethod
    def prior(cls, frames: int, delay: int, lag_s: float) -> "Deviations":
        """Those of a robot that follows its commands with a lag, and nothing more is known of."""
        keep = np.exp(-PERIOD_S / lag_s) if lag_s else 0.0
        slide = lag_s * (1 - keep) / PERIOD_S  # share of a frame's way that the speed before decides
        push = np.array([1 - slide, slide - keep])
        return cls(
            np.broadcast_to(keep * np.eye(3), (frames, 3, 3)),
            np.broadcast_to(push[:, None, None, None] * np.eye(3), (ORDER, frames, 3, 3)),
            delay,
        )

    @classmethod
    def fit(cls, reference: Array, delay: int, poses: Array, commands: Array) -> "Deviations":
        """Least squares over runs that differ a little from one another.

        Args:
            reference: poses (F, 3) near which all of them drive.
            delay: dead time, frames.
            poses: how runs differ from one of them, (F, n, 3).
            commands: same, of what was sent, (F, n, 3).
        """
        frames, n, _ = poses.shape
        turned, basis, along = _bases(reference)
        speed = _later(np.diff(poses, axis=0) / PERIOD_S, 0)
        felt = [_later(commands, delay + j)[: frames - 1] for j in range(ORDER)]
        parts = [_body(turned, x) for x in (_later(speed, 1)[: frames - 1], *felt)]
        linear = np.concatenate([x[..., None] * basis[:-1, None, None] for x in parts], axis=2)
        linear = linear.reshape(frames - 1, n, -1)
        wanted = _body(turned, speed)
        found = np.zeros((1 + ORDER, frames, 3, 3))
        for i in range(3):
            creep = (along[:-1, None, i] * parts[0]).sum(-1)
            solution = _least_squares(np.concatenate([linear, creep[..., None]], axis=2), wanted[..., i])
            found[:, :, i] = np.einsum("mjb,kb->mkj", solution[:-1].reshape(1 + ORDER, 3, -1), basis)
            found[0, :, i] += solution[-1] * along[:, i]
        world = turned @ found @ turned.swapaxes(-1, -2)
        return cls(world[0], world[1:], delay)

    def operators(self) -> tuple[sp.csc_matrix, sp.csc_matrix]:
        """Sparse M and N, (3F, 3F), of M dp = N du: poses and commands of all frames, one frame after the other."""
        frames, unit = self.frames, np.eye(3)
        k = np.arange(frames - 1)
        one = np.broadcast_to(unit / PERIOD_S, (len(k), 3, 3))
        kept = self.keep[1:-1] / PERIOD_S
        poses = _blocks(frames, k[:1], k[:1], unit[None]) + _blocks(frames, k + 1, k + 1, one)
        poses = poses - _blocks(frames, k + 1, k, one)
        poses = poses - _blocks(frames, k[1:] + 1, k[1:], kept) + _blocks(frames, k[1:] + 1, k[1:] - 1, kept)
        commands = sp.csc_matrix((3 * frames, 3 * frames))
        for j, push in enumerate(self.push):
            late = k[k >= self.delay + j]
            commands = commands + _blocks(frames, late + 1, late - self.delay - j, push[late])
        return poses.tocsc(), commands.tocsc()


def _bases(reference: Array) -> tuple[Array, Array, Array]:
    """Body axes in the world (F, 3, 3), polynomials of speed (F, b), and a v^T / |v| (F, 3, 3) in body axes."""
    heading = reference[:, 2]
    c, s, zero, one = np.cos(heading), np.sin(heading), np.zeros_like(heading), np.ones_like(heading)
    turned = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
    velocity = np.gradient(reference, PERIOD_S, axis=0)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    window = np.hanning(SMOOTH_FRAMES + 2)[1:-1] / np.hanning(SMOOTH_FRAMES + 2).sum()
    smooth = np.stack([np.convolve(axis, window, "same") for axis in np.gradient(velocity, PERIOD_S, axis=0).T], axis=1)
    pull = np.hypot(smooth[:, 0], smooth[:, 1])
    basis = np.stack([one, speed, speed**2, pull, np.abs(velocity[:, 2]) / TURN_SCALE_RAD_S], axis=1)
    direction = velocity * [1, 1, 0] / np.maximum(speed, SLOW_M_S)[:, None]
    acceleration, along = (np.einsum("kji,kj->ki", turned, each) for each in (smooth, direction))
    return turned, basis, acceleration[:, :, None] * along[:, None, :]


def _body(turned: Array, values: Array) -> Array:
    """World vectors (F - 1, n, 3) in the body axes of the reference."""
    return np.einsum("kji,knj->kni", turned[: len(values)], values)


def _later(values: Array, frames: int) -> Array:
    """The same so many frames later, zero before."""
    return np.concatenate([np.zeros((frames, *values.shape[1:])), values])


def _least_squares(regressors: Array, wanted: Array) -> Array:
    """Coefficients (m,) of regressors (F, n, m) for values (F, n), barely held back, so that unused ones are zero."""
    rows = regressors.reshape(-1, regressors.shape[-1])
    scale = np.sqrt((rows**2).mean(0)) + np.finfo(float).tiny
    rows = rows / scale
    normal = rows.T @ rows + RIDGE * len(rows) * np.eye(len(scale))
    return np.linalg.solve(normal, rows.T @ wanted.ravel()) / scale


def _blocks(frames: int, row: np.ndarray, column: np.ndarray, blocks: Array) -> sp.coo_matrix:
    """A sparse matrix (3 frames, 3 frames) with 3 x 3 blocks at rows and columns of blocks."""
    three = np.arange(3)
    i = np.broadcast_to(3 * row[:, None, None] + three[:, None], blocks.shape)
    j = np.broadcast_to(3 * column[:, None, None] + three, blocks.shape)
    return sp.coo_matrix((blocks.ravel(), (i.ravel(), j.ravel())), shape=(3 * frames, 3 * frames))

"""The law of `estimation.motion`, made linear about a reference over some frames: what commands do to the errors.

Per axis of the body the law has a lag that depends on the speed. With the reference's speed in its place, it is linear,
and the errors of position and velocity, e_p and e_v, in the world, obey

    e_v(k+1) = D e_v(k) + G w(k)               D = decay of a velocity in a frame, G = (1 - D) / g
    e_p(k+1) = e_p(k) + C e_v(k) + M w(k) + r   C = way made in that decay,        M = (T - C) / g

with w what is commanded besides the inverse of the law for the reference, and r what that inverse misses of its
positions: it leads to the velocities at the ends of each frame. D, G, C, M are of the body's axes, turned into the
world by the heading that is expected in that frame.
"""

from typing import NamedTuple

import numpy as np

from omni_control.estimation.motion import Motion, Plane, pairs, plane
from omni_control.kinematics import Array


class Horizon(NamedTuple):
    """How the errors of n robots depend on commands in N frames, the frames' x and y one after the other.

    Attributes:
        feed_forward: commands that the reference asks for, (N, n) m/s, world frame.
        free: errors with these alone, (n, 2 N + 2): of the positions at the end of each frame, and of the position to
            which the last velocity would still lead, m.
        effect: of further commands on them, (n, 2 N + 2, 2 N), s.
    """

    feed_forward: Plane
    free: Array
    effect: Array


def horizon(
    law: Motion, positions: Plane, velocities: Plane, facing: Plane, error: Plane, late: Plane, period: float
) -> Horizon:
    """The errors of robots along a reference.

    Args:
        law: of n robots.
        positions: of the reference at the beginning of each frame and at the end of the last, (N + 1, n) m.
        velocities: the same, m/s.
        facing: expected headings in the middle of each frame, unit vectors (N, n).
        error: what the position has more than the reference at the beginning, (n,) m.
        late: the same of the velocity, m/s.
        period: length of a frame, s.
    """
    frames, n = facing.shape
    back = facing.conj()
    before, after = pairs(velocities[:-1] * back), pairs(velocities[1:] * back)
    lag = law.late(np.abs(velocities[:-1]))
    decay = np.exp(-period / lag)
    carried = (1 - decay) * lag
    towards = (after - decay * before) / (1 - decay)
    moved = plane(period * towards + lag * (before - after)) * facing
    missed = pairs(moved - (positions[1:] - positions[:-1]))

    maps = np.stack([carried, decay, (period - carried) / law.effort, (1 - decay) / law.effort, lag], axis=2)
    onwards = np.zeros((frames, n, 5, 5))  # of e_p, e_v and 1, one row each of both axes
    onwards[..., range(5), range(5)] = 1.0
    turned = _turned(maps, facing)  # (N, n, 10, 2)
    onwards[..., :2, 2:4], onwards[..., 2:4, 2:4], onwards[..., :2, 4] = turned[..., :2, :], turned[..., 2:4, :], missed
    driven, last = turned[..., 4:8, :], turned[-1, :, 8:]

    table = np.zeros((frames + 1, n, 5, 2 * frames + 1))  # by commands, and, in the last column, without them
    table[0, :, :2, -1], table[0, :, 2:4, -1], table[..., 4, -1] = pairs(error), pairs(late), 1.0
    for k in range(frames):
        np.matmul(onwards[k], table[k], out=table[k + 1])
        table[k + 1, :, :4, 2 * k : 2 * k + 2] = driven[k]
    ends = table[-1, :, :2] + last @ table[-1, :, 2:4]
    errors = np.concatenate([table[1:, :, :2], ends[None]]).swapaxes(0, 1).reshape(n, 2 * frames + 2, -1)
    return Horizon(law.ask(velocities[:-1], velocities[1:], facing, period), errors[:, :, -1], errors[:, :, :-1])


def _turned(scales: Array, facing: Plane) -> Array:
    """Maps that scale by (..., m, 2) along the body's axes, as matrices (..., 2 m, 2) of the world, row under row."""
    double = pairs(facing**2)[..., None, :]  # cosine and sine of twice the heading
    mean, half = scales.sum(-1) / 2, (scales[..., 0] - scales[..., 1]) / 2
    matrices = np.empty((*scales.shape, 2))
    matrices[..., 0, 0], matrices[..., 1, 1] = mean + half * double[..., 0], mean - half * double[..., 0]
    matrices[..., 0, 1] = matrices[..., 1, 0] = half * double[..., 1]
    return matrices.reshape(*facing.shape, -1, 2)

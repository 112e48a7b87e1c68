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
    lag = law.lag(np.abs(velocities[:-1])) / law.effort
    decay = np.exp(-period / lag)
    carried = (1 - decay) * lag
    towards = (after - decay * before) / (1 - decay)
    moved = plane(period * towards + lag * (before - after)) * facing
    missed = pairs(moved - (positions[1:] - positions[:-1]))

    gained, pushed = (1 - decay) / law.effort, (period - carried) / law.effort
    onwards = _turned(np.concatenate([carried, decay], axis=-1), facing)  # (N, n, 4, 2): of e_v on e_p and e_v
    driven = _turned(np.concatenate([pushed, gained], axis=-1), facing)  # the same of a command
    way, speed = np.zeros((2, n, 2, 2 * frames + 1))  # the last column is what happens without commands
    way[:, :, -1], speed[:, :, -1] = pairs(error), pairs(late)
    reached = np.empty((frames + 1, n, 2, 2 * frames + 1))
    for k in range(frames):
        both = onwards[k] @ speed
        way, speed = way + both[:, :2], both[:, 2:]
        way[:, :, -1] += missed[k]
        way[:, :, 2 * k : 2 * k + 2], speed[:, :, 2 * k : 2 * k + 2] = driven[k, :, :2], driven[k, :, 2:]
        reached[k] = way
    reached[frames] = way + _turned(lag[-1], facing[-1]) @ speed
    table = reached.transpose(1, 0, 2, 3).reshape(n, 2 * frames + 2, 2 * frames + 1)
    return Horizon(law.ask(velocities[:-1], velocities[1:], facing, period), table[:, :, -1], table[:, :, :-1])


def _turned(along: Array, facing: Plane) -> Array:
    """Maps that scale pairs along the body's axes, m maps (..., 2 m), as matrices of the world (..., 2 m, 2)."""
    ahead = pairs(facing)
    left = pairs(1j * facing)
    maps = along.reshape(*facing.shape, -1, 2)[..., None, None, :]  # (..., m, 1, 1, 2)
    axes = np.stack([ahead[..., :, None] * ahead[..., None, :], left[..., :, None] * left[..., None, :]], axis=-1)
    return (maps[..., 0] * axes[..., None, :, :, 0] + maps[..., 1] * axes[..., None, :, :, 1]).reshape(
        *facing.shape, -1, 2
    )

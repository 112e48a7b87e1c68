"""Model predictive control with preview: the best commands for the next frames within what may be commanded.

Per axis of the body the `MotionModel` has a lag that depends on the speed. With the reference's speed in
its place it is linear, and the errors of position and velocity, e_p and e_v, in the world, obey

    e_v(k+1) = D e_v(k) + G w(k)               D = decay of a velocity in a frame, G = (1 - D) / g
    e_p(k+1) = e_p(k) + C e_v(k) + M w(k) + r   C = way made in that decay,        M = (T - C) / g

with w what is commanded besides the inverse of the law for the reference, and r what that inverse misses of its
positions: it leads to the velocities at the ends of each frame. D, G, C, M are of the body's axes, turned into
the world by the heading that is expected in that frame.

**Quadratic programs.** Of one robot: minimize w' H w / 2 + c' w over commands w (N pairs) such that, of the
commands s = planned + w sent,

    |s(k) - s(k-1)| <= step,  |s(k)| <= speed

for which octagons stand in the place of circles: they have their corners on them, one of them along the way, where
most is asked for; half-way between corners 8 % are given away. There always is a solution, since going on with the
last command is one: where that lies beyond a side of the octagon of speeds, the side is moved out to it.

Where the minimum without limits keeps to them, it is the solution, and found by linear equations. Where it does
not, piqp's interior point method finds it (R. Schwan, Y. Jiang, D. Kuhn and C. N. Jones, IEEE CDC 2023).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.controllers.adaptive import AdaptiveCompFlc
from omni_control.controllers.base import Observation, TeamModel
from omni_control.estimation.motion_model import DISTURBANCE, INVERSE_GAIN, POSE, VELOCITY
from omni_control.kinematics import Array, body_to_world, world_to_body, wrap_angle
from omni_control.reference import Reference

FRAMES = 20  # N: a third of a second, in which an error falls to exp(-15 / s * 0.33 s) = 0.7 %
# In speed ranges per error range: 15/s, the gain of the fuzzy controller at zero error
STIFFNESS = 1.5
STILL_M_S = 0.01  # speed of the reference below which its way has no direction
_NORMALS = np.pi * (
    np.arange(4) / 4 + 1 / 8
)  # of half the octagon's sides; the others are opposite
_INNER = np.cos(np.pi / 8)  # of the circle about an octagon, in the circle within
EXACT = 1e-9  # to which piqp solves, of residuals and of the gap between primal and dual
SLACK_M_S = 1e-8  # by which what is found without limits may miss them


class Mpc(AdaptiveCompFlc):
    """mpc: model predictive control with preview, on the identified law, within the limits of commands.

    Robots are predicted to when the command will act, as by adaptive-comp-flc. The commands of the
    next N = 20 frames are chosen to minimize

        sum over the ends of N frames of |e_p|^2 + sum over N frames of |w|^2 / k^2
        + |e_p + (lag / g) e_v|^2 / (2 k T)

    with w what is commanded besides the inverse of the law for the reference, which leaves no
    lasting error. The weight k is Bryson's, but for a factor: an error of 0.1 m (`error_range_m`)
    is as bad as a correction of 1.5 m/s (1.5 `speed_range_m_s`); k = 15/s is the gain of the fuzzy
    controller at zero error. The last term is what comes after: the error to which the last
    velocity would still lead, taken away at the rate k.

    Successive commands, of which the first follows the one sent last, change by no more than the
    limit of acceleration lets them, and go no faster along the way than that of speed.

    Where a quadratic program is not solved, which none of its kind should be, the command is not a
    number: the team then stops that robot, and says so. The heading is held as by
    adaptive-comp-flc.

    `channels["limits_active"]` is 1 for robots whose program was bound by limits.
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        stiffness = STIFFNESS * model.speed_range_m_s / model.error_range_m
        weights = np.append(np.full(FRAMES, stiffness**2), stiffness / (2 * model.period))
        self._weights = np.repeat(weights, 2)  # of errors, that of commands being 1

    def track(self, frame: int, observation: Observation, state: Array) -> Array:
        """See `InverseFlc`."""
        ekf, limits = self.filter, self.model.limits
        poses, twists = self.around(frame + ekf.latency, FRAMES)
        velocities, headings = self.expected(poses, twists, state)
        planned = ekf.dynamics.invert(ekf.state, velocities[:-1], velocities[1:], headings)
        error = state[:, POSE] - poses[1]
        late = state[:, VELOCITY] - velocities[0]
        free, effect = self._errors(poses[1:, :, :2], velocities, headings, error, late)

        weighed = (effect * self._weights[:, None]).swapaxes(1, 2)
        hessian = weighed @ effect + np.eye(2 * FRAMES)
        gradient = (weighed @ free[..., None])[..., 0]
        edges = velocities[:-1, :, :2]
        size = np.hypot(edges[..., 0], edges[..., 1])[..., None]
        directions = np.where(size > STILL_M_S, edges / np.maximum(size, STILL_M_S), [1.0, 0.0])
        disturbance = ekf.state[:, DISTURBANCE]
        step = limits.acceleration * self.model.period
        sent = planned[..., :2] - disturbance[:, :2]
        best, bound = minimize(
            hessian,
            gradient,
            Limits(
                observation.sent_commands.get_latest(1)[0, :, :2],
                sent,
                directions,
                step,
                limits.speed,
            ),
        )
        self.channels["limits_active"] = bound.astype(float)
        command = planned[0] - disturbance
        command[:, :2] += best[:, 0]
        command[:, 2] -= self.model.heading_gain * wrap_angle(error[:, 2])
        return command

    def _errors(
        self, positions: Array, velocities: Array, headings: Array, error: Array, late: Array
    ) -> tuple[Array, Array]:
        """Return how the errors of n robots depend on commands w in N frames, x and y one after the other.

        Args:
            positions: of the reference where frames meet, (N + 1, n, 2) m.
            velocities: same, (N + 1, n, 3) m/s.
            headings: expected in the middle of each frame, (N, n) rad.
            error: what the pose has more than the reference at the beginning, (n, 3).
            late: the same of the velocity, (n, 3).

        Returns:
            Errors without w (n, 2 N + 2), of the positions at the end of each frame and of the
            position to which the last velocity would still lead, m, and the effect of w on them (n,
            2 N + 2, 2 N), s.
        """
        ekf, period, n = self.filter, self.model.period, len(error)
        before, after = (
            world_to_body(velocities[:-1], headings),
            world_to_body(velocities[1:], headings),
        )
        speed = np.hypot(before[..., 0], before[..., 1])
        lag, gain = (
            ekf.dynamics.compute_time_constants(ekf.state, speed[..., None]),
            ekf.state[:, INVERSE_GAIN],
        )
        decay = np.exp(-period / lag)
        carried = (1 - decay) * lag
        towards = (after - decay * before) / (1 - decay)
        moved = body_to_world(period * towards + lag * (before - after), headings)[..., :2]
        missed = moved - np.diff(positions, axis=0)

        cosine, sine = np.cos(headings), np.sin(headings)
        rotation = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(*headings.shape, 2, 2)

        def world(scales: Array) -> Array:
            """Return the maps (N, n, 2, 2) that scale by (N, n, 2 or 3) along the body's axes."""
            return np.asarray((rotation * scales[..., None, :2]) @ rotation.swapaxes(-1, -2))

        onwards = np.tile(np.eye(5), (FRAMES, n, 1, 1))  # of e_p, e_v and 1
        onwards[..., :2, 2:4], onwards[..., 2:4, 2:4], onwards[..., :2, 4] = (
            world(carried),
            world(decay),
            missed,
        )
        driven = np.concatenate(
            [world((period - carried) / gain), world((1 - decay) / gain)], axis=-2
        )
        table = np.zeros(
            (FRAMES + 1, n, 5, 2 * FRAMES + 1)
        )  # by commands and, in the last column, without
        table[0, :, :2, -1], table[0, :, 2:4, -1], table[..., 4, -1] = (
            error[:, :2],
            late[:, :2],
            1.0,
        )
        for k in range(FRAMES):
            np.matmul(onwards[k], table[k], out=table[k + 1])
            table[k + 1, :, :4, 2 * k : 2 * k + 2] = driven[k]
        ends = table[-1, :, :2] + world(lag)[-1] @ table[-1, :, 2:4]
        errors = (
            np.concatenate([table[1:, :, :2], ends[None]])
            .swapaxes(0, 1)
            .reshape(n, 2 * FRAMES + 2, -1)
        )
        return errors[:, :, -1], errors[:, :, :-1]


class Limits(NamedTuple):
    """What commands of n robots must keep to, in N frames.

    Attributes:
        last: command sent before the first frame, (n, 2) m/s.
        planned: commands that w adds to, (N, n, 2) m/s.
        directions: unit vectors along the way, (N, n, 2).
        step: largest change from frame to frame, m/s.
        speed: highest, m/s.
    """

    last: Array
    planned: Array
    directions: Array
    step: float
    speed: float


def minimize(hessian: Array, gradient: Array, limits: Limits) -> tuple[Array, NDArray[np.bool_]]:
    """Return the best w of each robot, (n, N, 2), and which of them limits bind, (n,).

    Robots are solved one by one, each from the start, so that none depends on what others, or
    former frames, were. Where piqp says anything but solved, w is not a number.

    Args:
        hessian: H, (n, 2 N, 2 N), positive definite.
        gradient: c, (n, 2 N).
        limits: of the commands.
    """
    best: Array = -np.linalg.solve(hessian, gradient[..., None])[..., 0].astype(float)
    bound = np.zeros(len(best), bool)
    for robot in range(len(best)):
        rows, low, high = _rows(limits, robot)
        reached = rows @ best[robot]
        bound[robot] = ((reached < low - SLACK_M_S) | (reached > high + SLACK_M_S)).any()
        if bound[robot]:
            best[robot] = _solve(hessian[robot], gradient[robot], rows, low, high)
    return best.reshape(len(best), -1, 2), bound


def _rows(limits: Limits, robot: int) -> tuple[Array, Array, Array]:
    """Return rows (8 N, 2 N), and the bounds (8 N,) of rows w of one robot: of changes, then of speeds."""
    planned, directions = limits.planned[:, robot], limits.directions[:, robot]
    frames, last = len(planned), limits.last[robot]
    angles = np.arctan2(directions[:, 1], directions[:, 0])[:, None] + _NORMALS
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # (N, 4, 2)
    frame = np.arange(frames)
    speeds = np.zeros((frames, 4, frames, 2))
    speeds[frame, :, frame] = normals
    changes = speeds.copy()
    changes[frame[1:], :, frame[:-1]] = -normals[1:]
    sent = (normals @ planned[..., None])[..., 0]
    changed = (normals @ np.diff(planned, axis=0, prepend=last[None])[..., None])[..., 0]
    highest = np.maximum(_INNER * limits.speed, np.abs(normals @ last))
    most = np.concatenate([np.full(4 * frames, _INNER * limits.step), highest.ravel()])
    offset = np.concatenate([changed.ravel(), sent.ravel()])
    return np.concatenate([changes, speeds]).reshape(8 * frames, -1), -most - offset, most - offset


def _solve(hessian: Array, gradient: Array, rows: Array, low: Array, high: Array) -> Array:
    """Return the best w (2 N,) with `low` <= `rows` w <= `high`; not a number unless piqp says that it is."""
    import piqp  # here, since only who needs it must have it

    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = EXACT
    solver.settings.eps_duality_gap_abs = solver.settings.eps_duality_gap_rel = EXACT
    solver.setup(
        np.asfortranarray(hessian), gradient, None, None, np.asfortranarray(rows), low, high
    )
    solved = solver.solve() == piqp.PIQP_SOLVED
    return np.array(solver.result.x) if solved else np.full(len(gradient), np.nan)

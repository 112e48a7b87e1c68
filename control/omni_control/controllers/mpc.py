"""Model predictive control with preview: optimal commands for the next frames within the limits.

**Prediction.** Along each body axis `MotionModel` has a lag that depends on the speed. With the
reference's speed it is linear. The errors of position and velocity, e_p and e_v, in the world
frame, obey

    e_v(k+1) = D e_v(k) + G w(k)                 D = decay of a velocity in a frame, G = (1 - D) / g
    e_p(k+1) = e_p(k) + C e_v(k) + M w(k) + r    C = displacement during that decay, M = (T - C) / g

Here w is the correction of the command: the command minus the inverse of the model for the
reference. The inverse reaches the reference's velocities at the ends of each frame, but not its
positions: r is the position error that it causes in a frame. D, G, C, M act along the body axes;
they are rotated into the world frame with the heading that is expected in that frame.

**Quadratic programs.** Per robot: minimize w' H w / 2 + c' w over N corrections w, such that the
commands s = planned + w satisfy

    |s(k) - s(k-1)| <= max_step,  |s(k)| <= max_speed

Octagons replace the circles. Their corners lie on the circle, one of them in the direction of
travel, where the limits matter most. Half-way between corners they exclude 8 % of the radius. The
problem is always feasible, because repeating the last command is a solution: if that command lies
outside a side of the octagon of speeds, the side is moved out to it.

If the unconstrained minimum satisfies the limits, it is the solution, and is found by linear
equations. Otherwise piqp's interior point method finds the solution (R. Schwan, Y. Jiang, D. Kuhn
and C. N. Jones, IEEE CDC 2023).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_control.controllers.adaptive import AdaptiveCompFlc
from omni_control.controllers.base import Observation, TeamModel
from omni_control.estimation.motion_model import DISTURBANCE, INVERSE_GAIN, POSE, VELOCITY
from omni_control.kinematics import Array, body_to_world, world_to_body, wrap_angle
from omni_control.reference import Reference

# N: a third of a second, in which an error decays to exp(-15 / s * 0.33 s) = 0.7 %.
HORIZON_FRAMES = 20
# Speed ranges per error range: 15/s, the gain of the fuzzy controller at zero error.
RELATIVE_GAIN = 1.5
MIN_DIRECTION_SPEED_M_S = 0.01  # below this speed a reference has no direction
# Tolerance of piqp for residuals and for the gap between primal and dual.
SOLVER_TOLERANCE = 1e-9
CONSTRAINT_TOLERANCE_M_S = 1e-8  # allowed violation by an unconstrained solution
# Directions of the normals of half of an octagon's sides; the other sides are opposite.
_NORMAL_ANGLES = np.pi * (np.arange(4) / 4 + 1 / 8)
_INRADIUS = np.cos(np.pi / 8)  # of an octagon with circumradius 1


class Mpc(AdaptiveCompFlc):
    """mpc: model predictive control with preview, on the identified model, within command limits.

    The state at the time when the command will act is predicted as in adaptive-comp-flc. The
    commands of the next N = 20 frames minimize

        sum over the ends of N frames of |e_p|^2 + sum over N frames of |w|^2 / k^2
        + |e_p + (lag / g) e_v|^2 / (2 k T)

    Here w is the correction of the command. It does not cause a steady-state error. The weight k
    follows Bryson's rule, except for a factor: an error of 0.1 m (`error_range_m`) costs as much as
    a correction of 1.5 m/s (1.5 `speed_range_m_s`); k = 15/s is the gain of the fuzzy controller
    at zero error. The last term is the cost after the horizon: the position error to which the last
    velocity would lead, reduced at the rate k.

    The limits of acceleration and speed hold for all commands. The first one is compared with the
    last command sent.

    If a quadratic program is not solved, which should not happen, the command is NaN. The team then
    stops that robot and reports it. The heading is controlled as in adaptive-comp-flc.

    `channels["limits_active"]` is 1 for robots whose program was constrained by the limits.
    """

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
        gain = RELATIVE_GAIN * model.speed_range_m_s / model.error_range_m
        weights = np.append(np.full(HORIZON_FRAMES, gain**2), gain / (2 * model.period))
        self._error_weights = np.repeat(weights, 2)  # relative to that of corrections

    def track(self, frame: int, observation: Observation, state: Array) -> Array:
        """See `InverseFlc`."""
        ekf, limits = self.filter, self.model.limits
        poses, velocities, headings, planned = self.plan_commands(frame, HORIZON_FRAMES, state)
        pose_error = state[:, POSE] - poses[1]
        velocity_error = state[:, VELOCITY] - velocities[0]
        free_errors, sensitivity = self._predict_errors(
            *self._linearize(poses[1:, :, :2], velocities, headings), pose_error, velocity_error
        )

        weighted = (sensitivity * self._error_weights[:, None]).swapaxes(1, 2)
        hessian = weighted @ sensitivity + np.eye(2 * HORIZON_FRAMES)
        gradient = (weighted @ free_errors[..., None])[..., 0]
        disturbance = ekf.state[:, DISTURBANCE]
        constraints = CommandConstraints(
            observation.sent_commands.get_latest(1)[0, :, :2],
            planned[..., :2] - disturbance[:, :2],
            _compute_directions(velocities[:-1, :, :2]),
            limits.acceleration * self.model.period,
            limits.speed,
        )
        corrections, is_constrained = solve_quadratic_programs(hessian, gradient, constraints)
        self.channels["limits_active"] = is_constrained.astype(float)
        command = planned[0] - disturbance
        command[:, :2] += corrections[:, 0]
        command[:, 2] -= self.model.heading_gain * wrap_angle(pose_error[:, 2])
        return command

    def _linearize(
        self, positions: Array, velocities: Array, headings: Array
    ) -> tuple[Array, Array, Array]:
        """Return the linear dynamics of the errors of n robots, state [e_p, e_v, 1].

        Args:
            positions: Positions of the reference at the frame boundaries, (N + 1, n, 2) m.
            velocities: Velocities of the reference there, (N + 1, n, 3) m/s.
            headings: Expected headings in the middle of each frame, (N, n) rad.

        Returns:
            Transition matrices (N, n, 5, 5), effects of corrections on [e_p, e_v] (N, n, 4, 2), and
            map from the last velocity to its remaining displacement, (n, 2, 2) s.
        """
        ekf, period, n = self.filter, self.model.period, headings.shape[1]
        start = world_to_body(velocities[:-1], headings)
        end = world_to_body(velocities[1:], headings)
        tau = ekf.dynamics.compute_time_constants(ekf.state, start)  # lag / g
        inverse_gain = ekf.state[:, INVERSE_GAIN]
        decay = np.exp(-period / tau)
        coast_time = (1 - decay) * tau
        steady_velocity = (end - decay * start) / (1 - decay)
        displacement = body_to_world(period * steady_velocity + tau * (start - end), headings)
        residual = displacement[..., :2] - np.diff(positions, axis=0)

        cosine, sine = np.cos(headings), np.sin(headings)
        rotation = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(*headings.shape, 2, 2)

        def rotate_scales(scales: Array) -> Array:
            """Return maps (N, n, 2, 2) that scale by (N, n, 2 or 3) along the body axes."""
            return (rotation * scales[..., None, :2]) @ rotation.swapaxes(-1, -2)

        transition = np.tile(np.eye(5), (HORIZON_FRAMES, n, 1, 1))
        transition[..., :2, 2:4] = rotate_scales(coast_time)
        transition[..., 2:4, 2:4] = rotate_scales(decay)
        transition[..., :2, 4] = residual
        position_effect = rotate_scales((period - coast_time) / inverse_gain)
        velocity_effect = rotate_scales((1 - decay) / inverse_gain)
        correction_effect = np.concatenate([position_effect, velocity_effect], axis=-2)
        return transition, correction_effect, rotate_scales(tau)[-1]

    @staticmethod
    def _predict_errors(
        transition: Array,
        correction_effect: Array,
        stopping_time: Array,
        pose_error: Array,
        velocity_error: Array,
    ) -> tuple[Array, Array]:
        """Return the errors without corrections, and their sensitivity to corrections.

        Args:
            transition: See `_linearize`.
            correction_effect: See `_linearize`.
            stopping_time: See `_linearize`.
            pose_error: Initial pose minus reference, (n, 3).
            velocity_error: Initial velocity minus reference, (n, 3).

        Returns:
            Position errors (n, 2 N + 2), m, at the end of each frame, then the one to which the
            last velocity would lead; and their sensitivity (n, 2 N + 2, 2 N), s, to the corrections
            in N frames, x and y in turn.
        """
        n = len(pose_error)
        # State [e_p, e_v, 1] as an affine function of the corrections; the last column is constant.
        states = np.zeros((HORIZON_FRAMES + 1, n, 5, 2 * HORIZON_FRAMES + 1))
        states[0, :, :2, -1] = pose_error[:, :2]
        states[0, :, 2:4, -1] = velocity_error[:, :2]
        states[..., 4, -1] = 1.0
        for k in range(HORIZON_FRAMES):
            np.matmul(transition[k], states[k], out=states[k + 1])
            states[k + 1, :, :4, 2 * k : 2 * k + 2] = correction_effect[k]
        final_positions = states[-1, :, :2] + stopping_time @ states[-1, :, 2:4]
        positions = np.concatenate([states[1:, :, :2], final_positions[None]]).swapaxes(0, 1)
        errors = positions.reshape(n, 2 * HORIZON_FRAMES + 2, -1)
        return errors[:, :, -1], errors[:, :, :-1]


class CommandConstraints(NamedTuple):
    """Constraints on the commands of n robots in N frames.

    Attributes:
        last_command: Command sent before the first frame, (n, 2) m/s.
        planned: Commands to which the corrections w are added, (N, n, 2) m/s.
        directions: Unit vectors of the direction of travel, (N, n, 2).
        max_step: Largest change from frame to frame, m/s.
        max_speed: Largest speed, m/s.
    """

    last_command: Array
    planned: Array
    directions: Array
    max_step: float
    max_speed: float


def solve_quadratic_programs(
    hessian: Array, gradient: Array, constraints: CommandConstraints
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the optimal corrections (n, N, 2), and which robots the constraints affect, (n,).

    Robots are solved one by one without a warm start, so that no result depends on other robots or
    on earlier frames. An unsolved program yields NaN.

    Args:
        hessian: H, (n, 2 N, 2 N), positive definite.
        gradient: c, (n, 2 N).
        constraints: Constraints on the commands.
    """
    solutions = -np.linalg.solve(hessian, gradient[..., None])[..., 0].astype(float)
    is_constrained = np.zeros(len(solutions), bool)
    for robot in range(len(solutions)):
        matrix, lower, upper = _build_constraint_matrix(constraints, robot)
        values = matrix @ solutions[robot]
        is_violated = (values < lower - CONSTRAINT_TOLERANCE_M_S) | (
            values > upper + CONSTRAINT_TOLERANCE_M_S
        )
        is_constrained[robot] = is_violated.any()
        if is_constrained[robot]:
            solutions[robot] = _solve_with_piqp(
                hessian[robot], gradient[robot], matrix, lower, upper
            )
    return solutions.reshape(len(solutions), -1, 2), is_constrained


def _compute_directions(velocities: Array) -> Array:
    """Return unit vectors of velocities (..., 2); [1, 0] near standstill."""
    speed = np.hypot(velocities[..., 0], velocities[..., 1])[..., None]
    unit_vectors = velocities / np.maximum(speed, MIN_DIRECTION_SPEED_M_S)
    return np.where(speed > MIN_DIRECTION_SPEED_M_S, unit_vectors, [1.0, 0.0])


def _build_constraint_matrix(
    constraints: CommandConstraints, robot: int
) -> tuple[Array, Array, Array]:
    """Return A (8 N, 2 N) and bounds (8 N,) of lower <= A w <= upper of one robot.

    The first 4 N rows limit changes, the others speeds.
    """
    planned, directions = constraints.planned[:, robot], constraints.directions[:, robot]
    n_frames, last_command = len(planned), constraints.last_command[robot]
    angles = np.arctan2(directions[:, 1], directions[:, 0])[:, None] + _NORMAL_ANGLES
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # (N, 4, 2)
    frame = np.arange(n_frames)
    speed_rows = np.zeros((n_frames, 4, n_frames, 2))
    speed_rows[frame, :, frame] = normals
    change_rows = speed_rows.copy()
    change_rows[frame[1:], :, frame[:-1]] = -normals[1:]
    planned_speeds = (normals @ planned[..., None])[..., 0]
    planned_steps = np.diff(planned, axis=0, prepend=last_command[None])
    planned_changes = (normals @ planned_steps[..., None])[..., 0]
    max_speeds = np.maximum(_INRADIUS * constraints.max_speed, np.abs(normals @ last_command))
    max_changes = np.full(4 * n_frames, _INRADIUS * constraints.max_step)
    upper = np.concatenate([max_changes, max_speeds.ravel()])
    offset = np.concatenate([planned_changes.ravel(), planned_speeds.ravel()])
    matrix = np.concatenate([change_rows, speed_rows]).reshape(8 * n_frames, -1)
    return matrix, -upper - offset, upper - offset


def _solve_with_piqp(
    hessian: Array, gradient: Array, matrix: Array, lower: Array, upper: Array
) -> Array:
    """Return the optimal w (2 N,) with `lower` <= `matrix` w <= `upper`; NaN if unsolved."""
    import piqp  # optional: only users of this controller need it

    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = SOLVER_TOLERANCE
    solver.settings.eps_duality_gap_abs = SOLVER_TOLERANCE
    solver.settings.eps_duality_gap_rel = SOLVER_TOLERANCE
    solver.setup(
        np.asfortranarray(hessian), gradient, None, None, np.asfortranarray(matrix), lower, upper
    )
    is_solved = solver.solve() == piqp.PIQP_SOLVED
    return np.array(solver.result.x) if is_solved else np.full(len(gradient), np.nan)

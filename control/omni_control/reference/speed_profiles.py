"""Fastest speed along a closed path, from rest to rest after some laps.

The unknown is the squared speed z = v^2 as a function of the arc length s. With the curvature k,
the acceleration along the path is a_t = z'/2 and that across the path is a_n = k z.

**Integration in two passes.** The limit a of the total acceleration means

    |z'| <= 2 sqrt(a^2 - k^2 z^2)

Hence the angle arcsin(k z / a) between acceleration and path changes by at most 2 k ds. In a cell
of constant curvature, this has a closed solution. A forward pass accelerates as hard as the limits
allow, and a backward pass brakes as hard. The result is the highest possible speed everywhere
(Bobrow, Dubowsky and Gibson 1985; as two passes, Pham and Pham 2018).

**Linear program.** The limits of wheels are linear in the accelerations, and all accelerations are
linear in z and z'. This includes the turn acceleration k z'/2 + k' z of a robot that faces along
the path. The pointwise maximum of two feasible speed profiles is feasible. Hence one profile is
highest everywhere, and it takes the least time. Maximizing the sum of z finds it (as a convex
program, Verscheure and others 2009).
"""

import math
from itertools import cycle
from typing import NamedTuple

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.traction_limits import WheelLimits, max_over_neighbors

_N_SIDES = 32  # of the polygon inside the ellipse of accelerations; it is 0.5 % smaller
_N_SOLVED_LAPS = 3  # the first and last laps, and one that stands for all laps in between


def integrate_speed_profile(
    step: Array,
    curvature: Array,
    max_squared_speed: Array,
    limits: MotionLimits,
    laps: int,
    faces_along_path: bool,
) -> Array:
    """Return the highest squared speed at the ends of cells within all limits but those of wheels.

    Args:
        step: Lengths of the cells of one lap, (cells,) m.
        curvature: Absolute curvature at the ends of the cells, (cells + 1,) 1/m, above 0.
        max_squared_speed: Squared limit of the speed in each cell, (cells,) m^2/s^2.
        limits: Limits of acceleration, turn rate and turn acceleration.
        laps: Number of laps.
        faces_along_path: Whether the robot faces along the path. Otherwise it does not turn.

    Returns:
        Squared speeds (laps * cells + 1,), m^2/s^2.
    """
    a = limits.acceleration
    turn_rate = limits.turn_rate if faces_along_path else np.inf
    turn_acceleration = limits.turn_acceleration if faces_along_path else np.inf
    # Facing along the path, a_n is sideways. Times this weight, it has the same limit as a_t.
    side_weight = limits.acceleration_ratio if faces_along_path else 1.0
    cell_curvature = (curvature[:-1] + curvature[1:]) / 2
    side_curvature = side_weight * cell_curvature
    # In a cell, the path turns by k ds. The angle of the acceleration changes by at most
    # 2 k ds side_weight, and the squared turn rate k^2 z by at most 2 k ds turn_acceleration.
    double_turn = 2 * cell_curvature * step

    # Facing along the path, the turn acceleration is k a_t + (k'/k) a_n. Its limit allows a strip
    # about the origin of the plane of a_t and weighted a_n. The acceleration must also lie in a
    # circle of radius a. If the strip cuts off the top of the circle (a_t = 0, a_n = a), the
    # largest a_n is at the corner where the edge of the strip meets the circle.
    turn_per_lateral = np.abs(np.diff(curvature)) / (step * cell_curvature) / side_weight
    normal_length = np.hypot(cell_curvature, turn_per_lateral)
    half_width = np.minimum(turn_acceleration / (a * normal_length), 1)  # of the strip, over a
    # Angle from the top to the corner; negative if the top is inside the strip.
    corner_angle = np.arccos(half_width) - np.arctan2(cell_curvature, turn_per_lateral)
    max_lateral = a * np.cos(np.maximum(corner_angle, 0))

    max_z = np.minimum(max_lateral / side_curvature, max_squared_speed)
    max_z = np.tile(np.minimum(max_z, (turn_rate / cell_curvature) ** 2), laps)
    max_z = np.concatenate([[0], np.minimum(max_z[:-1], max_z[1:]), [0]])
    coefficients = np.stack(
        [side_curvature / a, side_weight * double_turn, turn_acceleration * double_turn]
    )
    forward = _accelerate(max_z, coefficients, curvature)
    return _accelerate(forward[::-1], coefficients[:, ::-1], curvature[::-1])[::-1]


def _accelerate(max_z: Array, coefficients: Array, curvature: Array) -> Array:
    """Return the highest squared speeds (laps * cells + 1,) that a forward pass can reach.

    At each cell end, this is the highest squared speed up to `max_z` that acceleration from the
    previous cell end can reach.

    Args:
        max_z: Upper bounds of the squared speeds, (laps * cells + 1,) m^2/s^2.
        coefficients: For each cell, (3, cells): the ratio k / a of the sine of the acceleration's
            angle to the squared speed, s^2/m^2; the largest change of this angle, rad; and the
            largest gain of the squared turn rate, rad^2/s^2. A factor on k is part of the ratio.
        curvature: Absolute curvature at the ends of the cells, (cells + 1,) 1/m.
    """
    scales, rotations, turn_gains = coefficients
    decays, gains = (curvature[:-1] / curvature[1:]) ** 2, turn_gains / curvature[1:] ** 2
    lap = np.stack([scales, rotations, decays, gains], axis=1).tolist()
    z = float(max_z[0])
    squared_speeds = [z]
    right_angle = math.pi / 2
    # A loop over Python's floats, because each cell depends on the previous one. Comparisons
    # instead of `min` save a third of its time.
    bounds = zip(max_z[1:].tolist(), cycle(lap), strict=False)
    for bound_z, (scale, rotation, decay, gain) in bounds:
        sine = scale * z
        angle = math.asin(sine) + rotation if sine < 1 else right_angle
        max_reachable = (math.sin(angle) if angle < right_angle else 1.0) / scale
        z = decay * z + gain  # the highest within the limit of turn acceleration
        if max_reachable < z:
            z = max_reachable
        if bound_z < z:
            z = bound_z
        squared_speeds.append(z)
    return np.array(squared_speeds)


class ClosedPath(NamedTuple):
    """Cells of a closed path.

    With the squared speed z, the body acceleration is `twist` z'/2 + `twist_slope` z.

    Args:
        step: Lengths of the cells, (cells,) m.
        twist: Body twist per speed, (3, cells).
        twist_slope: Derivative of the twist by arc length, differentiated in the world frame and
            expressed in body axes, (3, cells).
    """

    step: Array
    twist: Array
    twist_slope: Array


def solve_speed_profile_on_wheels(
    path: ClosedPath, limits: MotionLimits, wheels: WheelLimits, capacity: float, laps: int
) -> Array:
    """Return the highest squared speed at the ends of cells within all limits except jerk.

    Args:
        path: Cells of one lap.
        limits: Limits of velocity and acceleration.
        wheels: Limits of the wheels.
        capacity: Usable fraction of the wheels' friction, to which drag counts, and of their
            highest rim speed.
        laps: Number of laps.

    Returns:
        Squared speeds (laps * cells + 1,), m^2/s^2.

    Raises:
        OmniError: The linear program has no solution.
    """
    # Imported here, because it takes longer than all other imports together.
    from scipy.optimize import linprog
    from scipy.sparse import diags_array, vstack

    rows, bounds, max_z = _make_constraints(path, limits, wheels, capacity)
    per_difference = rows @ path.twist / (2 * path.step)
    per_sum = rows @ path.twist_slope / 2
    solved_laps, n_cells = min(laps, _N_SOLVED_LAPS), len(path.step)
    n = solved_laps * n_cells
    # Each constraint holds in the middle of a cell, with z' = (z_end - z_start) / step and
    # z = (z_start + z_end) / 2. It couples the z at both ends.
    at_start, at_end = np.tile([per_sum - per_difference, per_sum + per_difference], solved_laps)
    matrix = vstack(
        [
            diags_array(ends, offsets=(0, 1), shape=(n, n + 1))
            for ends in zip(at_start, at_end, strict=True)
        ]
    )
    max_z = np.tile(max_z, solved_laps)
    max_z = np.concatenate([[0], np.minimum(max_z[:-1], max_z[1:]), [0]])
    z_range = np.stack([0 * max_z, max_z], axis=1)
    result = linprog(-np.ones(n + 1), matrix, np.tile(bounds, solved_laps).ravel(), bounds=z_range)
    if not result.success:
        raise OmniError(f"found no speed profile within the limits of the wheels: {result.message}")
    z = np.maximum(result.x, 0)
    # All middle laps are the second of three solved laps, which begins and ends at nearly the same
    # speed.
    middle_laps = [z[n_cells : 2 * n_cells]] * (laps - solved_laps)
    return np.concatenate([z[:n_cells], *middle_laps, z[n_cells:]])


def _make_constraints(
    path: ClosedPath, limits: MotionLimits, wheels: WheelLimits, capacity: float
) -> tuple[Array, Array, Array]:
    """Return linear constraints on body accelerations [ax, ay, turn acceleration] in each cell.

    Returns:
        rows (constraints, 3) and bounds (constraints, cells), such that
        rows @ acceleration <= bounds; and the highest squared speeds (cells,), m^2/s^2.
    """
    angles = 2 * np.pi * np.arange(_N_SIDES) / _N_SIDES
    side = limits.side_acceleration or limits.acceleration
    ellipse = np.stack(
        [np.cos(angles) / limits.acceleration, np.sin(angles) / side, 0 * angles], axis=1
    )
    turning = np.array([[0, 0, 1], [0, 0, -1]]) / limits.turn_acceleration
    twist = np.ascontiguousarray(path.twist.T)
    friction_rows, drag = wheels.get_friction_constraints(twist)
    n_cells = len(twist)
    bounds = [
        np.full((_N_SIDES, n_cells), np.cos(np.pi / _N_SIDES)),
        np.ones((2, n_cells)),
        capacity - max_over_neighbors(drag, "wrap").T,
    ]
    rows = np.concatenate([ellipse, turning, friction_rows])
    rim_speed = wheels.compute_rim_speeds(twist).max(1)
    turn_time = np.abs(twist[:, 2]) / limits.turn_rate
    min_time = np.maximum(turn_time, rim_speed / (capacity * wheels.max_rim_speed))  # per m
    return rows, np.concatenate(bounds), np.maximum(min_time, 1 / limits.speed) ** -2.0

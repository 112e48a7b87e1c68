"""Fastest speed along a closed path, from rest to rest after some laps.

**In the phase plane.** With z = v^2, v the speed and s the arc length, the acceleration along the
path is z'/2 and that across it k z, with k the curvature. A limit a of the total acceleration
leaves |z'| <= 2 sqrt(a^2 - k^2 z^2). Hence the angle arcsin(k z / a), by which the acceleration
points away from the path, changes by at most 2 k ds. Where k hardly changes, steps along the path
have a closed form. A forward pass accelerates as hard as this allows, and a backward pass brakes as
hard. The result is the highest possible speed everywhere (Bobrow, Dubowsky and Gibson 1985; as two
passes, Pham and Pham 2018).

**As a linear program.** Combined limits of wheels are linear in the accelerations. These are linear
in z, also the turn acceleration k z'/2 + k' z of a robot that faces along the path. Of two
drives within such limits, the faster of both at each position keeps them too. One drive therefore
has the highest z everywhere, and none takes less time (as a convex program, Verscheure and others
2009).
"""

import math
from itertools import cycle
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.traction import WheelLimits, max_over_neighbors

_N_SIDES = 32  # of the polygon inside the ellipse of accelerations, which is 0.5 % smaller
_N_SOLVED_LAPS = 3  # the first, the last, and one for all laps between them


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
        step: Lengths of the cells, (cells,) m.
        curvature: Absolute curvature at their ends, (cells + 1,) 1/m, above 0.
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
    # Weight of the acceleration across the path, which limits turn into that along it.
    side_weight = limits.acceleration_ratio if faces_along_path else 1.0
    cell_curvature = (curvature[:-1] + curvature[1:]) / 2
    side_curvature = side_weight * cell_curvature
    # From one end of a cell to the other, the angle of the acceleration changes by up to twice the
    # angle by which the path turns, times `side_weight`. The square of the turn rate changes by up
    # to twice that angle times the turn acceleration.
    double_turn = 2 * cell_curvature * step

    # Facing along the path, the turn acceleration is k times the acceleration along it plus k'/k
    # times that across it. Its limits cut a strip out of the circle of radius a in which the
    # acceleration must stay. Where the top of the circle (all acceleration across the path) is cut
    # off, the highest point that is left is the corner, at this angle from the top.
    slope = np.abs(np.diff(curvature)) / (step * cell_curvature) / side_weight
    strip = np.minimum(turn_acceleration / (a * np.hypot(cell_curvature, slope)), 1)
    corner = np.arccos(strip) - np.arctan2(cell_curvature, slope)
    max_lateral = a * np.cos(np.maximum(corner, 0))

    max_z = np.minimum(max_lateral / side_curvature, max_squared_speed)
    max_z = np.tile(np.minimum(max_z, (turn_rate / cell_curvature) ** 2), laps)
    max_z = np.concatenate([[0], np.minimum(max_z[:-1], max_z[1:]), [0]])
    coefficients = np.stack(
        [side_curvature / a, side_weight * double_turn, turn_acceleration * double_turn]
    )
    forward = _accelerate(max_z, coefficients, curvature)
    return _accelerate(forward[::-1], coefficients[:, ::-1], curvature[::-1])[::-1]


def _accelerate(max_z: Array, coefficients: Array, curvature: Array) -> Array:
    """Return the highest squared speeds (laps * cells + 1,) that acceleration can reach.

    Args:
        max_z: Upper bounds of the squared speeds.
        coefficients: For each cell (3, cells): the sine of the acceleration's angle from the path
            over the squared speed, s^2/m^2; the largest change of this angle, rad; and the largest
            gain of the squared turn rate, rad^2/s^2.
        curvature: Absolute curvature at the ends of the cells, (cells + 1,) 1/m.
    """
    scales, rotations, turn_gains = coefficients
    decays, gains = (curvature[:-1] / curvature[1:]) ** 2, turn_gains / curvature[1:] ** 2
    lap = np.stack([scales, rotations, decays, gains], axis=1).tolist()
    z = float(max_z[0])
    squared_speeds = [z]
    right_angle = math.pi / 2
    # Python's floats, since each cell depends on the one before. With `min` of the three speeds,
    # the loop would take half as long again.
    bounds = zip(max_z[1:].tolist(), cycle(lap), strict=False)
    for bound_z, (scale, rotation, decay, gain) in bounds:
        sine = scale * z
        angle = math.asin(sine) + rotation if sine < 1 else right_angle
        on_circle = (math.sin(angle) if angle < right_angle else 1.0) / scale
        z = decay * z + gain
        if on_circle < z:
            z = on_circle
        if bound_z < z:
            z = bound_z
        squared_speeds.append(z)
    return np.array(squared_speeds)


class ClosedPath(NamedTuple):
    """Cells of a closed path.

    The body acceleration is `twist` z'/2 + `twist_slope` z, with z the squared speed.

    Args:
        step: Lengths of the cells, (cells,) m.
        twist: Body twist per speed, (3, cells).
        twist_slope: Its change along the path in world axes, seen in the body frame, (3, cells).
    """

    step: Array
    twist: Array
    twist_slope: Array


def solve_speed_profile_on_wheels(
    path: ClosedPath, limits: MotionLimits, wheels: WheelLimits, capacity: float, laps: int
) -> Array:
    """Return the highest squared speed at the ends of cells within all limits but those of jerk.

    Args:
        path: The path.
        limits: Limits of velocity and acceleration.
        wheels: Limits of the wheels.
        capacity: Fraction of the friction, drag included, and of the rim speed that may be used.
        laps: Number of laps.

    Returns:
        Squared speeds (laps * cells + 1,), m^2/s^2.
    """
    # Imported here, since it takes longer than all other imports together.
    from scipy.optimize import linprog
    from scipy.sparse import diags_array, vstack

    rows, bounds, max_z = _make_constraints(path, limits, wheels, capacity)
    per_slope = rows @ path.twist / (2 * path.step)
    per_z = rows @ path.twist_slope / 2
    solved_laps, n_cells = min(laps, _N_SOLVED_LAPS), len(path.step)
    n = solved_laps * n_cells
    # Each constraint couples the z at both ends of a cell.
    at_start, at_end = np.tile([per_z - per_slope, per_z + per_slope], solved_laps)
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
    z = np.maximum(result.x, 0)
    middle_laps = [z[n_cells : 2 * n_cells]] * (laps - solved_laps)
    return np.concatenate([z[:n_cells], *middle_laps, z[n_cells:]])


def _make_constraints(
    path: ClosedPath, limits: MotionLimits, wheels: WheelLimits, capacity: float
) -> tuple[Array, Array, Array]:
    """Return linear constraints on body accelerations [ax, ay, turn acceleration] in each cell.

    Returns:
        rows (constraints, 3) and bounds (constraints, cells): rows @ acceleration <= bounds; and
        the highest squared speeds (cells,), m^2/s^2.
    """
    angles = 2 * np.pi * np.arange(_N_SIDES) / _N_SIDES
    side = limits.side_acceleration or limits.acceleration
    x, y = np.cos(angles) / limits.acceleration, np.sin(angles) / side
    ellipse = np.stack([x, y, 0 * angles], axis=1)
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

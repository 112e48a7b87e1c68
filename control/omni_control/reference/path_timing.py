"""Fastest timing of a path from rest to rest, within all limits except jerk.

The unknown is the squared rate z = (du/dt)^2 of the path parameter u. The acceleration of the body
is p' z'/2 + p'' z, with the derivatives p' and p'' of the pose by u in body axes. It is limited by
an ellipse (translation) and by linear constraints (turning and wheels), which hold in the middle of
each cell. There, z is the mean of the values at both ends, and z' is their difference over the
length of the cell.

A backward pass brakes as hard as the limits allow, and a forward pass accelerates as hard. The
result is the highest speed everywhere (Bobrow, Dubowsky and Gibson 1985; with linear constraints,
TOPP-RA by Pham and Pham 2018).
"""

import math
from collections.abc import Callable
from itertools import cycle
from typing import NamedTuple

import numpy as np

from omni_control.kinematics import Array, world_to_body
from omni_control.reference.motion_limits import MotionLimits
from omni_control.traction_limits import WheelLimits, max_over_neighbors

_N_BISECTIONS = 24
_TINY = 1e-30  # avoids division by zero


class ParametricPath(NamedTuple):
    """Poses as a smooth function of a parameter u, from u = 0.

    Args:
        get_poses: Function from parameters (n,) to poses (n, 3).
        lap: Range of u in one lap.
        n_cells: Number of cells per lap, of equal range of u, for which the timing is planned.
        laps: Number of laps.
    """

    get_poses: Callable[[Array], Array]
    lap: float
    n_cells: int
    laps: int = 1


class PathTiming:
    """Parameter u of a path over time. Between samples, du/dt is linear in time.

    Args:
        u: Parameters of the samples, (n,).
        rate: du/dt at the samples, (n,) 1/s.

    Attributes:
        time: Times of the samples, (n,) s.
    """

    def __init__(self, u: Array, rate: Array) -> None:
        self._u = u
        self._rate = rate
        self.time = np.append(0.0, np.cumsum(2 * np.diff(u) / (rate[:-1] + rate[1:])))

    def get_parameter(self, time: Array) -> Array:
        """Return the parameters (frames,) at times (frames,)."""
        i = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        elapsed = time - self.time[i]
        fraction = elapsed / (self.time[i + 1] - self.time[i])
        rate = self._rate[i]
        mean_rate = rate + fraction * (self._rate[i + 1] - rate) / 2  # since sample i
        return self._u[i] + elapsed * mean_rate


def plan_timing(
    path: ParametricPath,
    limits: MotionLimits,
    wheels: WheelLimits | None = None,
    capacity: float = 1.0,
) -> PathTiming:
    """Return the fastest timing of a path within all limits except jerk.

    Args:
        path: Path from rest to rest.
        limits: Limits of velocity and acceleration.
        wheels: Limits of the wheels. Default: none.
        capacity: Usable fraction of the wheels' friction, to which drag counts, and of their
            highest rim speed.
    """
    # The ends of cells and their middles, in turn.
    u, half_step = np.linspace(0, path.lap, 2 * path.n_cells + 1, retstep=True)
    poses = path.get_poses(u)
    derivative = np.gradient(poses, half_step, axis=0, edge_order=2)
    second_derivative = np.gradient(derivative, half_step, axis=0, edge_order=2)
    derivatives = world_to_body(np.stack([derivative, second_derivative]), poses[:, 2])
    per_slope, per_z = _compute_demands(derivatives[:, 1::2], limits, wheels, capacity)
    per_difference = per_slope / (4 * half_step)
    per_start = per_z / 2 - per_difference
    per_end = per_z / 2 + per_difference
    max_z = _compute_max_z(derivatives[0, ::2], limits, wheels, capacity)
    with np.errstate(divide="ignore", invalid="ignore"):
        max_z[:-1] = _find_max_feasible(max_z[:-1], per_start, per_end)
        max_z[1:] = _find_max_feasible(max_z[1:], per_end, per_start)
        forward = _compute_reach(per_start, per_end)
        backward = _compute_reach(per_end[:, ::-1], per_start[:, ::-1])

    max_z[0] = min(max_z[0], max_z[-1])
    max_z = np.append(np.tile(max_z[:-1], path.laps), 0.0)
    max_z[0] = 0
    z = _accelerate(max_z[::-1], backward)[::-1]
    z = _accelerate(z, forward)
    u = 2 * half_step * np.arange(len(z))
    # In the first and the last cell, z is constant after and before a ramp.
    rest = np.zeros(path.n_cells)
    first_ramp = z[1] / forward.compute_highest(rest)[0]
    last_ramp = z[-2] / backward.compute_highest(rest)[0]
    u = np.insert(u, [1, -1], [first_ramp * u[1], u[-1] - last_ramp * u[1]])
    return PathTiming(u, np.sqrt(np.insert(z, [1, -1], z[[1, -2]])))


def _compute_max_z(
    twist: Array, limits: MotionLimits, wheels: WheelLimits | None, capacity: float
) -> Array:
    """Return the highest z (ends,) within the limits of velocity.

    Args:
        twist: Body twists at the ends of cells, per rate, (ends, 3).
        limits: See `plan_timing`.
        wheels: See `plan_timing`.
        capacity: See `plan_timing`.
    """
    speed = np.hypot(twist[:, 0], twist[:, 1])
    slowness = np.maximum(speed / limits.speed, np.abs(twist[:, 2]) / limits.turn_rate)
    if wheels is not None:
        rim_speed = wheels.compute_rim_speeds(twist).max(1)
        slowness = np.maximum(slowness, rim_speed / (capacity * wheels.max_rim_speed))
    return slowness**-2.0


def _compute_demands(
    derivatives: Array, limits: MotionLimits, wheels: WheelLimits | None, capacity: float
) -> Array:
    """Return the fractions of limits that accelerations need, (2, 2 + constraints, cells).

    The norm of the first two is at most 1: the acceleration forward and sideways. Each of the
    others is at most 1.

    Args:
        derivatives: First and second derivatives of poses in the middle of cells, body axes,
            (2, cells, 3). The first is also the direction of the twist, which determines the drag.
        limits: See `plan_timing`.
        wheels: See `plan_timing`.
        capacity: See `plan_timing`.
    """
    side = limits.side_acceleration or limits.acceleration
    turn = limits.turn_acceleration
    rows = np.array(
        [[1 / limits.acceleration, 0, 0], [0, 1 / side, 0], [0, 0, 1 / turn], [0, 0, -1 / turn]]
    )
    demands = derivatives @ rows.T
    if wheels is not None:
        faces, drag = wheels.get_friction_constraints(derivatives[0])
        friction_demands = derivatives @ faces.T / (capacity - max_over_neighbors(drag))
        demands = np.concatenate([demands, friction_demands], axis=2)
    return demands.transpose(0, 2, 1)


class _Reach(NamedTuple):
    """Upper bounds of z at the far end of each cell, as functions of z at the near end.

        far_z <= shift z + sqrt(square - bend z^2),    far_z <= offset + slope z

    Args:
        shift, square, bend: Of the ellipse, (cells,).
        offset, slope: Of the linear constraints that are upper bounds, (constraints, cells).
    """

    shift: Array
    square: Array
    bend: Array
    offset: Array
    slope: Array

    def compute_highest(self, z: Array) -> Array:
        """Return the highest z at the far ends, (cells,); NaN outside the ellipse."""
        highest = self.shift * z + np.sqrt(self.square - self.bend * z * z)
        return np.minimum(highest, (self.offset + self.slope * z).min(0, initial=np.inf))


def _compute_reach(per_near: Array, per_far: Array) -> _Reach:
    """Return the reach of cells with demands per z at the near and far ends.

    Args:
        per_near: Demands per z at the near end, (2 + constraints, cells).
        per_far: Demands per z at the far end.
    """
    near, near_lines = np.split(per_near, [2])
    far, far_lines = np.split(per_far, [2])
    square = 1 / ((far**2).sum(0) + _TINY)
    shift = -square * (near * far).sum(0)
    bend = square * (near**2).sum(0) - shift**2
    is_upper = far_lines > _TINY
    offset = np.where(is_upper, 1 / far_lines, np.inf)
    slope = np.where(is_upper, -near_lines / far_lines, 0.0)
    is_used = is_upper.any(1)
    return _Reach(shift, square, bend, offset[is_used], slope[is_used])


def _find_max_feasible(max_z: Array, per_near: Array, per_far: Array) -> Array:
    """Return the highest z (cells,) at near ends from which a far z >= 0 is within all limits.

    Args:
        max_z: Upper bounds, (cells,).
        per_near: Demands per z at the near end, (2 + constraints, cells).
        per_far: Demands per z at the far end.
    """
    highest = _compute_reach(per_near, per_far)
    lowest = _compute_reach(per_near, -per_far)  # of the negative
    low = np.zeros_like(max_z)
    high = np.fmin(max_z, np.sqrt(highest.square / highest.bend))
    for _ in range(_N_BISECTIONS):
        z = (low + high) / 2
        lowest_far_z = np.maximum(-lowest.compute_highest(z), 0)
        is_feasible = highest.compute_highest(z) >= lowest_far_z
        low = np.where(is_feasible, z, low)
        high = np.where(is_feasible, high, z)
    return low


def _accelerate(max_z: Array, reach: _Reach) -> Array:
    """Return the highest z (ends,) that can be reached from rest at the first end."""
    z = 0.0
    reached = [z]
    cells = zip(*[column.T.tolist() for column in reach], strict=True)
    # A loop over Python's floats, because each cell depends on the previous one. Comparisons
    # instead of `min` save a third of its time.
    laps = zip(max_z[1:].tolist(), cycle(cells), strict=False)
    for bound_z, (shift, square, bend, offsets, slopes) in laps:
        root = square - bend * z * z
        far_z = shift * z
        if root > 0:
            far_z += math.sqrt(root)
        for offset, slope in zip(offsets, slopes, strict=True):
            line = offset + slope * z
            if line < far_z:
                far_z = line
        z = bound_z if bound_z < far_z else far_z
        reached.append(z)
    return np.array(reached)

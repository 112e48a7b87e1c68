"""The fastest drive along a curve where wheels cannot do at once what each limit allows: a linear program.

With z = v^2 the acceleration along a path is z'/2 and that across it k z, k being the curvature, and a robot that faces
along it turns with k z'/2 + k' z: what is linear in accelerations is linear in z. Of two drives within such limits, the
faster of both at each place keeps them too, so that one has the most z everywhere, and none takes less time (Bobrow,
Dubowsky and Gibson 1985; as a convex program, Verscheure and others 2009).
"""

from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.traction import WheelLimits, max_over_neighbors

_SIDES = 32  # of the polygon inside the ellipse of accelerations, which is 0.5 % smaller
_FEW = 3  # laps: the first, the last, and one for all between them


@dataclass(frozen=True)
class Lap:
    """Cells of a closed path.

    Args:
        step: their lengths (cells,), m.
        towards: where the path leads, in the axes of the body, unit vectors (cells, 2).
        bend: its curvature (cells,), 1/m, to the left positive.
        growth: how that changes along it (cells,), 1/m^2.
        turns: whether the robot turns with the path.
    """

    step: Array
    towards: Array
    bend: Array
    growth: Array
    turns: bool


def fastest(lap: Lap, limits: MotionLimits, wheels: WheelLimits, share: float, laps: int) -> Array:
    """Highest squares of speed (laps * cells + 1,), m^2/s^2, where cells meet, from rest to rest.

    All limits hold but those of jerk, and of what wheels can do so large a share is asked: more
    than what drags them.
    """
    # Here, since it takes longer to import than all else together.
    from scipy.optimize import linprog
    from scipy.sparse import diags_array, vstack

    rows, most, top = _bounds(lap, limits, wheels, share)
    x, y = lap.towards.T
    along = rows @ [x, y, lap.bend * lap.turns] / (2 * lap.step)
    across = rows @ [-lap.bend * y, lap.bend * x, lap.growth * lap.turns] / 2
    few, cells = min(laps, _FEW), len(lap.step)
    n = few * cells
    each = zip(np.tile(across - along, few), np.tile(across + along, few), strict=True)
    matrix = vstack([diags_array(pair, offsets=(0, 1), shape=(n, n + 1)) for pair in each])
    highest = np.tile(top, few)
    highest = np.concatenate([[0], np.minimum(highest[:-1], highest[1:]), [0]])
    between = np.stack([0 * highest, highest], axis=1)
    found = linprog(-np.ones(n + 1), matrix, np.tile(most, few).ravel(), bounds=between)
    z = np.maximum(found.x, 0)
    return np.concatenate([z[:cells], *[z[cells : 2 * cells]] * (laps - few), z[cells:]])


def _bounds(
    lap: Lap, limits: MotionLimits, wheels: WheelLimits, share: float
) -> tuple[Array, Array, Array]:
    """Rows (limits, 3) of which each times [ax, ay, turn acceleration] is at most (limits, cells), and z (cells,)."""
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    side = limits.side_acceleration or limits.acceleration
    ellipse = np.stack(
        [np.cos(angles) / limits.acceleration, np.sin(angles) / side, 0 * angles], axis=1
    )
    turning = np.array([[0, 0, 1], [0, 0, -1]]) / limits.turn_acceleration
    travel = np.column_stack([lap.towards, lap.bend * lap.turns])
    faces, dragged = wheels.get_friction_constraints(travel)
    rows = np.concatenate([ellipse, turning, faces])
    ones = np.ones(len(lap.step))
    most = [
        *np.repeat([np.cos(np.pi / _SIDES) * ones], _SIDES, axis=0),
        ones,
        ones,
        *(share - max_over_neighbors(dragged, "wrap").T),
    ]
    turn_rate = np.abs(travel[:, 2])
    slowest = np.maximum(
        turn_rate / limits.turn_rate,
        wheels.compute_rim_speeds(travel).max(1) / (share * wheels.max_rim_speed),
    )
    return rows, np.array(most), np.maximum(slowest, 1 / limits.speed) ** -2.0

"""Timed references along smooth closed curves, as fast as the limits allow.

If a robot accelerates less sideways than forward, the limit of its acceleration is an ellipse. If
it faces along the path, the acceleration across the path gets a higher weight (`speed_profiles`).
If its heading is constantly 0, the plane is stretched in y until the ellipse is a circle. The
timing is then computed for the stretched curve.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from omni_control.arguments import check_types, explain_types
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.sampled_reference import SampledReference, check_period
from omni_control.reference.speed_profiles import (
    ClosedPath,
    integrate_speed_profile,
    solve_speed_profile_on_wheels,
)
from omni_control.reference.time_scaling import PathTiming, sample_path, slow_down_for_wheels
from omni_control.traction_limits import WheelLimits

# Cells per lap, times the aspect ratio of the curve: elongated curves have sharper bends.
_N_CELLS = 1000
_N_PROGRAM_CELLS = 300  # same for the linear program, but at most _N_CELLS in total
_MIN_CURVATURE = 1e-9  # 1/m, avoids division by zero on straights


@dataclass(frozen=True)
class Curve:
    """Lissajous figure about the origin, for parameters u from 0 to 2 pi.

        x = length / 2 sin(u),  y = width / 2 sin(cycles u + phase)

    Args:
        length, width: Extent in x and y, above 0 m.
        cycles: Number of oscillations in y during one oscillation in x.
        phase: Phase of y at u = 0, rad.
    """

    length: float
    width: float
    cycles: int
    phase: float

    def __call__(self, u: Array, derivative: int = 0) -> Array:
        """Return points (n, 2) at parameters u (n,), or their derivative by u of some order, m."""
        phase = derivative * np.pi / 2
        x = self.length / 2 * np.sin(u + phase)
        y = self.cycles**derivative * np.sin(self.cycles * u + self.phase + phase)
        return np.stack([x, self.width / 2 * y], axis=-1)


CURVES: dict[str, Callable[[float, float], Curve]] = {
    "circle": partial(Curve, cycles=1, phase=-np.pi / 2),  # an ellipse if length and width differ
    "figure-eight": partial(Curve, cycles=2, phase=0.0),  # the lemniscate of Gerono
}


class CurveReference(SampledReference):
    """Laps of a closed curve from rest to rest, as fast as the limits allow, in whole frames.

    Args:
        curve: Curve; the drive starts at u = 0.
        limits: Motion limits. The limit of the acceleration applies to the vector sum of the
            accelerations along and across the path.
        period: Length of a frame, s.
        laps: Number of laps, at least one.
        faces_along_path: Whether the robot faces along its path, within its limits of turning.
            Otherwise its heading is 0.
    """

    @explain_types
    @check_types
    def __init__(
        self,
        curve: Curve,
        limits: MotionLimits,
        period: float,
        laps: int = 1,
        faces_along_path: bool = False,
    ) -> None:
        path = partial(_get_poses, curve, faces_along_path)
        poses = sample_path(
            path, _plan_timing(curve, limits, laps, faces_along_path), limits, check_period(period)
        )
        plan_timing = partial(_plan_timing_on_wheels, curve, limits, laps, faces_along_path)
        poses = slow_down_for_wheels(poses, path, plan_timing, limits, period)
        super().__init__(poses, period)


def _plan_timing(
    curve: Curve, limits: MotionLimits, laps: int, faces_along_path: bool
) -> PathTiming:
    """Return the fastest timing of the laps within the limits of velocity and acceleration."""
    # The curve in coordinates in which the limit of the acceleration is a circle.
    isotropic = (
        curve if faces_along_path else replace(curve, width=limits.acceleration_ratio * curve.width)
    )
    n_cells = _N_CELLS * _ceil_aspect_ratio(isotropic)
    u, step, arc_rate, curvature = _measure_cells(isotropic, n_cells)
    speed = limits.speed * (arc_rate / np.abs(_to_complex(curve(u, 1))))
    squared_speed = integrate_speed_profile(
        step,
        np.maximum(np.abs(curvature), _MIN_CURVATURE),
        np.minimum(speed[:-1], speed[1:]) ** 2,
        limits,
        laps,
        faces_along_path,
    )
    return _make_timing(squared_speed, arc_rate)


def _plan_timing_on_wheels(
    curve: Curve,
    limits: MotionLimits,
    laps: int,
    faces_along_path: bool,
    wheels: WheelLimits,
    capacity: float,
) -> PathTiming:
    """Return the fastest timing of the laps that needs at most a fraction of the wheels' capacity.

    Args:
        curve: Curve of one lap.
        limits: Limits of velocity and acceleration.
        laps: Number of laps.
        faces_along_path: Whether the robot faces along its path.
        wheels: Limits of the wheels.
        capacity: Fraction of the friction, drag included, and of the rim speed that may be used.
    """
    n_cells = min(_N_PROGRAM_CELLS * _ceil_aspect_ratio(curve), _N_CELLS)
    u, step, arc_rate, curvature = _measure_cells(curve, n_cells)
    cell_curvature = (curvature[:-1] + curvature[1:]) / 2
    tangents = _to_complex(curve((u[:-1] + u[1:]) / 2, 1))
    direction = np.ones(n_cells) + 0j if faces_along_path else tangents / np.abs(tangents)
    x, y = direction.real, direction.imag
    path = ClosedPath(
        step,
        np.array([x, y, cell_curvature * faces_along_path]),
        np.array(
            [-cell_curvature * y, cell_curvature * x, np.diff(curvature) / step * faces_along_path]
        ),
    )
    squared_speed = solve_speed_profile_on_wheels(path, limits, wheels, capacity, laps)
    return _make_timing(squared_speed, arc_rate)


def _ceil_aspect_ratio(curve: Curve) -> int:
    """Return the longer extent over the shorter one, rounded up."""
    return math.ceil(max(curve.length / curve.width, curve.width / curve.length))


def _make_timing(squared_speed: Array, arc_rate: Array) -> PathTiming:
    """Return the timing of the laps from the squared speeds of the robot.

    Args:
        squared_speed: Squared speeds at the ends of cells of equal range of the parameter,
            (laps * cells + 1,) m^2/s^2.
        arc_rate: Arc length per parameter in one lap, (cells + 1,) m.
    """
    lap = arc_rate[:-1]
    rate = np.sqrt(squared_speed) / np.resize(lap, squared_speed.shape)
    return PathTiming(2 * np.pi / len(lap), rate)


def _measure_cells(curve: Curve, n_cells: int) -> tuple[Array, Array, Array, Array]:
    """Divide a curve into cells of equal range of the parameter, and return their geometry.

    Returns:
        Parameters u at the ends of the cells, (cells + 1,); lengths of the cells, (cells,) m; and,
        at the ends, the arc length per parameter, m, and the curvature, 1/m, positive to the left.
    """
    u = np.linspace(0, 2 * np.pi, n_cells + 1)
    # Points are complex numbers here, because arrays of x and y would round differently and change
    # results. The curvature is the cross product r' x r'' / |r'|^3 = Im(r'' / r') / |r'|.
    derivative = _to_complex(curve(u, 1))
    arc_rate = np.abs(derivative)
    curvature = (_to_complex(curve(u, 2)) / derivative).imag / arc_rate
    return u, u[1] * (arc_rate[:-1] + arc_rate[1:]) / 2, arc_rate, curvature


def _to_complex(points: Array) -> np.ndarray:
    """Return points (n, 2) as complex numbers x + iy, (n,)."""
    return points.view(complex)[..., 0]


def _get_poses(curve: Curve, faces_along_path: bool, u: Array) -> Array:
    """Return poses (n, 3) at parameters u (n,); headings are unwrapped (continuous)."""
    points, heading = curve(u), np.zeros_like(u)
    if faces_along_path:
        x, y = curve(u, 1).T
        heading = np.unwrap(np.arctan2(y, x))
    return np.column_stack([points, heading])

"""Timed references along smooth closed curves, as fast as the limits allow."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from omni_control.arguments import check_types, explain_types
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.path_timing import ParametricPath, plan_timing
from omni_control.reference.sampled_reference import SampledReference, check_period
from omni_control.reference.time_scaling import sample_path, slow_down_for_wheels

# Cells per lap, times the aspect ratio of the curve: elongated curves have sharper bends.
_N_CELLS = 400


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
        longer, shorter = max(curve.length, curve.width), min(curve.length, curve.width)
        n_cells = _N_CELLS * math.ceil(longer / shorter)
        path = ParametricPath(
            partial(_get_poses, curve, faces_along_path), 2 * np.pi, n_cells, laps
        )
        poses = sample_path(path, plan_timing(path, limits), limits, check_period(period))
        poses = slow_down_for_wheels(poses, path, limits, period)
        super().__init__(poses, period)


def _get_poses(curve: Curve, faces_along_path: bool, u: Array) -> Array:
    """Return poses (n, 3) at parameters u (n,); headings are unwrapped (continuous)."""
    points, heading = curve(u), np.zeros_like(u)
    if faces_along_path:
        x, y = curve(u, 1).T
        heading = np.unwrap(np.arctan2(y, x))
    return np.column_stack([points, heading])

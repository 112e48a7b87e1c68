"""Timed references along smooth closed curves, as fast as the limits allow.

How fast a point may be along a given curve is a question of the phase plane: speed over arc length s. With v^2 = z, the
acceleration along the path is z'/2 and that across it k z, k being the curvature. A limit a of the whole of it leaves
|z'| <= 2 sqrt(a^2 - k^2 z^2), which says that the angle arcsin(k z / a) by which the acceleration points away from the
path changes by at most 2 k ds: where k hardly changes, steps along the curve can be taken in closed form. A pass
forwards speeds up as hard as that allows, a pass backwards brakes as hard, and what is left is everywhere the highest
speed possible (Bobrow, Dubowsky and Gibson 1985; by two passes, Pham and Pham 2018).

Where a robot manages less acceleration aside than ahead, the circle of accelerations is an ellipse. Facing along the
path, that across it counts as many times more: the same steps with a higher k. Facing ahead all the time, the whole
plane can be stretched in y until the ellipse is a circle again: the same steps on a wider curve.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.motion_limits import MotionLimits
from omni_control.reference.time_optimal import Lap, fastest
from omni_control.reference.time_scaling import Timetable, bearable, driven, driven_on_wheels
from omni_control.reference.timed import SampledReference
from omni_control.traction import WheelLimits

# In a lap, times the figure's length over its width: the finer, the sharper its bends
_CELLS = 1000
_STRAIGHT = 1e-9  # 1/m, for a curvature of zero, by which one cannot divide
_FEWER = 300  # cells where a linear program is solved


@dataclass(frozen=True)
class Curve:
    """A Lissajous figure about the origin: x = length/2 sin u, y = width/2 sin(cycles u + phase), u from 0 to 2 pi.

    Args:
        length, width: extent in x and y, m.
        cycles: oscillations in y for one in x.
        phase: of y at u = 0, rad.
    """

    length: float
    width: float
    cycles: int
    phase: float

    def __post_init__(self) -> None:
        """Check the extents.

        Raises:
            OmniError: one is not a positive number.
        """
        for name in ("length", "width"):
            if not 0 < getattr(self, name) < np.inf:
                raise OmniError(
                    f"a curve's {name} must be a positive number of metres, not {getattr(self, name)}"
                )

    def __call__(self, u: Array, derivative: int = 0) -> Array:
        """Return x + iy, or a derivative of it by u, at parameters `u`; complex, of the shape of u, in m."""
        turn = derivative * np.pi / 2
        y = self.cycles**derivative * np.sin(self.cycles * u + self.phase + turn)
        return self.length / 2 * np.sin(u + turn) + 0.5j * self.width * y


CURVES: dict[str, Callable[[float, float], Curve]] = {
    "circle": partial(Curve, cycles=1, phase=-np.pi / 2),  # an ellipse, if length and width differ
    "figure-eight": partial(Curve, cycles=2, phase=0.0),  # the lemniscate of Gerono
}


class CurveReference(SampledReference):
    """Laps of a closed curve from rest to rest, as fast as the limits allow, in whole frames.

    Args:
        curve: where to drive, from u = 0 on.
        limits: of velocity, acceleration and jerk; the acceleration is that along and across the
            path together, in the body's axes if it is not the same in all directions. Drives keep
            them as `driven` says.
        period: length of a frame, s.
        laps: how often around, at least once.
        tangent: whether the robot faces along its path, within the limits of turning; otherwise its
            heading is 0.
        settle_frames: further frames of rest at the end.

    Raises:
        OmniError: less than one lap.
    """

    def __init__(
        self,
        curve: Curve,
        limits: MotionLimits,
        period: float,
        laps: int = 1,
        tangent: bool = False,
        settle_frames: int = 0,
    ) -> None:
        if laps < 1:
            raise OmniError(f"a curve must be driven at least once, not {laps} times")
        path = partial(_poses, curve, tangent)
        poses = driven(path, _timetable(curve, limits, laps, tangent), limits, period)
        if limits.wheels is not None and not bearable(poses, limits.wheels, period):
            plan = partial(_timetable_on_wheels, curve, limits, limits.wheels, laps, tangent)
            poses = driven_on_wheels(path, plan, limits, limits.wheels, period)
        super().__init__(
            np.concatenate([poses, np.repeat(poses[-1:], settle_frames, axis=0)]), period
        )


def _timetable(curve: Curve, limits: MotionLimits, laps: int, tangent: bool) -> Timetable:
    """The fastest drive within the limits of velocity and acceleration."""
    # Where the limit is a circle
    even = curve if tangent else replace(curve, width=limits.stretch * curve.width)
    cells = _CELLS * math.ceil(max(even.length / even.width, even.width / even.length))
    lap = np.linspace(0, 2 * np.pi, cells + 1)
    first, second = even(lap, 1), even(lap, 2)
    metres = np.abs(first)  # per u
    step = lap[1] * (metres[:-1] + metres[1:]) / 2
    curvature = np.maximum(np.abs((second / first).imag) / metres, _STRAIGHT)
    top = (limits.speed * (metres / np.abs(curve(lap, 1)))) ** 2

    return _clocked(
        _fastest(step, curvature, np.minimum(top[:-1], top[1:]), limits, laps, tangent),
        metres,
        lap[1],
        laps,
    )


def _clocked(squares: Array, metres: Array, step: float, laps: int) -> Timetable:
    """The timetable of squares of speed (laps * cells + 1,) at parameters a `step` apart."""
    return Timetable.of_rates(
        step, np.sqrt(squares) / np.append(np.tile(metres[:-1], laps), metres[0])
    )


def _timetable_on_wheels(
    curve: Curve, limits: MotionLimits, wheels: WheelLimits, laps: int, tangent: bool, share: float
) -> Timetable:
    """The fastest drive that asks for so large a share of what wheels can do at once."""
    cells = min(
        _FEWER * math.ceil(max(curve.length / curve.width, curve.width / curve.length)), _CELLS
    )
    u = np.linspace(0, 2 * np.pi, cells + 1)
    first, second, middle = curve(u, 1), curve(u, 2), curve((u[:-1] + u[1:]) / 2, 1)
    metres = np.abs(first)
    step, bend = u[1] * (metres[:-1] + metres[1:]) / 2, (second / first).imag / metres
    towards = np.ones(cells) + 0j if tangent else middle / np.abs(middle)
    axes = np.stack([towards.real, towards.imag], axis=1)
    lap = Lap(step, axes, (bend[:-1] + bend[1:]) / 2, np.diff(bend) / step, tangent)
    return _clocked(fastest(lap, limits, wheels, share, laps), metres, u[1], laps)


def _fastest(
    step: Array, curvature: Array, top: Array, limits: MotionLimits, laps: int, tangent: bool
) -> Array:
    """Highest squares of speed (laps * cells + 1,), m^2/s^2, where cells meet, from rest to rest.

    `step` (cells,) is their length in m, `curvature` (cells + 1,) the path's at their ends in 1/m,
    taken as positive, `top` (cells,) the square of the speed limit.
    """
    a = limits.acceleration
    turn_rate, turn_acceleration = (
        (limits.turn_rate, limits.turn_acceleration) if tangent else (np.inf, np.inf)
    )
    aside = limits.stretch if tangent else 1.0  # how much more acceleration across the path counts
    bend = (curvature[:-1] + curvature[1:]) / 2

    # Facing along the path, the turn acceleration is k times the acceleration along it plus k'/k
    # times that across it. Its limits cut a strip out of the circle of radius a in which the
    # acceleration must stay. Where the top of the circle, all acceleration across, is cut off, the
    # highest that is left is the corner, at this angle from the top.
    slope = np.abs(np.diff(curvature)) / (step * bend) / aside
    corner = np.arccos(np.minimum(turn_acceleration / (a * np.hypot(bend, slope)), 1)) - np.arctan2(
        bend, slope
    )
    across = a * np.cos(np.maximum(corner, 0))

    within = np.tile(
        np.minimum(np.minimum(across / (aside * bend), top), (turn_rate / bend) ** 2), laps
    )
    highest = np.concatenate([[0], np.minimum(within[:-1], within[1:]), [0]])
    forwards = _reachable(highest, step, curvature, a, aside, turn_acceleration)
    return _reachable(forwards[::-1], step[::-1], curvature[::-1], a, aside, turn_acceleration)[
        ::-1
    ]


def _reachable(
    highest: Array,
    step: Array,
    curvature: Array,
    acceleration: float,
    aside: float,
    turn_acceleration: float,
) -> Array:
    """Squares of speed (laps * cells + 1,) up to `highest` that can be reached from those before.

    From one end of a cell to the other, the angle of the acceleration changes by up to twice the
    angle that the path turns, `aside` times that if acceleration across it counts so often, and the
    square of the turn rate by up to twice the angle times the turn acceleration.
    """
    bend = (curvature[:-1] + curvature[1:]) / 2
    turn = 2 * bend * step
    kept, gained = (
        (curvature[:-1] / curvature[1:]) ** 2,
        turn_acceleration * turn / curvature[1:] ** 2,
    )
    lap = np.stack([aside * bend / acceleration, aside * turn, kept, gained], axis=1).tolist()
    z = float(highest[0])
    reached = [z]
    straight_on = math.pi / 2
    for most, (scale, angle, keep, gain) in zip(highest[1:].tolist(), cycle(lap), strict=False):
        turned = math.asin(scale * z) + angle if scale * z < 1 else straight_on
        along_circle = (math.sin(turned) if turned < straight_on else 1.0) / scale
        z = keep * z + gain
        if along_circle < z:
            z = along_circle
        if most < z:
            z = most
        reached.append(z)
    return np.array(reached)


def _poses(curve: Curve, tangent: bool, u: Array) -> Array:
    """Poses (frames, 3) at parameters `u` (frames,); headings count full turns."""
    point = curve(u)
    heading = np.unwrap(np.angle(curve(u, 1))) if tangent else np.zeros_like(u)
    return np.stack([point.real, point.imag, heading], axis=1)

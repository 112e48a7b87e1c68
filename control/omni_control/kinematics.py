r"""Kinematics of an omnidirectional robot with three or more wheels (equations 1-4 of the paper, for any number).

    body frame, seen from above                    wheel i at azimuth theta_i and distance l (the arm)

                 x (kicker)
          1 \   ^   / 4         four: 60, 135, 225, 300 deg, counter-clockwise from the front left
             \  |  /
       y <------+                A positive wheel speed drives the wheel's contact point, and so the body there,
             /     \             along (-sin theta, cos theta): all positive turn the robot counter-clockwise.
          2 /       \ 3

World frame: field centre, x towards the goal, y left, heading counter-clockwise from x.
A pose is [x, y, heading] in m, m, rad; a twist is [vx, vy, w] in m/s, m/s, rad/s.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_PAST_HALF_A_TURN = np.nextafter(-np.pi, 0)


def wrap_angle(angle: ArrayLike) -> Array:
    """Return `angle` (rad, any shape) mapped into (-pi, pi]."""
    angle = np.asarray(angle, float)
    near = angle - 2 * np.pi * np.ceil(angle / (2 * np.pi) - 0.5)
    return np.minimum(
        np.maximum(near, _PAST_HALF_A_TURN), np.pi
    )  # rounding may have led just past the ends


def body_to_world(twist: ArrayLike, heading: ArrayLike) -> Array:
    """Rotate body twists (..., 3) by `heading` (...) in rad into the world frame (equation 2)."""
    twist = np.asarray(twist, float)
    vx, vy, w = twist[..., 0], twist[..., 1], twist[..., 2]
    c, s = np.cos(heading), np.sin(heading)
    x = c * vx - s * vy
    world = np.empty((*x.shape, 3))
    world[..., 0], world[..., 1], world[..., 2] = x, s * vx + c * vy, w
    return world


def world_to_body(twist: ArrayLike, heading: ArrayLike) -> Array:
    """Rotate world twists (..., 3) into the body frame of a robot with `heading` (...) in rad."""
    return body_to_world(twist, -np.asarray(heading, float))


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Geometry of the wheels and the maps between body twist and wheel speeds; equal to another with equal numbers.

    Args:
        azimuths: direction from the centre to each wheel, rad, (wheels,).
        arm: distance from the centre to the wheels' contact points (l), m.
        radius: wheel radius (r), m.
    """

    azimuths: Array
    arm: float
    radius: float

    def __post_init__(self) -> None:
        """Take a copy of the azimuths, which nobody can change."""
        azimuths = np.array(self.azimuths, float)
        azimuths.flags.writeable = False
        object.__setattr__(self, "azimuths", azimuths)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Kinematics) and self._numbers == other._numbers

    def __hash__(self) -> int:
        return hash(self._numbers)

    @property
    def _numbers(self) -> tuple[float, ...]:
        return (*self.azimuths.tolist(), self.arm, self.radius)

    @cached_property
    def matrix(self) -> Array:
        """Matrix B^T (wheels, 3) of equation 4: rim speeds (m/s) from a body twist."""
        theta = self.azimuths
        matrix = np.stack([-np.sin(theta), np.cos(theta), np.full_like(theta, self.arm)], axis=-1)
        matrix.flags.writeable = False
        return matrix

    @cached_property
    def axles(self) -> Array:
        """Matrix (wheels, 3): speeds of wheels along their axles, outwards (m/s), from a body twist."""
        theta = self.azimuths
        axles = np.stack([np.cos(theta), np.sin(theta), np.zeros_like(theta)], axis=-1)
        axles.flags.writeable = False
        return axles

    def wheel_speeds(self, twist: ArrayLike) -> Array:
        """Return the wheel speeds (..., wheels) in rad/s of rolling without slip at a body twist (..., 3)."""
        # A sum over broadcast products, not a matrix product: BLAS may round one row of a batch
        # differently from the same row alone.
        return (self.matrix / self.radius * np.asarray(twist, float)[..., None, :]).sum(-1)

    def body_twist(self, wheel_speeds: ArrayLike) -> Array:
        """Return the body twist (..., 3) of equation 3, least squares over the wheel speeds (..., wheels) in rad/s."""
        inverse = np.linalg.pinv(self.matrix) * self.radius
        return (inverse * np.asarray(wheel_speeds, float)[..., None, :]).sum(-1)

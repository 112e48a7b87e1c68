r"""Kinematics of an omnidirectional robot with three or more wheels (equations 1-4 of the paper).

    body frame, seen from above         wheel i at azimuth theta_i and distance l (the arm)

                 x (kicker)
          1 \   ^   / 4         four wheels: 60, 135, 225, 300 deg,
             \  |  /            counter-clockwise from the front left.
       y <------+               A positive wheel speed moves the robot at the wheel's contact
             /     \            point along (-sin theta, cos theta). If all wheel speeds are
          2 /       \ 3         positive, the robot turns counter-clockwise.

World frame: field center, x towards the goal, y left, heading counter-clockwise from x.
A pose is [x, y, heading] in m, m, rad; a twist is [vx, vy, w] in m/s, m/s, rad/s.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.arguments import check_types, explain_types

Array = NDArray[np.float64]

_ABOVE_MINUS_PI = np.nextafter(-np.pi, 0)


def wrap_angle(angle: ArrayLike) -> Array:
    """Return `angle` (rad, any shape) mapped into (-pi, pi]."""
    angle = np.asarray(angle, float)
    wrapped = angle - 2 * np.pi * np.ceil(angle / (2 * np.pi) - 0.5)
    # Rounding may lead just past the ends.
    return np.minimum(np.maximum(wrapped, _ABOVE_MINUS_PI), np.pi)


def compute_pose_error(target: Array, pose: Array) -> Array:
    """Return `target` minus `pose`, both (..., 3), with the heading error in (-pi, pi]."""
    error = target - pose
    error[..., 2] = wrap_angle(error[..., 2])
    return error


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


@explain_types
@check_types
@dataclass(frozen=True)
class Kinematics:
    """Geometry of the wheels, and conversion between body twist and wheel speeds.

    Instances with equal numbers compare equal.

    Args:
        azimuths: Direction from the center to each wheel, (wheels,), rad.
        arm: Distance l from the center to the wheels' contact points, m.
        radius: Wheel radius r, m.
    """

    azimuths: Array = field(compare=False)
    arm: float
    radius: float
    _compared_azimuths: tuple[float, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Replace the azimuths by a read-only copy."""
        azimuths = np.array(self.azimuths, float)
        azimuths.flags.writeable = False
        object.__setattr__(self, "azimuths", azimuths)
        object.__setattr__(self, "_compared_azimuths", tuple(azimuths.tolist()))

    @cached_property
    def matrix(self) -> Array:
        """Matrix B^T (wheels, 3) of equation 4: rim speeds (m/s) from a body twist."""
        theta = self.azimuths
        matrix = np.stack([-np.sin(theta), np.cos(theta), np.full_like(theta, self.arm)], axis=-1)
        matrix.flags.writeable = False
        return matrix

    @cached_property
    def axles(self) -> Array:
        """Matrix (wheels, 3): wheel speeds along their axles, outwards (m/s), from a body twist."""
        theta = self.azimuths
        axles = np.stack([np.cos(theta), np.sin(theta), np.zeros_like(theta)], axis=-1)
        axles.flags.writeable = False
        return axles

    def wheel_speeds(self, twist: ArrayLike) -> Array:
        """Return the wheel speeds (..., wheels), rad/s, without slip at a body twist (..., 3)."""
        # A matrix product by BLAS may round a row of a batch differently from the same row alone.
        return (self.matrix / self.radius * np.asarray(twist, float)[..., None, :]).sum(-1)

    def body_twist(self, wheel_speeds: ArrayLike) -> Array:
        """Return the body twist (..., 3) that best fits wheel speeds (..., wheels) in rad/s.

        This is equation 3, a least-squares fit for any number of wheels.
        """
        inverse = np.linalg.pinv(self.matrix) * self.radius
        return (inverse * np.asarray(wheel_speeds, float)[..., None, :]).sum(-1)

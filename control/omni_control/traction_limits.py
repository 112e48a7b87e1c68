"""Limits of wheels on a carpet: forces and moments on the robot within friction, and rim speeds.

A wheel exerts at most Coulomb friction along its rim, mu times its load. Along its axle its rollers
turn, and it exerts no force. The forces and moments [ax, ay, moment] per mass that one wheel can
exert on the body form a line segment about zero. The sum of the segments of all wheels is a
zonotope. Each of its faces is spanned by two segments (McMullen 1971, On zonotopes). A demand is
feasible if it lies on the inner side of every face.

Loads follow from statics and differ between wheels. With wheels at 60, 135, 225 and 300 degrees,
each front wheel carries 29 % of the weight and each rear wheel 21 %, because the front wheels are
nearer to the center along x. Wheels must also overcome drag: see `WheelLimits`.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from omni_control.arguments import check_types, explain_types
from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics, world_to_body

GRAVITY = 9.81  # m/s^2
_N_NEIGHBORS = 2  # cells on either side of a cell whose drag is considered
_PARALLEL = 1e-9  # norm of a cross product up to which two wheels are parallel and span no face


def compute_traction_limits(
    kinematics: Kinematics,
    friction: float,
    com_height: float = 0.0,
    rolling_resistance: float = 0.0,
    roller_friction: float = 0.0,
    com_x: float = 0.0,
) -> tuple[float, float]:
    """Return the highest accelerations (forward, sideways) for speeding up, m/s^2.

    The lower value of both directions of an axis counts. Between the axes friction allows less than
    the ellipse of `MotionLimits`. Motors are assumed to be strong enough. Drag helps to brake.

    Args:
        kinematics: Geometry of the wheels.
        friction: Coefficient of friction between rollers and carpet.
        com_height: Height of the center of mass above the carpet, m. With 0, the load transfer by
            acceleration is neglected.
        rolling_resistance: See `WheelLimits`.
        roller_friction: See `WheelLimits`.
        com_x: See `WheelLimits`.

    Raises:
        OmniError: The wheels do not surround the center of mass, or they cannot overcome drag.
    """
    drag = rolling_resistance, roller_friction
    wheels = WheelLimits(kinematics, friction, 1.0, com_height, *drag, com_x=com_x)
    forward, backward, to_left, to_right = map(
        wheels.compute_max_acceleration, (0.0, math.pi, math.pi / 2, -math.pi / 2)
    )
    return min(forward, backward), min(to_left, to_right)


@explain_types
@check_types
@dataclass(frozen=True)
class WheelLimits:
    """Combined limits of the wheels of a robot. Motors are assumed to be strong enough.

    Args:
        kinematics: Geometry of the wheels.
        friction: Coefficient of friction between rollers and carpet.
        gyration_radius: Square root of the yaw inertia over the mass, m.
        com_height: Height of the center of mass above the carpet, m.
        rolling_resistance: Drag of the carpet against the motion of a wheel, over its load.
        roller_friction: Friction of the rollers' bearings against motion along the axle, over the
            wheel's load. It reduces the friction that is left along the rim (friction circle).
        max_rim_speed: Highest speed of a rim, m/s.
        com_x: Forward position of the center of mass, whose accelerations count, m.

    Raises:
        OmniError: A number is out of range, the wheels do not surround the center of mass, or they
            cannot overcome drag.
    """

    kinematics: Kinematics
    friction: float
    gyration_radius: float
    com_height: float = 0.0
    rolling_resistance: float = 0.0
    roller_friction: float = 0.0
    max_rim_speed: float = np.inf
    com_x: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers, and that friction exceeds drag."""
        for name in ("friction", "gyration_radius", "max_rim_speed"):
            if not getattr(self, name) > 0:
                raise OmniError(f"WheelLimits.{name} must be above 0, got {getattr(self, name)}")
        for name in ("com_height", "rolling_resistance", "roller_friction"):
            if not getattr(self, name) >= 0:
                raise OmniError(f"WheelLimits.{name} must be at least 0, got {getattr(self, name)}")
        if self.max_drag_fraction >= 1:
            raise OmniError(
                f"with friction {self.friction:g} the wheels cannot overcome drag, "
                f"which is {self.max_drag_fraction:.3g} times their traction"
            )

    @property
    def max_drag_fraction(self) -> float:
        """Upper bound of the fraction of friction that drag takes; a few percent too high."""
        return float(self._max_drag.max())

    def compute_peak_utilization(self, poses: Array, period: float) -> float:
        """Return the largest fraction of friction or of rim speed that a trajectory needs.

        Args:
            poses: Pose of each frame, (frames, 3), from rest to rest. Accelerations are their
                second differences.
            period: Length of a frame, s.
        """
        heading, velocity = poses[:, 2], np.diff(poses, axis=0) / period
        rim_speeds = self.compute_rim_speeds(
            world_to_body(velocity, (heading[1:] + heading[:-1]) / 2)
        )
        velocity = np.pad(velocity, ((1, 1), (0, 0)))
        acceleration = world_to_body(np.diff(velocity, axis=0) / period, heading)
        twist = world_to_body((velocity[1:] + velocity[:-1]) / 2, heading)
        friction = self.compute_friction_utilization(acceleration, twist).max()
        return float(max(friction, rim_speeds.max(initial=0) / self.max_rim_speed))

    def compute_friction_utilization(self, acceleration: Array, twist: Array) -> Array:
        """Return the fraction of friction (n,) that body accelerations and twists (n, 3) need."""
        rows, drag = self.get_friction_constraints(twist)
        return (acceleration @ rows.T + drag).max(1)

    def compute_max_acceleration(self, direction: float) -> float:
        """Return the highest acceleration in the direction of travel, without turning, m/s^2.

        Args:
            direction: Angle from the body's x axis, rad.
        """
        twist = np.array([[math.cos(direction), math.sin(direction), 0.0]])
        rows, (drag,) = self.get_friction_constraints(twist)
        growth = rows @ twist[0]
        is_reached = growth > _PARALLEL
        return float(((1 - drag[is_reached]) / growth[is_reached]).min())

    def get_friction_constraints(self, twist: Array) -> tuple[Array, Array]:
        """Return the faces of the zonotope as linear constraints on body accelerations.

        Args:
            twist: Body twists, (n, 3); they determine the drag.

        Returns:
            rows (faces, 3) and drag (n, faces). A body acceleration a (n, 3) needs the fraction
            `max(a @ rows.T + drag)` of the friction.
        """
        acceleration_rows, force_rows = self._faces
        drag = -self._compute_drag(twist) @ force_rows.T
        return acceleration_rows * [1.0, 1.0, self.gyration_radius**2], drag

    def compute_acceleration_margin(
        self, acceleration: float, side_acceleration: float, turn_acceleration: float
    ) -> float:
        """Return the factor by which accelerations may grow if all act at once, in any direction.

        The highest drag of any motion is assumed.

        Args:
            acceleration: Highest acceleration forward, m/s^2. Between forward and sideways, the
                limit is an ellipse.
            side_acceleration: Highest acceleration sideways, m/s^2.
            turn_acceleration: Highest turn acceleration in either direction, rad/s^2.
        """
        forward, sideways, turning = np.abs(self._faces[0]).T
        demand = np.hypot(acceleration * forward, side_acceleration * sideways)
        demand += self.gyration_radius**2 * turn_acceleration * turning
        return float(1 / (demand / (1 - self._max_drag)).max())

    def compute_rim_speeds(self, twist: Array) -> Array:
        """Return the absolute speeds of the rims (n, wheels) at body twists (n, 3), m/s."""
        return np.abs(twist @ self.kinematics.matrix.T)

    def _compute_drag(self, twist: Array) -> Array:
        """Return drag on the body, [ax, ay, moment per mass] (n, 3), at body twists (n, 3)."""
        rim_speed, axle_speed = twist @ self.kinematics.matrix.T, twist @ self.kinematics.axles.T
        load, speed = GRAVITY * self._loads[0], np.hypot(rim_speed, axle_speed)
        per_speed = np.divide(
            self.rolling_resistance, speed, out=np.zeros_like(speed), where=speed > 0
        )
        axle_drag = per_speed * axle_speed + self.roller_friction * np.sign(axle_speed)
        return (
            -(load * per_speed * rim_speed) @ self.kinematics.matrix
            - (load * axle_drag) @ self.kinematics.axles
        )

    @cached_property
    def _faces(self) -> tuple[Array, Array]:
        """Faces of the zonotope: rows for accelerations and for drag forces, (faces, 3) each.

        An acceleration a = [ax, ay, gyration_radius^2 turn acceleration] is feasible under the drag
        d (per mass) if acceleration_rows @ a - force_rows @ d <= 1.

        Wheel k exerts m_k = [-sin, cos, arm] on the body per unit of force. Its load per mass is
        g n_k + s_k a, where n_k is its fraction of the weight and s_k a the load transfer. Along a
        normal v, the zonotope extends to sum |m_k v| mu (g n_k + s_k a). This must be at least
        v (a - d). The last faces state that no load is negative.
        """
        wheel_forces, (static_load, load_transfer) = self.kinematics.matrix, self._loads
        if static_load.min() <= 0:
            raise OmniError(
                "the wheels do not surround the robot's center of mass: it would topple"
            )
        spanned = np.array([np.cross(*pair) for pair in combinations(wheel_forces, 2)])
        spanned = spanned[np.linalg.norm(spanned, axis=1) > _PARALLEL]
        normals = np.concatenate([spanned, -spanned])
        rim_friction = math.sqrt(max(self.friction**2 - self.roller_friction**2, _PARALLEL))
        extent = rim_friction * np.abs(normals @ wheel_forces.T)
        force_rows = np.concatenate([normals, np.zeros_like(load_transfer)])
        load_weights = np.concatenate([extent, np.eye(len(static_load))])
        capacity = GRAVITY * (load_weights @ static_load)[:, None]
        # A force on the center of mass has a moment about the middle of the wheels.
        acceleration_rows = force_rows + self.com_x * force_rows[:, 2:] * [0.0, 1.0, 0.0]
        acceleration_rows -= load_weights @ load_transfer
        return acceleration_rows / capacity, force_rows / capacity

    @cached_property
    def _max_drag(self) -> Array:
        """Largest fraction of each face that drag takes (faces,), in any motion of the wheels."""
        force_rows = self._faces[1]
        rim_part = np.abs(force_rows @ self.kinematics.matrix.T)
        axle_part = np.abs(force_rows @ self.kinematics.axles.T)
        drag = (
            self.rolling_resistance * np.hypot(rim_part, axle_part)
            + self.roller_friction * axle_part
        )
        return drag @ (GRAVITY * self._loads[0])

    @cached_property
    def _loads(self) -> tuple[Array, Array]:
        return compute_load_distribution(self.kinematics, self.com_height, self.com_x)


def compute_load_distribution(
    kinematics: Kinematics, com_height: float, com_x: float = 0.0
) -> tuple[Array, Array]:
    """Return the loads of wheels at rest and under acceleration.

    Args:
        kinematics: Geometry of the wheels.
        com_height: Height of the center of mass above the carpet, m.
        com_x: Forward position of the center of mass, m.

    Returns:
        Loads at rest over the weight, (wheels,), and loads per mass that accelerations
        [ax, ay, turning] add, (wheels, 3).
    """
    load_matrix = compute_load_matrix(kinematics)
    static_load = load_matrix @ [1.0, com_x, 0.0]
    return static_load, np.pad(-com_height * load_matrix[:, 1:], ((0, 0), (0, 1)))


def compute_load_matrix(kinematics: Kinematics) -> Array:
    """Return the loads of wheels (wheels, 3) per vertical force, and per its moments in x and y.

    A moment is force times position, so the last two columns have the unit 1/m. Wheels act like
    equal springs under a rigid body. Of all loads in equilibrium, theirs have the least sum of
    squares.
    """
    positions = kinematics.arm * kinematics.axles[:, :2]
    return np.asarray(np.linalg.pinv(np.insert(positions, 0, 1.0, axis=1).T))


def compute_softening(sliding_fraction: Any) -> Any:
    """Return the stiffness of a brush contact that slides in part, relative to one that sticks.

    The brush model with parabolic pressure (Pacejka, Tire and Vehicle Dynamics, section 3.2) has
    the traction mu N (1 - (1 - x)^3) at the slip x, relative to that of full sliding. It is the
    secant stiffness 3 mu N times x (1 - x + x^2 / 3).

    Args:
        sliding_fraction: x from 0 to 1, an array of any library.
    """
    return 1 - sliding_fraction + sliding_fraction * sliding_fraction / 3


def max_over_neighbors(drag: Array) -> Array:
    """Return the largest drag (cells, faces) of each cell of a path and its neighbors.

    The friction of a roller's bearings changes sign where the speed along its axle does. This may
    happen within a frame, between the cells of two samples.

    Args:
        drag: Fraction of friction that drag takes in each cell, (cells, faces).
    """
    padded = np.pad(drag, ((_N_NEIGHBORS, _N_NEIGHBORS), (0, 0)), "edge")
    shifted = [padded[i : i + len(drag)] for i in range(2 * _N_NEIGHBORS + 1)]
    return np.max(shifted, axis=0)

"""Parameters of bodies on the plant `planar`: masses, inertias and wheels, from settings.

**Drag of rollers along the axle.** While a wheel travels along its axle at v, a roller on the
carpet spins at v / q, where q is the distance of its axis from the carpet. It comes down almost at
rest, because its bearing (damping d, N m s/rad) has braked it. On the carpet it takes on the
carpet's speed at the rate b, 1/s, while the wheel turns by the angle T at w. With the inertia I of
a roller, the pitch p (angle between neighboring rollers), and < > for the mean over the contact,
the mean force over v is

    <1 / q^2> (d T / p + (I - d / b) w / p (1 - exp(-b T / w))).

The first term is the drag of the bearing, the second the impulse that spins up a roller. The rate b
is FRICTION_RATE_PER_S in d / b, and SPIN_UP_RATE_PER_S, its equivalent in steps of a cycle, in the
exponential. In the second term, 1 / q^2 is halfway between its mean and its value where rollers
come down, and T is multiplied by the square of the ratio of mean to value. The result is within 6 %
of the sum over steps, up to w = 100 rad/s.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.faults import Payload
from omni_mj.config.settings import Settings, gather
from omni_mj.mjcf.robot_geometry import compute_composite_inertia
from omni_mj.mjcf.rollers import (
    ADDED_MASS_KG,
    FRICTION_RATE_PER_S,
    FRICTION_STIFFNESS_RATIO,
)
from omni_mj.mjcf.world_builder import World
from omni_mj.plants.planar_roller_forces import SPEEDS_RAD_S, interpolate_response
from omni_mj.plants.randomization import RobotVariation
from omni_mj.robot.array_ops import sum_wheels
from omni_mj.robot.firmware_state import CYCLE_S
from omni_mj.robot.planar_dynamics import BodyParameters, RollerResponse

# Damping of a roller's contact along the carpet, N s/m
CONTACT_DAMPING_N_S_M = ADDED_MASS_KG * FRICTION_STIFFNESS_RATIO * FRICTION_RATE_PER_S
# Rate at which rollers take on the carpet's speed on the plant mujoco, 1/s. After a step of a
# cycle, the fraction 1 - CYCLE_S FRICTION_RATE_PER_S = exp(-CYCLE_S SPIN_UP_RATE_PER_S) of the
# difference is left.
SPIN_UP_RATE_PER_S = -np.log(1 - CYCLE_S * FRICTION_RATE_PER_S) / CYCLE_S


class RigidBodies(NamedTuple):
    """Mass properties of n rigid bodies in the plane."""

    mass: Array  # (n,) kg
    center: Array  # center of mass, body frame from the center of the wheels, (n, 3) m
    inertia: Array  # about the vertical axis through the center of mass, (n,) kg m^2

    def combine(self, added: "RigidBodies") -> "RigidBodies":
        """Return the mass properties of both bodies joined, by the parallel axis theorem."""
        mass = self.mass + added.mass
        first_moment = self.mass[:, None] * self.center + added.mass[:, None] * added.center
        squared_distance = ((self.center - added.center)[:, :2] ** 2).sum(1)
        inertia = self.inertia + added.inertia + self.mass * added.mass / mass * squared_distance
        return RigidBodies(mass, first_moment / mass[:, None], inertia)


class PlanarBodyBuilder:
    """Builder of the parameters of n robots with equal wheels.

    Args:
        settings: One per robot.
        variation: Deviations of the robots from their settings.
        world: World with the first robot, whose wheels represent those of all robots.

    Raises:
        OmniError: The wheels are at least as heavy as a robot.
    """

    def __init__(
        self, settings: Sequence[Settings], variation: RobotVariation, world: World
    ) -> None:
        model = world.model
        robot = world.robots[0]
        kinematics = world.kinematics
        self._settings = settings
        self._wear = variation.wear
        self._axle = kinematics.axles.T[:2, :, None] * np.ones(len(settings))
        self._arm = kinematics.arm
        self._wheel_order = np.argsort(kinematics.azimuths)  # counter-clockwise
        gear_ratio = gather(settings, "motor.gear_ratio")
        rotor_inertia = gather(settings, "motor.rotor_inertia_kg_m2") * gear_ratio**2
        hub_body_inertia = float(model.body_inertia[robot.wheels[0]].max())
        self._hub_inertia = hub_body_inertia + rotor_inertia
        _, _, rim_inertia = compute_composite_inertia(model, [robot.rims[0], *robot.rollers[0]])
        axle = kinematics.axles[0]
        self._rim_inertia = float(axle @ rim_inertia @ axle)
        self._roller_inertia = float(model.body_inertia[robot.rollers[0, 0]].min())
        self._gravity = -float(model.opt.gravity[2])
        self._set_unloaded_bodies(variation, world)

    def _set_unloaded_bodies(self, variation: RobotVariation, world: World) -> None:
        """Set the mass properties of the chassis, and of robots without payloads.

        The settings describe the robot with its wheels. Deviations apply to the chassis only.
        """
        n = len(self._settings)
        names = "mass_kg", "com_height_m", "com_x_m", "yaw_inertia_kg_m2"
        mass, height, center_x, inertia = (gather(self._settings, f"body.{name}") for name in names)
        chassis_id = world.robots[0].chassis
        wheels_mass, wheels_center, wheels_inertia = compute_composite_inertia(
            world.model, [i for i in range(1, world.model.nbody) if i != chassis_id]
        )
        if (mass <= wheels_mass).any():
            raise OmniError(
                f"body.mass_kg must be more than the {wheels_mass:.3f} kg of the wheels, "
                f"not {mass.min():g}"
            )
        robots = RigidBodies(mass, np.column_stack([center_x, np.zeros(n), height]), inertia)
        wheels = RigidBodies(np.full(n, wheels_mass), wheels_center, wheels_inertia[2, 2])
        # The chassis is the robot without its wheels, which are added with negative mass.
        chassis = robots.combine(RigidBodies(-wheels.mass, wheels.center, -wheels.inertia))
        factor = variation.mass_factor[:, 0]
        shift = np.column_stack([variation.center_offset, np.zeros(n)])
        self._chassis = RigidBodies(
            chassis.mass * factor, chassis.center + shift, chassis.inertia * factor
        )
        self._unloaded_robots = self._chassis.combine(wheels)

    def build(self, payloads: Iterable[tuple[int, Payload]], slope: Array) -> BodyParameters:
        """Return the parameters of robots that carry payloads on a slope.

        Args:
            payloads: Pairs of a row and its payload.
            slope: Fractions of gravity along the world's x and y, positive downhill, (n, 2).
        """
        robots = self._add_payloads(payloads)
        contact = self._arm * self._axle - robots.center[:, :2].T[:, None]
        contact_x, contact_y = contact
        weight = robots.mass * self._gravity
        load_distribution = _distribute_load(contact)
        normal_fraction = np.sqrt(np.maximum(1 - (slope**2).sum(1), 0.0))
        load = load_distribution[0] * weight * normal_fraction
        response = interpolate_response(self._settings[0].wheels, load)
        response = response._replace(rolling_radius=response.rolling_radius - self._wear.T)
        axle_x, axle_y = self._axle
        jacobian = (
            np.stack([-axle_y, axle_x, contact_x * axle_x + contact_y * axle_y])
            / response.rolling_radius
        )
        axle_jacobian = np.stack([axle_x, axle_y, contact_x * axle_y - contact_y * axle_x])
        rolling_mass = self._compute_rolling_mass(jacobian, axle_jacobian, response)
        body_mass = np.zeros_like(rolling_mass)
        body_mass[0, 0] = body_mass[1, 1] = robots.mass
        body_mass[2, 2] = robots.inertia
        order = self._wheel_order
        edge = np.zeros_like(contact)
        edge[:, order] = contact[:, np.roll(order, -1)] - contact[:, order]
        n_rollers = self._settings[0].wheels.rollers
        contact_damping = CONTACT_DAMPING_N_S_M * response.standing_rollers
        roller_drag, spin_up, spin_up_speed = self._compute_roller_drag(response)
        return BodyParameters(
            contact=contact,
            edge=edge,
            jacobian=jacobian,
            mass_rate=(body_mass + rolling_mass) / CYCLE_S,
            rolling_mass=rolling_mass[:, :2],
            hub_gain=CYCLE_S / self._hub_inertia,
            hub_viscous_friction=gather(self._settings, "motor.wheel_viscous_friction_nm_s"),
            hub_dry_friction=gather(self._settings, "hub_friction_nm") * np.ones_like(load),
            contact_compliance=1 / (contact_damping * response.rolling_radius**2),
            roller_drag=roller_drag,
            spin_up=spin_up,
            spin_up_speed=spin_up_speed,
            response=response,
            rollers_per_speed=np.full(len(weight), CYCLE_S * n_rollers / (2 * np.pi)),
            center=-robots.center[:, :2].T,
            push_point=(self._chassis.center - robots.center).T,
            mass_height=robots.center[:, 2],
            static_load=load,
            load_distribution=load_distribution,
            slope_force=weight * slope.T,
        )

    def _add_payloads(self, payloads: Iterable[tuple[int, Payload]]) -> RigidBodies:
        """Return the mass properties of robots with payloads."""
        robots = self._unloaded_robots
        for row, payload in payloads:
            payload_mass = np.zeros(len(robots.mass))
            payload_mass[row] = payload.mass_kg
            center = self._chassis.center.copy()
            center[row, 2] = payload.height_m or center[row, 2]
            robots = robots.combine(RigidBodies(payload_mass, center, np.zeros_like(payload_mass)))
        return robots

    def _compute_rolling_mass(
        self, jacobian: Array, axle_jacobian: Array, response: RollerResponse
    ) -> Array:
        """Return the mass matrix of rims and of standing rollers, (3, 3, n) kg, kg m and kg m^2.

        A roller of the inertia I adds the mass I / q^2 along the axle.

        Args:
            jacobian: Rim speed per twist, (3, W, n) rad/m, rad/m, 1.
            axle_jacobian: Speed along the axle per twist, (3, W, n) 1, 1, m.
            response: Response of the wheels.
        """
        rims = self._rim_inertia * jacobian[:, None] * jacobian
        roller_mass = self._roller_inertia * response.standing_rollers * response.inverse_square
        return sum_wheels(rims + roller_mass * axle_jacobian[:, None] * axle_jacobian)

    def _compute_roller_drag(self, response: RollerResponse) -> tuple[Array, Array, Array]:
        """Return roller_drag, spin_up and spin_up_speed of `BodyParameters`; see the module."""
        bearing_damping = gather(self._settings, "drivetrain.roller_damping_nm_s")
        # Time in which a bearing brakes a lifted roller: one turn of the wheel at 50 rad/s
        lifted_s = 2 * np.pi / SPEEDS_RAD_S[0]
        braked_fraction = 1 - np.exp(-bearing_damping / self._roller_inertia * lifted_s)
        spin_up_inertia = (
            self._roller_inertia - bearing_damping / FRICTION_RATE_PER_S
        ) * braked_fraction
        n_rollers = self._settings[0].wheels.rollers
        inverse_square, inverse_square_down = response.inverse_square, response.inverse_square_down
        return (
            bearing_damping * response.standing_rollers * inverse_square,
            spin_up_inertia * (inverse_square + inverse_square_down) / 2 * n_rollers / (2 * np.pi),
            SPIN_UP_RATE_PER_S
            * response.standing_rollers
            * (inverse_square / inverse_square_down) ** 2
            * 2
            * np.pi
            / n_rollers,
        )


def _distribute_load(contact: Array) -> Array:
    """Return the normal forces of wheels for a unit force and for two unit moments.

    The forces are linear in the position of the wheels (equal springs under a rigid body). With a
    row (1, x, y) of the matrix A for each wheel, they are the rows of (A'A)^-1 A'.

    Args:
        contact: Positions x and y of the wheels' contacts, (2, W, n) m.

    Returns:
        Normal forces, (3, W, n) 1, 1/m, 1/m.
    """
    coordinates = np.concatenate([np.ones_like(contact[:1]), contact])
    gram = sum_wheels(coordinates[:, None] * coordinates).transpose(2, 0, 1)
    return np.linalg.solve(gram, coordinates.transpose(2, 0, 1)).transpose(1, 2, 0)

"""Masses, inertias and wheels of robots on the plant `planar`, from their settings."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.mjcf.geometry import composite
from omni_mj.plants.variation import Drawn
from omni_mj.robot.array_namespace import total
from omni_mj.robot.motors import Motor
from omni_mj.robot.planar_body import BodyParameters
from omni_mj.robot.rollers import Standing
from omni_mj.robot.wheel_loops import CYCLE_S
from omni_mj.scenarios.settings import Settings, column
from omni_mj.worlds.build import World
from omni_mj.worlds.contact import ADDED_MASS_KG, FRICTION_RATE_HZ, FRICTION_STIFFER, damping

CONTACT_DAMPING_N_S_M = ADDED_MASS_KG * FRICTION_STIFFER * FRICTION_RATE_HZ  # of a roller's contact along the carpet


class Mass(NamedTuple):
    """Masses (n,) kg, their centres (n, 3) m, and inertias about the vertical axes through these, (n,) kg m^2."""

    mass: Array
    centre: Array
    inertia: Array

    def joined(self, other: "Mass") -> "Mass":
        """Both together: about the common centre two bodies turn as their reduced mass does at their distance."""
        mass = self.mass + other.mass
        centre = (self.mass[:, None] * self.centre + other.mass[:, None] * other.centre) / mass[:, None]
        apart = ((self.centre - other.centre)[:, :2] ** 2).sum(1)
        return Mass(mass, centre, self.inertia + other.inertia + self.mass * other.mass / mass * apart)


class PlanarBodies:
    """Bodies of n robots with equal wheels.

    Args:
        settings: One per robot.
        drawn: What sets them apart.
        world: The first of them, as modelled; its wheels are those of all.

    Attributes:
        centre: Of mass of each robot, from the middle of its wheels' contacts, (n, 3) m.

    Raises:
        OmniError: The wheels weigh more than a robot.
    """

    def __init__(self, settings: Sequence[Settings], drawn: Drawn, world: World) -> None:
        n, model, robot, kinematics = len(settings), world.model, world.robots[0], world.kinematics
        self._settings, self._wear = settings, drawn.wear
        azimuths = kinematics.azimuths[:, None] * np.ones(n)
        self._axle = np.cos(azimuths), np.sin(azimuths)
        self._contact = kinematics.arm * self._axle[0], kinematics.arm * self._axle[1]
        self._next_wheel = np.argsort(azimuths[:, 0])
        motors = [Motor.of(s.motor) for s in settings]
        turning = column(motors, "inertia")[:, 0] * column(motors, "gear")[:, 0] ** 2
        self._hub = float(model.body_inertia[robot.wheels[0]].max()) + turning
        _, _, rim = composite(model, [int(robot.rims[0]), *robot.rollers[0].tolist()])
        axle = np.array([self._axle[0][0, 0], self._axle[1][0, 0], 0.0])
        self._rim = float(axle @ rim @ axle)
        self._roller = float(model.body_inertia[robot.rollers[0, 0]].min())
        self._gravity = -float(model.opt.gravity[2])

        body = [s.body for s in settings]
        mass, height, ahead = (column(body, name)[:, 0] for name in ("mass_kg", "centre_height_m", "centre_x_m"))
        rest, around, own = composite(model, [i for i in range(1, model.nbody) if i != robot.chassis])
        if (mass <= rest).any():
            raise OmniError(f"body.mass_kg must be more than the {rest:.3f} kg of the wheels, not {mass.min():g}")
        whole = Mass(mass, np.column_stack([ahead, np.zeros(n), height]), column(body, "yaw_inertia_kg_m2")[:, 0])
        wheels = Mass(np.full(n, rest), np.tile(around, (n, 1)), np.full(n, own[2, 2]))
        chassis = whole.joined(Mass(-wheels.mass, wheels.centre, -wheels.inertia))
        shift, factor = np.column_stack([drawn.centre, np.zeros(n)]), drawn.mass[:, 0]
        self._chassis = Mass(chassis.mass * factor, chassis.centre + shift, chassis.inertia * factor)
        self._empty = self._chassis.joined(wheels)
        self.centre = self._empty.centre

    def parameters(self, loads: Iterable[tuple[int, float, float]] = (), slope: Array | None = None) -> BodyParameters:
        """Return the parameters of robots that carry loads on a slope.

        Args:
            loads: Row, mass in kg, and height above the carpet in m, or 0 for that of the chassis' centre of mass.
            slope: Parts of gravity along the carpet's axes, (n, 2). [none]
        """
        whole = self._loaded(loads)
        self.centre = whole.centre
        along = np.zeros((len(whole.mass), 2)) if slope is None else slope
        settings, (axle_x, axle_y) = self._settings, self._axle
        contact_x, contact_y = self._contact[0] - whole.centre[:, 0], self._contact[1] - whole.centre[:, 1]
        weight = whole.mass * self._gravity
        shares = _load_shares(contact_x, contact_y)
        load = shares[0] * weight * np.sqrt(np.maximum(1 - (along**2).sum(1), 0.0))
        drive = [s.drive for s in settings]
        stiff = np.array([[damping(s.body.mass_kg / len(load))] for s in settings])
        bearing = self._roller, column(drive, "roller_damping_nm_s")
        rollers = Standing.of(settings[0].wheels, load.T, stiff, bearing)
        lever = rollers.lever.T - self._wear.T
        jacobian = np.stack([-axle_y, axle_x, contact_x * axle_x + contact_y * axle_y]) / lever
        along_axle = np.stack([axle_x, axle_y, contact_x * axle_y - contact_y * axle_x])
        rolling = self._rim * jacobian[:, None] * jacobian
        rolling = total(rolling + self._roller * (rollers.count * rollers.spin).T * along_axle[:, None] * along_axle)
        body = np.zeros_like(rolling)
        body[0, 0] = body[1, 1] = whole.mass
        body[2, 2] = whole.inertia
        motors, order = [Motor.of(s.motor) for s in settings], self._next_wheel
        edges = np.zeros((2, *load.shape))
        edges[:, order] = (
            np.stack([contact_x, contact_y])[:, np.roll(order, -1)] - np.stack([contact_x, contact_y])[:, order]
        )
        pushed = self._chassis.centre - whole.centre
        downhill = weight[:, None] * along
        dry = column(motors, "wheel_dry") + column(drive, "gear_friction_nm")
        return BodyParameters(
            contact_x=contact_x,
            contact_y=contact_y,
            edge_x=edges[0],
            edge_y=edges[1],
            jacobian=jacobian,
            inertia=(body + rolling) / CYCLE_S,
            rolling_inertia=rolling[:, :2],
            hub_gain=CYCLE_S / self._hub,
            hub_viscous=column(motors, "wheel_viscous")[:, 0],
            hub_dry=dry[:, 0] * np.ones_like(load),
            contact_softness=1 / (CONTACT_DAMPING_N_S_M * rollers.count.T * lever**2),
            lever=lever,
            bearing=rollers.bearing.T,
            spin_up=rollers.spin_up.T,
            spin_fades=rollers.spin_fades.T,
            cost=rollers.cost.T,
            cost_fades=rollers.cost_fades.T,
            lift=rollers.lift.T,
            lift_fades=rollers.lift_fades.T,
            ripple=rollers.ripple.T,
            ripple_grows=rollers.ripple_grows.T,
            passing=np.full(len(settings), CYCLE_S * settings[0].wheels.rollers / (2 * np.pi)),
            middle_x=-whole.centre[:, 0],
            middle_y=-whole.centre[:, 1],
            push_x=pushed[:, 0],
            push_y=pushed[:, 1],
            height=whole.centre[:, 2],
            push_height=pushed[:, 2],
            weight=load,
            shares=shares,
            downhill_x=downhill[:, 0],
            downhill_y=downhill[:, 1],
        )

    def _loaded(self, loads: Iterable[tuple[int, float, float]]) -> Mass:
        whole = self._empty
        for row, mass, height in loads:
            more, at = np.zeros(len(whole.mass)), self._chassis.centre.copy()
            more[row], at[row, 2] = mass, height or at[row, 2]
            whole = whole.joined(Mass(more, at, np.zeros_like(more)))
        return whole


def _load_shares(contact_x: Array, contact_y: Array) -> Array:
    """Return the load of wheels for a force up and two moments, (3, W, n), if it falls linearly from wheel to wheel."""
    sums = np.stack([np.ones_like(contact_x), contact_x, contact_y])
    gram = total(sums[:, None] * sums).transpose(2, 0, 1)
    return np.linalg.solve(gram, sums.transpose(2, 0, 1)).transpose(1, 2, 0)

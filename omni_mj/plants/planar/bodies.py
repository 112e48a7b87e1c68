"""Robots as rigid bodies on wheels: mass, centre, inertia, and how their weight stands on the wheels."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.mjcf.masses import composite
from omni_mj.plants.variation import Drawn
from omni_mj.scenarios.settings import Settings, column
from omni_mj.worlds.build import World


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


class Bodies:
    """n robots with W wheels each, all of the same wheels.

    As many springs as wheels carry a robot: loads that fall linearly from wheel to wheel balance its weight, and the
    moment about its centre of mass of the forces on the ground.

    Args:
        settings: one per robot.
        drawn: what sets them apart.
        world: the first of them, as modelled; what its wheels are made of is what all are.

    Attributes:
        whole: the robots; centres from the middle of the wheels' contacts.
        chassis: their chassis, in which pushes and payloads act.
        hub: inertia of each hub with its motor about the axle, (n, 1) kg m^2.
        rim: of a rim with its rollers, kg m^2.
        roller: of a roller about its own axis, kg m^2.
        downhill: force along the carpet, world frame, (2, n) N.
        contacts: where wheels touch, from the centres of mass, (n, W) m, as complex numbers.
        weight: load of each wheel at rest, (n, W) N.
        even, ahead, aside: see `arrays.Robots`.

    Raises:
        OmniError: the wheels weigh more than a robot.
    """

    def __init__(self, settings: Sequence[Settings], drawn: Drawn, world: World) -> None:
        n, model, robot = len(settings), world.model, world.robots[0]
        motor, body = [s.motor for s in settings], [s.body for s in settings]
        self._contacts = world.kinematics.arm * np.exp(1j * world.kinematics.azimuths)
        turning = column(motor, "rotor_inertia_kg_m2") * column(motor, "gear") ** 2
        self.hub = float(model.body_inertia[robot.wheels[0]].max()) + turning
        _, _, rim = composite(model, [int(robot.rims[0]), *robot.rollers[0].tolist()])
        axle = np.array([np.cos(world.kinematics.azimuths[0]), np.sin(world.kinematics.azimuths[0]), 0.0])
        self.rim = float(axle @ rim @ axle)
        self.roller = float(model.body_inertia[robot.rollers[0, 0]].min())
        self._gravity = -float(model.opt.gravity[2])

        mass, height, ahead = (column(body, name)[:, 0] for name in ("mass_kg", "centre_height_m", "centre_x_m"))
        rest, around, own = composite(model, [i for i in range(1, model.nbody) if i != robot.chassis])
        if (mass <= rest).any():
            raise OmniError(f"body.mass_kg must be more than the {rest:.3f} kg of the wheels, not {mass.min():g}")
        given = Mass(mass, np.column_stack([ahead, np.zeros(n), height]), column(body, "yaw_inertia_kg_m2")[:, 0])
        wheels = Mass(np.full(n, rest), np.tile(around, (n, 1)), np.full(n, own[2, 2]))
        left = given.joined(Mass(-wheels.mass, wheels.centre, -wheels.inertia))
        shift, factor = np.column_stack([drawn.centre, np.zeros(n)]), drawn.mass[:, 0]
        self.chassis = Mass(left.mass * factor, left.centre + shift, left.inertia * factor)
        self._empty = self.chassis.joined(wheels)
        self._along = np.zeros((2, n))
        self.carry(())

    def carry(self, loads: Iterable[tuple[int, float, float]]) -> Array:
        """Carry these loads and no others.

        Args:
            loads: row, mass in kg, and height above the carpet in m, or 0 for that of the chassis' centre of mass.

        Returns:
            The robots' centres of mass, (n, 3) m.
        """
        self.whole = self._empty
        for row, mass, height in loads:
            more, at = np.zeros_like(self._along[0]), self.chassis.centre.copy()
            more[row], at[row, 2] = mass, height or at[row, 2]
            self.whole = self.whole.joined(Mass(more, at, np.zeros_like(more)))
        self._stand()
        return self.whole.centre

    def lean(self, along: Array) -> None:
        """Stand on carpets that lean so that gravity has the parts `along` (n, 2) of itself along them."""
        self._along = np.ascontiguousarray(along.T)
        self._stand()

    def _stand(self) -> None:
        self.contacts = self._contacts - (self.whole.centre[:, 0] + 1j * self.whole.centre[:, 1])[:, None]
        sums = np.stack([np.ones(self.contacts.shape), self.contacts.real, self.contacts.imag], axis=1)
        shares = np.linalg.solve((sums[:, :, None] * sums[:, None]).sum(-1), sums)
        self.even, self.ahead, self.aside = np.moveaxis(shares, 1, 0)
        weight = self.whole.mass * self._gravity
        self.downhill = weight * self._along
        into = np.sqrt(np.maximum(1 - (self._along**2).sum(0), 0.0))
        self.weight = self.even * (weight * into)[:, None]

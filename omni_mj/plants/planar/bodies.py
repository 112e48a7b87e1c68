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

    def __add__(self, other: "Mass") -> "Mass":  # type: ignore[override]
        """Both together: about the common centre two bodies turn as their reduced mass does at their distance."""
        mass = self.mass + other.mass
        centre = (self.mass[:, None] * self.centre + other.mass[:, None] * other.centre) / mass[:, None]
        reduced = self.mass * other.mass / mass
        apart = ((self.centre - other.centre)[:, :2] ** 2).sum(1)
        return Mass(mass, centre, self.inertia + other.inertia + reduced * apart)


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
        downhill: acceleration along the carpet, world frame, (n, 2) m/s^2.
        load: of each wheel at rest, (n, W) N.

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
        left = given + Mass(-wheels.mass, wheels.centre, -wheels.inertia)
        shift, factor = np.column_stack([drawn.centre, np.zeros(n)]), drawn.mass[:, 0]
        self.chassis = Mass(left.mass * factor, left.centre + shift, left.inertia * factor)
        self._empty = self.chassis + wheels
        self._into, self.downhill = np.full(n, self._gravity), np.zeros((n, 2))
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
            more, at = np.zeros(len(self._into)), self.chassis.centre.copy()
            more[row], at[row, 2] = mass, height or at[row, 2]
            self.whole = self.whole + Mass(more, at, np.zeros_like(more))
        self._stand()
        return self.whole.centre

    def lean(self, along: Array) -> None:
        """Stand on carpets that lean so that gravity has the parts `along` (n, 2) of itself along them."""
        self._into = self._gravity * np.sqrt(np.maximum(1 - (along**2).sum(1), 0.0))
        self.downhill = self._gravity * along
        self._stand()

    def pressed(self, ahead: Array, aside: Array) -> Array:
        """Loads (n, W) in N while forces on the ground tilt robots back with moments (n, 1) N m, ahead and aside."""
        return self.load - ahead * self._ahead - aside * self._aside

    def warped(self, lift: Array) -> Array:
        """What is left of loads (n, W) in N that wheels want to carry more: that which no tilt of the robot evens out."""
        rest = lift - self._share[:, 0] * lift.sum(1, keepdims=True)
        rest -= self._ahead * (self._at.real * lift).sum(1, keepdims=True)
        rest -= self._aside * (self._at.imag * lift).sum(1, keepdims=True)
        return rest

    def _stand(self) -> None:
        x, y = self.whole.centre[:, 0], self.whole.centre[:, 1]
        at = self._contacts - (x + 1j * y)[:, None]
        self._at = at
        sums = np.stack([np.ones_like(at.real), at.real, at.imag], axis=1)
        self._share = share = np.linalg.solve((sums[:, :, None] * sums[:, None]).sum(-1), sums)
        self.load = share[:, 0] * (self.whole.mass * self._into)[:, None]
        self._ahead, self._aside = share[:, 1], share[:, 2]

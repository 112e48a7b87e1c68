"""Masses, inertias and wheels of robots on the plant `planar`, from their settings.

**Rollers on a carpet that gives way.** The full plant has what they do from its contacts (`omni_mj.mjcf.contact_parameters`);
here it is what they come to. A roller at the angle phi from the bottom, a barrel of the radius r and the half length
sqrt(R r) on a wheel of the radius R, is as far below the axle as its support function says,

    h(phi) = (R - r) cos phi + sqrt(r^2 cos^2 phi + R r sin^2 phi).

Robots are too heavy to follow every roller: the axle stays at a height z, and a roller with h > z stands on a spring
and a damper, on which the wheel presses it at the speed w h'(phi) as it turns at w:

    f = max(0, K (h - z) + c w h').

The mean over phi carries the load, which gives z. From the same mean follow the lever of the contacts, (h + z) / 2, on
which the wheel rolls; the torque f h' that turning costs, about proportional to w; and the lift, about proportional to
w^2: contacts press more as rollers come down than they pull as these go up, for they cannot pull. Both fade where the
wheel turns fast. The load ripples by the first harmonic of f.

**Along the axle** a roller spins at v / q as its wheel travels at v, with the distance q from its axis to the carpet.
It comes down about at rest, since its bearing (damping d) has braked it, and takes on the speed of the carpet at the
rate b while it stands, over the angle T. With the inertia I and the pitch p, the mean force over speed is

    <1 / q^2> (d T / p + (I - d / b) w / p (1 - exp(-b T / w))).

The rate is FRICTION_RATE_HZ in d / b, and SPIN_RATE_HZ, the same in steps of a cycle, in the exponential; both in 1/s.

In the second term 1 / q^2 is halfway between its mean and that where rollers come down, and T is as much shorter as
that is larger, squared: within 6 % of the sum over steps, up to 100 rad/s.
"""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.traction import GRAVITY
from omni_mj.config.robot_settings import WheelSettings
from omni_mj.config.settings import Settings, gather
from omni_mj.mjcf.contact_parameters import (
    ADDED_MASS_KG,
    FRICTION_RATE_HZ,
    FRICTION_STIFFER,
    STIFFNESS_N_M,
    compute_carpet_damping,
)
from omni_mj.mjcf.robot_geometry import compute_composite_inertia
from omni_mj.mjcf.world_builder import World
from omni_mj.plants.domain_randomization import Drawn
from omni_mj.robot.array_namespace import total
from omni_mj.robot.firmware import CYCLE_S
from omni_mj.robot.motors import Motor
from omni_mj.robot.planar_body import BodyParameters

TURNING = (
    "cost",
    "cost_fades",
    "lift",
    "lift_fades",
    "ripple",
    "ripple_grows",
)  # what `_stand` returns last
SPEEDS = 50.0, 100.0  # of a wheel at which turning is computed, rad/s
_LOADS_N = 2.0 ** np.arange(-2, 6, 0.25)  # between which is interpolated
# Of a roller's contact along the carpet
CONTACT_DAMPING_N_S_M = ADDED_MASS_KG * FRICTION_STIFFER * FRICTION_RATE_HZ
# At which rollers take on the carpet's speed, in steps of a cycle, as contacts act on the full
# plant.
SPIN_RATE_HZ = -np.log(1 - CYCLE_S * FRICTION_RATE_HZ) / CYCLE_S


class Mass(NamedTuple):
    """Masses (n,) kg, their centres (n, 3) m, and inertias about the vertical axes through these, (n,) kg m^2."""

    mass: Array
    centre: Array
    inertia: Array

    def joined(self, other: "Mass") -> "Mass":
        """Both together: about the common centre two bodies turn as their reduced mass does at their distance."""
        mass = self.mass + other.mass
        centre = (self.mass[:, None] * self.centre + other.mass[:, None] * other.centre) / mass[
            :, None
        ]
        apart = ((self.centre - other.centre)[:, :2] ** 2).sum(1)
        return Mass(
            mass, centre, self.inertia + other.inertia + self.mass * other.mass / mass * apart
        )


class PlanarBodies:
    """Bodies of n robots with equal wheels.

    Args:
        settings: One per robot.
        drawn: What sets them apart.
        world: The first of them, as modelled; its wheels are those of all.

    Raises:
        OmniError: The wheels weigh more than a robot.
    """

    def __init__(self, settings: Sequence[Settings], drawn: Drawn, world: World) -> None:
        n, model, robot, kinematics = len(settings), world.model, world.robots[0], world.kinematics
        self._settings, self._wear = settings, drawn.wear
        self._axle = kinematics.axles.T[:2, :, None] * np.ones(n)
        self._contact = kinematics.arm * self._axle[0], kinematics.arm * self._axle[1]
        self._next_wheel = np.argsort(kinematics.azimuths)
        motors = [Motor.of(s.motor) for s in settings]
        turning = gather(motors, "inertia") * gather(motors, "gear") ** 2
        self._hub = float(model.body_inertia[robot.wheels[0]].max()) + turning
        _, _, rim = compute_composite_inertia(
            model, [int(robot.rims[0]), *robot.rollers[0].tolist()]
        )
        axle = kinematics.axles[0]
        self._rim = float(axle @ rim @ axle)
        self._roller = float(model.body_inertia[robot.rollers[0, 0]].min())
        self._gravity = -float(model.opt.gravity[2])

        names = "mass_kg", "centre_height_m", "centre_x_m", "yaw_inertia_kg_m2"
        mass, height, ahead, inertia = (gather(settings, f"body.{name}") for name in names)
        wheels_mass, wheels_centre, wheels_inertia = compute_composite_inertia(
            model, [i for i in range(1, model.nbody) if i != robot.chassis]
        )
        if (mass <= wheels_mass).any():
            raise OmniError(
                f"body.mass_kg must be more than the {wheels_mass:.3f} kg of the wheels, not {mass.min():g}"
            )
        whole = Mass(mass, np.column_stack([ahead, np.zeros(n), height]), inertia)
        wheels = Mass(
            np.full(n, wheels_mass),
            np.tile(wheels_centre, (n, 1)),
            np.full(n, wheels_inertia[2, 2]),
        )
        chassis = whole.joined(Mass(-wheels.mass, wheels.centre, -wheels.inertia))
        shift, factor = np.column_stack([drawn.centre, np.zeros(n)]), drawn.mass[:, 0]
        self._chassis = Mass(
            chassis.mass * factor, chassis.centre + shift, chassis.inertia * factor
        )
        self._empty = self._chassis.joined(wheels)

    def parameters(
        self, payloads: Iterable[tuple[int, float, float]], slope: Array
    ) -> BodyParameters:
        """Return the parameters of robots that carry loads on a slope.

        Args:
            payloads: Row, mass in kg, and height above the carpet in m, or 0 for that of the
                chassis' centre of mass.
            slope: Shares of gravity along the world's x and y, positive downhill, (n, 2).
        """
        whole = self._loaded(payloads)
        settings, (axle_x, axle_y) = self._settings, self._axle
        contact_x, contact_y = (
            self._contact[0] - whole.centre[:, 0],
            self._contact[1] - whole.centre[:, 1],
        )
        weight = whole.mass * self._gravity
        shares = _load_shares(contact_x, contact_y)
        load = shares[0] * weight * np.sqrt(np.maximum(1 - (slope**2).sum(1), 0.0))
        wheels, friction = settings[0].wheels, gather(settings, "drive.roller_damping_nm_s")
        log_load = np.log(np.maximum(load, _LOADS_N[0]))
        lever, count, inverse_square, inverse_square_down, *turning = (
            np.interp(log_load, np.log(_LOADS_N), values) for values in _standing_wheels(wheels).T
        )
        lever = lever - self._wear.T
        # S for which a roller's bearing brakes it until it comes down again
        away = 2 * np.pi / SPEEDS[0]
        braked = (self._roller - friction / FRICTION_RATE_HZ) * (
            1 - np.exp(-friction / self._roller * away)
        )
        jacobian = np.stack([-axle_y, axle_x, contact_x * axle_x + contact_y * axle_y]) / lever
        along_axle = np.stack([axle_x, axle_y, contact_x * axle_y - contact_y * axle_x])
        rolling = self._rim * jacobian[:, None] * jacobian
        rolling = total(
            rolling + self._roller * count * inverse_square * along_axle[:, None] * along_axle
        )
        body = np.zeros_like(rolling)
        body[0, 0] = body[1, 1] = whole.mass
        body[2, 2] = whole.inertia
        motors, order = [Motor.of(s.motor) for s in settings], self._next_wheel
        contact, edges = np.stack([contact_x, contact_y]), np.zeros((2, *load.shape))
        edges[:, order] = contact[:, np.roll(order, -1)] - contact[:, order]
        pushed = self._chassis.centre - whole.centre
        downhill = weight[:, None] * slope
        return BodyParameters(
            contact_x=contact_x,
            contact_y=contact_y,
            edge_x=edges[0],
            edge_y=edges[1],
            jacobian=jacobian,
            inertia=(body + rolling) / CYCLE_S,
            rolling_inertia=rolling[:, :2],
            hub_gain=CYCLE_S / self._hub,
            hub_viscous=gather(motors, "wheel_viscous"),
            hub_dry=gather(settings, "hub_friction_nm") * np.ones_like(load),
            contact_softness=1 / (CONTACT_DAMPING_N_S_M * count * lever**2),
            lever=lever,
            bearing=friction * count * inverse_square,
            spin_up=braked
            * (inverse_square + inverse_square_down)
            / 2
            * wheels.rollers
            / (2 * np.pi),
            spun_at=SPIN_RATE_HZ
            * count
            * (inverse_square / inverse_square_down) ** 2
            * 2
            * np.pi
            / wheels.rollers,
            **dict(zip(TURNING, turning, strict=True)),
            passing=np.full(len(settings), CYCLE_S * wheels.rollers / (2 * np.pi)),
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

    def _loaded(self, payloads: Iterable[tuple[int, float, float]]) -> Mass:
        whole = self._empty
        for row, mass, height in payloads:
            more, at = np.zeros(len(whole.mass)), self._chassis.centre.copy()
            more[row], at[row, 2] = mass, height or at[row, 2]
            whole = whole.joined(Mass(more, at, np.zeros_like(more)))
        return whole


def _load_shares(contact_x: Array, contact_y: Array) -> Array:
    """Return the load of wheels for a force up and two moments, (3, W, n), if it falls linearly from wheel to wheel."""
    sums = np.stack([np.ones_like(contact_x), contact_x, contact_y])
    gram = total(sums[:, None] * sums).transpose(2, 0, 1)
    return np.linalg.solve(gram, sums.transpose(2, 0, 1)).transpose(1, 2, 0)


@lru_cache(maxsize=16)
def _standing_wheels(wheels: WheelSettings) -> Array:
    """Return what `_stand` does at each of the loads, (loads, 10)."""
    return np.array([_stand(wheels, load) for load in _LOADS_N])


def _stand(wheels: WheelSettings, load: float) -> tuple[float, ...]:
    """Return what rollers do to a wheel under a load (N); see the module.

    Returns:
        Lever on which it rolls, m; number of rollers that stand; 1 / q^2, its mean and where they
        come down, 1/m^2; cost and lift of turning, each with what it fades by, and the ripple of
        the load with what it grows by, as `BodyParameters` has them.
    """
    outer, radius, damper = (
        wheels.radius_m,
        wheels.roller_radius_m,
        compute_carpet_damping(load / GRAVITY),
    )
    phi = np.linspace(-np.pi / 2, np.pi / 2, 1501)
    share = (phi[1] - phi[0]) * wheels.rollers / (2 * np.pi)
    along = np.sqrt((radius * np.cos(phi)) ** 2 + outer * radius * np.sin(phi) ** 2)
    below = (outer - radius) * np.cos(phi) + along
    falling = np.gradient(below, phi)

    def force(height: float, speed: float) -> Array:
        pressed = STIFFNESS_N_M * (below - height) + damper * speed * falling
        return share * np.where(below > height, np.maximum(pressed, 0.0), 0.0)

    def height(speed: float) -> float:
        return float(brentq(lambda z: force(z, speed).sum() - load, outer / 2, outer))

    z = height(0.0)
    still, harmonic = force(z, 0.0), np.exp(1j * wheels.rollers * phi)
    turning = [force(height(speed), speed) for speed in SPEEDS]
    stands, lever = below > z, still @ (below + z) / 2 / load
    inverse_squares = ((radius**2 / along - (below - z) / 2) * np.cos(phi))[stands] ** -2
    costs = [pressed @ falling / speed for pressed, speed in zip(turning, SPEEDS, strict=True)]
    lifts = [(force(z, speed).sum() - load) / speed**2 for speed in SPEEDS]
    rest, turned = still @ harmonic, turning[0] @ harmonic
    ripple = np.pi**3 * rest.real  # of waves whose first harmonic is 1
    grows = np.copysign(np.pi**3 * (abs(turned) - abs(rest)) / SPEEDS[0], ripple)
    spins = inverse_squares.mean(), inverse_squares[0]
    return float(lever), share * stands.sum(), *spins, *_fade(*costs), *_fade(*lifts), ripple, grows


def _fade(slow: Any, fast: Any) -> tuple[Any, Any]:
    """Return a and b of a / (1 + b w), which has these values at the two speeds."""
    fades = (slow - fast) / (SPEEDS[1] * fast - SPEEDS[0] * slow)
    return slow * (1 + SPEEDS[0] * fades), fades

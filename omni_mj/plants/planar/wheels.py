"""What the wheels of robots are to the laws of a cycle, from settings, geometry and weight."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.onboard.motor import Motor
from omni_mj.plants.planar.arrays import Robots
from omni_mj.plants.planar.bodies import Bodies
from omni_mj.plants.planar.rollers import Standing
from omni_mj.plants.variation import Drawn
from omni_mj.scenarios.settings import Settings, column
from omni_mj.worlds.build import CYCLE_S
from omni_mj.worlds.contact import ADDED_MASS_KG, FRICTION_RATE_HZ, FRICTION_STIFFER, STIFFNESS_N_M, damping


def robots(settings: Sequence[Settings], geometry: Kinematics, bodies: Bodies, drawn: Drawn) -> Robots:
    """N robots of one geometry, as they stand."""
    motors, drive = [Motor.of(s.motor) for s in settings], [s.drive for s in settings]
    wheels, shape = settings[0].wheels, drawn.wear.shape
    stiff = np.array([[damping(s.body.mass_kg / shape[1])] for s in settings])
    rollers = Standing.of(wheels, bodies.weight, stiff, (bodies.roller, column(drive, "roller_damping_nm_s")))
    lever = rollers.lever - drawn.wear
    outward, arms = np.exp(1j * geometry.azimuths), bodies.contacts
    rims, axles = _along(1j * outward, arms) / lever, _along(outward, arms)
    squares, turned = _squares(rims), bodies.roller * rollers.count * rollers.spin * _squares(axles)
    mass, centre, inertia = bodies.whole
    count = rollers.count.sum(1)
    moved = mass + ADDED_MASS_KG * count
    none, pushed = np.zeros_like(mass), bodies.chassis.centre - centre
    body = np.stack([mass, none, none, mass, none, inertia])
    wheeling = bodies.rim * squares.sum(2) + turned.sum(2)
    whole = (body + wheeling) / CYCLE_S
    friction = ADDED_MASS_KG * FRICTION_STIFFER * FRICTION_RATE_HZ  # of a contact, N s/m
    contacts = np.stack([arms.real, arms.imag]).swapaxes(1, 2)
    corners = contacts[:, np.argsort(np.angle(outward))]
    found = Robots(
        outward=outward,
        contacts=contacts,
        corners=corners,
        edges=np.roll(corners, -1, axis=1) - corners,
        radius=(geometry.radius - drawn.wear).T,
        rims=rims.transpose(2, 0, 1),
        squares=squares.transpose(2, 0, 1),
        inertia=whole,
        rows=whole[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]],
        wheeling=wheeling[[[0, 1, 2], [1, 3, 4]]],
        give=(CYCLE_S / bodies.hub)[:, 0],
        viscous=column(motors, "wheel_viscous")[:, 0],
        dry=((column(motors, "wheel_dry") + column(drive, "gear_friction_nm")) * np.ones(shape)).T,
        contact=1 / (friction * rollers.count * lever**2).T,
        lever=lever.T,
        bearing=rollers.bearing.T,
        spin_up=rollers.spin_up.T,
        spin_fades=rollers.spin_fades.T,
        cost=rollers.cost.T,
        cost_fades=rollers.cost_fades.T,
        lift=rollers.lift.T,
        lift_fades=rollers.lift_fades.T,
        ripple=rollers.ripple.T,
        ripple_grows=rollers.ripple_grows.T,
        stiffens=rollers.stiffens.T,
        passing=np.full(len(mass), CYCLE_S * wheels.rollers / (2 * np.pi)),
        spring=STIFFNESS_N_M * count / moved,
        damper=stiff[:, 0] * count / moved,
        carried=mass / moved,
        middle=-centre[:, :2].T,
        pushed=pushed[:, :2].T,
        height=centre[:, 2],
        pushed_height=pushed[:, 2],
        weight=bodies.weight.T,
        even=bodies.even.T,
        ahead=bodies.ahead.T,
        aside=bodies.aside.T,
    )
    return Robots(*(np.array(each, order="C") for each in found))  # of their own: they are written to


def _along(directions: np.ndarray, arms: np.ndarray) -> Array:
    """Speeds along directions (W,) at arms (n, W) for a robot's twist, (3, n, W) 1, 1 and m."""
    each = np.broadcast_to(directions, arms.shape)
    return np.stack([each.real, each.imag, (arms.conj() * each).imag])


def _squares(speeds: Array) -> Array:
    """Products of speeds (3, n, W) for a twist: upper halves of symmetric matrices, (6, n, W)."""
    return speeds[[0, 0, 0, 1, 1, 2]] * speeds[[0, 1, 2, 1, 2, 2]]

"""Wheels that spin on the carpet and robots that coast, against Newton's and Coulomb's laws."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from omni_mj.worlds import build

AZIMUTHS = np.radians([60, 135, 225, 300])
ARM_M, RADIUS_M, MASS_KG, COM_HEIGHT_M = 0.080, 0.0285, 2.3, 0.045
GRAVITY = 9.81
# At a wheel, N m: the motor's no-load current, the gear, and lint as a share of a quarter of the weight at the rim.
DRY_FRICTION = 0.036 * 0.238 * 60 / 18 + 0.003 + 0.065 * MASS_KG * GRAVITY / 4 * RADIUS_M
# Tangents along which positive wheel speeds push the robot, in its frame (equation 3).
TANGENTS = np.stack([-np.sin(AZIMUTHS), np.cos(AZIMUTHS)], axis=1)


@dataclass
class Slide:
    """A robot at rest whose wheels are suddenly driven with far more than the carpet can bear."""

    friction: float
    velocity: NDArray  # (steps + 1, 3) of the centre of mass, m/s
    timestep: float
    cone: NDArray  # tangential over normal force of every contact in every step
    rim: float  # summed magnitude of the contacts' forces along the rims, N
    axle: float  # the same along the axles

    @property
    def acceleration(self) -> NDArray:
        """Mean over the whole slide, m/s^2."""
        return (self.velocity[-1] - self.velocity[0]) / (self.timestep * (len(self.velocity) - 1))


def contact_forces(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[NDArray, NDArray]]:
    """Of each contact the force in its own frame (normal first) and its part along rim and axle, N."""
    for index in range(data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, index, force)
        contact = data.contact[index]
        world = contact.frame.reshape(3, 3).T @ force[:3]
        (roller,) = (g for g in contact.geom if model.geom(g).name != "carpet")
        wheel = model.body_parentid[model.geom_bodyid[roller]]
        axle = data.xaxis[model.body_jntadr[wheel]]
        yield force[:3], np.abs([world @ np.cross(axle, [0, 0, 1]), world @ axle])


@lru_cache
def settled(friction: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    world = build.world()
    model = copy.copy(world.model)
    model.pair_friction[:, :2] = friction
    data = mujoco.MjData(model)
    data.qpos[:] = world.standing
    return model, data


def volts_of(twist: tuple[float, float, float], volts: float) -> NDArray:
    """Voltages (4,), the largest of them `volts`, that push along a twist."""
    speeds = TANGENTS @ twist[:2] + ARM_M * twist[2]
    return volts * speeds / np.abs(speeds).max()


def slide(friction: float, twist: tuple[float, float, float], steps: int = 192) -> Slide:
    model, start = settled(friction)
    data = copy.copy(start)
    chassis = build.world().robots[0].chassis
    # A third of the battery stalls at 36 N per rim, five times what the carpet bears, and the rollers shake little.
    data.ctrl[:] = volts_of(twist, 8.0)
    velocity, cone, rim, axle = [], [], 0.0, 0.0
    for _ in range(steps + 1):
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        velocity.append(data.subtree_linvel[chassis].copy())
        for (normal, *sliding), (along_rim, along_axle) in contact_forces(model, data):
            cone.append(np.hypot(*sliding) / normal if normal > 1e-6 else 0.0)
            rim, axle = rim + along_rim, axle + along_axle
        mujoco.mj_step(model, data)
    return Slide(friction, np.array(velocity), model.opt.timestep, np.array(cone), rim, axle)


def pull(friction: float, twist: tuple[float, float, float], volts: float, steps: int = 96) -> NDArray:
    """Mean acceleration (3,) of the centre of mass from rest, m/s^2."""
    model, start = settled(friction)
    data = copy.copy(start)
    data.ctrl[:] = volts_of(twist, volts)
    mujoco.mj_step(model, data, nstep=steps)
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    return data.subtree_linvel[build.world().robots[0].chassis] / (steps * model.opt.timestep)


@pytest.fixture(scope="module", params=[0.1, 0.3, 0.8])
def slides(request: pytest.FixtureRequest) -> dict[str, Slide]:
    return {
        "forward": slide(request.param, (1, 0, 0)),
        "left": slide(request.param, (0, 1, 0)),
        "diagonal": slide(request.param, (1, 1, 0), 96),
        "turn": slide(request.param, (0, 0, 1), 96),
    }


def test_no_contact_pulls_more_than_coulombs_law_allows(slides: dict[str, Slide]) -> None:
    for result in slides.values():
        # The elliptic cone is exact up to rounding.
        assert result.cone.max() <= result.friction * (1 + 1e-6)


def test_acceleration_stays_below_friction_times_load(slides: dict[str, Slide]) -> None:
    for result in slides.values():
        step = np.diff(result.velocity, axis=0)
        # Newton and Coulomb: |dv_xy| <= mu (g dt + dv_z) in every step, however the load swings.
        # 0.5 mm/s: momentum is evaluated at the poses of the two ends of a step, between which a robot that hops on its
        # spinning rollers pitches at 3 rad/s and more; its centre lies 45 mm up: 3^2 * 0.045 / 960 = 0.4 mm/s.
        load = GRAVITY * result.timestep + step[:, 2]
        assert (np.linalg.norm(step[:, :2], axis=1) <= result.friction * load + 5e-4).all()
        # Over many steps the swings cancel; 5 % is a rise of 0.1 m/s left at the end of 0.2 s.
        assert np.linalg.norm(result.acceleration[:2]) <= 1.05 * result.friction * GRAVITY


def test_sliding_wheels_pull_along_their_rims_with_their_share_of_the_weight(slides: dict[str, Slide]) -> None:
    # Statics: two axles at x_f and x_r carry the weight, whose line of action acceleration shifts by a h / g.
    front, rear = ARM_M * np.cos(AZIMUTHS[0]), ARM_M * np.cos(AZIMUTHS[1])
    pull_front, pull_rear = np.abs(TANGENTS[:2])
    friction = slides["forward"].friction
    share = -rear / (front - rear)  # of the weight, on the front wheels
    transfer = COM_HEIGHT_M / (front - rear) * friction
    difference = pull_front[0] - pull_rear[0]
    # f = pull_r + difference (share - transfer f), solved for f = a / (mu g).
    forward = (pull_rear[0] + difference * share) / (1 + difference * transfer)
    left = pull_rear[1] + (pull_front[1] - pull_rear[1]) * share
    # Spinning wheels hop on their rollers, and a single slide scatters by 15 %: several speeds of the wheels are
    # averaged, over 0.1 s, before the robot, which nothing holds, has turned. 10 %: the limit is to be met within that.
    volts = np.linspace(4, 9, 11)
    for axis, expected in ((0, forward), (1, left)):
        twist = (1.0, 0.0, 0.0) if axis == 0 else (0.0, 1.0, 0.0)
        pulls = [pull(friction, twist, v)[axis] for v in volts]
        assert np.mean(pulls) == pytest.approx(expected * friction * GRAVITY, rel=0.1)


def test_rollers_bear_no_force_along_the_axle(slides: dict[str, Slide]) -> None:
    for result in slides.values():
        # What makes a wheel omnidirectional. Bearings leave 1 %. What else there is spins up each roller that comes
        # down to the axle's speed v: I v / q^2 = 0.9 g v a roller, 170 rollers a second at 67 rad/s, 0.05 N at 0.3 m/s;
        # the rim's force at mu = 0.1 is 0.6 N. That is at most 8 % there, and less where the rim's force grows faster.
        assert result.axle < (0.01 + 0.008 / result.friction) * result.rim


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0)], ids=["forward", "left"])
def test_a_coasting_robot_is_slowed_by_dry_friction(direction: tuple[float, float]) -> None:
    model, start = settled(0.8)
    data, wheels = copy.copy(start), build.world().robots[0].wheel_dofs
    data.qvel[:2] = direction
    data.qvel[wheels] = TANGENTS @ direction / RADIUS_M
    speed = []
    for _ in range(240):
        data.ctrl[:] = 0.036 * 60 / 18 * data.qvel[wheels]  # open circuit: back-EMF, no current
        mujoco.mj_step(model, data)
        speed.append(data.qvel[:2] @ direction)
    # d'Alembert: m v' + sum J (b_i / r)^2 v' = -sum T |b_i| / r with b_i the tangents' parts along the motion, J the
    # inertia of wheel and geared rotor at the axle, T the dry friction of motor, gear and lint there.
    along = np.abs(TANGENTS @ direction)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    inertia = full[wheels[0], wheels[0]]
    expected = DRY_FRICTION * along.sum() / RADIUS_M / (MASS_KG + inertia * (along**2).sum() / RADIUS_M**2)
    fit = np.polyfit(np.arange(48, 240) * model.opt.timestep, speed[48:], 1)
    # Rolling on the soft carpet costs a little more than these alone, and nothing less.
    assert expected * 0.99 < -fit[0] < expected * 1.2

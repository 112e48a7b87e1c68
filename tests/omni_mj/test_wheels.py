"""Wheels on the carpet: rolling, traction and rest against rigid-body kinematics, Newton's and Coulomb's laws."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from omni_control.kinematics import Kinematics
from omni_mj import robot
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.settings import PERIOD_S, Settings

AZIMUTHS = np.radians([60, 135, 225, 300])
ARM_M, RADIUS_M, MASS_KG, COM_HEIGHT_M = 0.080, 0.0285, 2.3, 0.045
GRAVITY = 9.81
# Tangents along which positive wheel speeds push the robot, in its frame (equation 3).
TANGENTS = np.stack([-np.sin(AZIMUTHS), np.cos(AZIMUTHS)], axis=1)

EIGHT_DIRECTIONS = np.radians(np.arange(0, 360, 45))
SPEED = 0.5
# Eight translations, and both turns at the same rim speed.
TWISTS = np.concatenate(
    [
        np.stack([SPEED * np.cos(EIGHT_DIRECTIONS), SPEED * np.sin(EIGHT_DIRECTIONS), np.zeros(8)], axis=1),
        [[0, 0, SPEED / ARM_M], [0, 0, -SPEED / ARM_M]],
    ]
)


@dataclass
class Cruise:
    """Mean body twists and wheel speeds of robots that have reached their speed."""

    twist: NDArray  # (n, 3)
    wheels: NDArray  # (n, 4) rad/s


@pytest.fixture(scope="module")
def cruise() -> Cruise:
    n, start, frames = len(TWISTS), 30, 60
    plant = MujocoPlant(Settings(), np.zeros((n, 3)), [0] * n, start + frames)
    for frame in range(start):
        plant.advance(frame, TWISTS)
    pose, wheel_angle = plant.pose(), plant.telemetry().wheel_angle
    travelled = np.zeros((n, 3))
    for frame in range(start, start + frames):
        plant.advance(frame, TWISTS)
        now = plant.pose()
        step, heading = now - pose, (now + pose)[:, 2] / 2
        c, s = np.cos(heading), np.sin(heading)
        travelled += np.stack([c * step[:, 0] + s * step[:, 1], c * step[:, 1] - s * step[:, 0], step[:, 2]], axis=1)
        pose = now
    seconds = frames * PERIOD_S
    return Cruise(travelled / seconds, (plant.telemetry().wheel_angle - wheel_angle) / seconds)


def test_body_twist_is_that_of_the_measured_wheel_speeds(cruise: Cruise) -> None:
    kinematics: Kinematics = robot.kinematics(robot.load_model())
    to_rim = np.array([1, 1, ARM_M])  # turns weigh as the speed of the rim
    error = (kinematics.body_twist(cruise.wheels) - cruise.twist) * to_rim
    # The wheels sink about 0.2 mm into the soft carpet, and MuJoCo's contact point lies halfway: an effective radius
    # 0.4 % below the nominal one. The rest of the 0.5 % is slip.
    assert (np.linalg.norm(error, axis=1) <= 0.005 * np.linalg.norm(cruise.twist * to_rim, axis=1)).all()


def test_each_wheel_rolls_without_slip(cruise: Cruise) -> None:
    # Rigid body: the velocity at wheel i is v + w x p_i, and its part along the tangent is the rim's speed. Stronger
    # than the least squares of equation 3, which would average opposite slips away.
    along = cruise.twist[:, :2] @ TANGENTS.T + ARM_M * cruise.twist[:, 2:]
    fastest = np.abs(along).max(axis=1, keepdims=True)
    # 1 % of the fastest wheel: the effective radius (0.4 %), and the lightly loaded wheels' slip.
    assert (np.abs(RADIUS_M * cruise.wheels - along) <= 0.01 * fastest).all()


def test_the_wheel_loop_droops_under_the_motors_dry_friction(cruise: Cruise) -> None:
    # At a constant speed each motor's current overcomes its dry friction: (K gear + k_p) (wanted - w) = R I_0. In a
    # turn all wheels lag by that; driving forward, the lag is that of the mean of the pulls, weighted by the tangents.
    lag = 0.942 * 0.238 / (0.036 * 60 / 18 + 0.3) * RADIUS_M
    along = np.abs(TANGENTS[:, 0])
    # 2 %, half of the droop: effective radius and rolling losses, which are not in this balance.
    forward = SPEED - lag * along.sum() / (along**2).sum()
    np.testing.assert_allclose(cruise.twist[[0, 4], 0], [forward, -forward], rtol=0.02)
    turn = (SPEED - lag) / ARM_M
    np.testing.assert_allclose(cruise.twist[[8, 9], 2], [turn, -turn], rtol=0.02)


def test_a_standing_robot_does_not_creep() -> None:
    start = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 0.7], [-3.0, 1.0, 2.8]])
    plant = MujocoPlant(Settings(), start, [0, 0, 0], 130)
    stop = np.zeros((3, 3))
    for frame in range(10):  # settling into the carpet
        plant.advance(frame, stop)
    settled = plant.pose()
    for frame in range(10, 130):
        plant.advance(frame, stop)
    moved = np.abs(plant.pose() - settled)
    # A hundredth of vision's noise (1.3 mm, 10 mrad) within two seconds.
    assert moved[:, :2].max() < 13e-6
    assert moved[:, 2].max() < 1e-4
    assert np.abs(settled - start).max() < 1e-4  # nor does it jump when it settles


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
        axle = data.joint(f"wheel_{model.geom(roller).name[7]}").xaxis  # roller_1_00 is on wheel_1
        yield force[:3], np.abs([world @ np.cross(axle, [0, 0, 1]), world @ axle])


def slide(friction: float, twist: tuple[float, float, float], steps: int = 192) -> Slide:
    model = robot.load_model()
    model.pair_friction[:, :2] = friction
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 192)  # settle
    speeds = TANGENTS @ twist[:2] + ARM_M * twist[2]
    # A third of the battery stalls at 36 N per rim, five times what the carpet bears, and the rollers shake little.
    data.ctrl[:] = 8 * speeds / np.abs(speeds).max()
    velocity, cone, rim, axle = [], [], 0.0, 0.0
    for _ in range(steps + 1):
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        velocity.append(data.body("chassis").subtree_linvel.copy())
        for (normal, *sliding), (along_rim, along_axle) in contact_forces(model, data):
            cone.append(np.hypot(*sliding) / normal if normal > 1e-6 else 0.0)
            rim, axle = rim + along_rim, axle + along_axle
        mujoco.mj_step(model, data)
    return Slide(friction, np.array(velocity), model.opt.timestep, np.array(cone), rim, axle)


@pytest.fixture(scope="module", params=[0.1, 0.2, 0.4, 0.8])
def slides(request: pytest.FixtureRequest) -> dict[str, Slide]:
    return {
        "forward": slide(request.param, (1, 0, 0)),
        "left": slide(request.param, (0, 1, 0)),
        "diagonal": slide(request.param, (1, 1, 0)),
        "turn": slide(request.param, (0, 0, 1)),
    }


def test_no_contact_pulls_more_than_coulombs_law_allows(slides: dict[str, Slide]) -> None:
    for result in slides.values():
        # The elliptic cone is exact up to rounding.
        assert result.cone.max() <= result.friction * (1 + 1e-6)


def test_acceleration_stays_below_friction_times_load(slides: dict[str, Slide]) -> None:
    for result in slides.values():
        step = np.diff(result.velocity, axis=0)
        # Newton and Coulomb: |dv_xy| <= mu (g dt + dv_z) in every step, however the load swings.
        # 0.1 mm/s, 1 % of a step's share of gravity: momentum is evaluated at the poses of the two ends of a step.
        load = GRAVITY * result.timestep + step[:, 2]
        assert (np.linalg.norm(step[:, :2], axis=1) <= result.friction * load + 1e-4).all()
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
    # 6 %: spinning wheels hop on their rollers, and the mean over 0.2 s scatters by 4 % with the contacts' stiffness.
    assert slides["forward"].acceleration[0] == pytest.approx(forward * friction * GRAVITY, rel=0.06)
    assert slides["left"].acceleration[1] == pytest.approx(left * friction * GRAVITY, rel=0.06)


def test_rollers_bear_no_force_along_the_axle(slides: dict[str, Slide]) -> None:
    for result in slides.values():
        # What makes a wheel omnidirectional. Bearings and the rollers' own inertia leave about 1 %.
        assert result.axle < 0.02 * result.rim


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0)], ids=["forward", "left"])
def test_a_coasting_robot_is_slowed_by_the_motors_dry_friction(direction: tuple[float, float]) -> None:
    model = robot.load_model()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 192)
    wheels = np.array([model.joint(f"wheel_{i}").dofadr[0] for i in (1, 2, 3, 4)])
    data.qvel[:2] = direction
    data.qvel[wheels] = TANGENTS @ direction / RADIUS_M
    speed = []
    for _ in range(240):
        data.ctrl[:] = 0.036 * 60 / 18 * data.qvel[wheels]  # open circuit: back-EMF, no current
        mujoco.mj_step(model, data)
        speed.append(data.qvel[:2] @ direction)
    # d'Alembert: m v' + sum J (b_i / r)^2 v' = -sum T |b_i| / r with b_i the tangents' parts along the motion, J the
    # inertia of wheel and geared rotor at the axle, T the dry friction there.
    along = np.abs(TANGENTS @ direction)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    inertia = full[wheels[0], wheels[0]]
    torque = 0.036 * 0.238 * 60 / 18
    expected = torque * along.sum() / RADIUS_M / (MASS_KG + inertia * (along**2).sum() / RADIUS_M**2)
    fit = np.polyfit(np.arange(48, 240) * model.opt.timestep, speed[48:], 1)
    # Rolling on the soft carpet costs a little more than the motors alone, and nothing less.
    assert expected * 0.99 < -fit[0] < expected * 1.2

"""Wheels on the carpet: rolling, traction and rest against rigid-body kinematics, Newton's and Coulomb's laws."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mujoco.batch import Batch
from numpy.typing import NDArray

from omni_control.kinematics import Kinematics
from omni_mj import robot
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.settings import PERIOD_S, CarpetSettings, PhysicsSettings, RadioSettings, SensorSettings, Settings
from omni_mj.wheels import WheelGeometry, contact_slip

AZIMUTHS = np.radians([60, 135, 225, 300])
ARM_M, RADIUS_M, MASS_KG, COM_HEIGHT_M = 0.080, 0.0285, 2.3, 0.045
GRAVITY = 9.81
# At a wheel, N m: the motor's no-load current, the gear, and lint as a share of a quarter of the weight at the rim.
DRY_FRICTION = 0.036 * 0.238 * 60 / 18 + 0.003 + 0.065 * MASS_KG * GRAVITY / 4 * RADIUS_M
QUIET = Settings(sensors=SensorSettings(gyro_noise_rad_s=0.0, gyro_bias_rad_s=0.0), radio=RadioSettings(delay_frames=0))
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
    plant = MujocoPlant([QUIET] * n, np.zeros((n, 3)), [0] * n, start + frames)
    for frame in range(start):
        plant.advance(frame, TWISTS, plant.pose()[:, 2])
    pose, wheel_angle = plant.pose(), plant.telemetry().wheel_angle
    travelled = np.zeros((n, 3))
    for frame in range(start, start + frames):
        plant.advance(frame, TWISTS, plant.pose()[:, 2])
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


def test_the_wheel_loop_droops_under_dry_friction(cruise: Cruise) -> None:
    # At a constant speed each motor's current overcomes the dry friction of motor, gear and lint, and the voltage its
    # drop: (K gear + k_p) (wanted - w) = (R + X gear |w|) I. In a turn all wheels lag by that, and the turn-rate loop,
    # g = 1, halves it; driving forward, the lag is that of the mean of the pulls, weighted by the tangents.
    friction_current = DRY_FRICTION / (0.036 * 60 / 18)
    along = np.abs(TANGENTS[:, 0])

    def lag(rims: NDArray) -> NDArray:
        return (0.942 + 1.27e-3 * 60 / 18 * rims / RADIUS_M) * friction_current / (0.036 * 60 / 18 + 0.3) * RADIUS_M

    # 2 %: effective radius, rolling losses and the battery's sag, which are not in this balance.
    forward = SPEED - (lag(SPEED * along) * along).sum() / (along**2).sum()
    np.testing.assert_allclose(cruise.twist[[0, 4], 0], [forward, -forward], rtol=0.02)
    turn = (SPEED - float(lag(np.array(SPEED))) / 2) / ARM_M
    np.testing.assert_allclose(cruise.twist[[8, 9], 2], [turn, -turn], rtol=0.02)


def test_a_standing_robot_does_not_creep() -> None:
    start = np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 0.7], [-3.0, 1.0, 2.8]])
    plant = MujocoPlant([QUIET] * 3, start, [0, 0, 0], 130)
    stop = np.zeros((3, 3))
    for frame in range(10):  # settling into the carpet
        plant.advance(frame, stop, plant.pose()[:, 2])
    settled = plant.pose()
    for frame in range(10, 130):
        plant.advance(frame, stop, plant.pose()[:, 2])
    moved = np.abs(plant.pose() - settled)
    # A hundredth of vision's noise (1.3 mm, 10 mrad) within two seconds.
    assert moved[:, :2].max() < 13e-6
    assert moved[:, 2].max() < 1e-4
    assert np.abs(settled - start).max() < 1e-4  # nor does it jump when it settles


# --- slip of the contact points ---


@pytest.fixture(scope="module")
def stand() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = robot.load_model()
    return model, mujoco.MjData(model)


def pose_robot(
    stand: tuple[mujoco.MjModel, mujoco.MjData], heading: float, angles: NDArray, sunk: float = 0.0
) -> tuple[mujoco.MjModel, mujoco.MjData, list[int]]:
    """Place an upright robot; also the rollers (4) that are nearest the carpet, found from their positions."""
    model, data = stand
    mujoco.mj_resetData(model, data)
    data.qpos[:7] = [0.3, -0.2, -sunk, np.cos(heading / 2), 0, 0, np.sin(heading / 2)]
    for i, angle in enumerate(angles):
        data.qpos[model.joint(f"wheel_{i + 1}").qposadr[0]] = angle
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    wheels = [model.body(f"wheel_{i}").id for i in (1, 2, 3, 4)]
    rollers = [np.flatnonzero(model.body_parentid == wheel) for wheel in wheels]
    return model, data, [int(r[np.argmin(data.xpos[r, 2])]) for r in rollers]


def slip(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray:
    geometry = WheelGeometry.of(model)
    return contact_slip(geometry, robot.kinematics(model), data.qpos[None], data.qvel[None])[0]


# Away from the angle between two rollers, where rounding decides which of them is the nearest.
wheel_angles = st.tuples(
    *[st.tuples(st.integers(-40, 40), st.floats(-0.49, 0.49)).map(lambda r: (r[0] + r[1]) * np.pi / 8)] * 4
).map(np.array)
velocities = st.tuples(st.floats(-4, 4), st.floats(-4, 4), st.floats(-20, 20)).map(np.array)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.floats(-10, 10), wheel_angles, st.floats(0, 1e-3), st.integers(0, 2**32))
def test_contact_slip_is_the_engines_velocity_of_the_roller_under_the_axle(
    stand: tuple[mujoco.MjModel, mujoco.MjData], heading: float, angles: NDArray, sunk: float, seed: int
) -> None:
    model, data, bottom = pose_robot(stand, heading, angles, sunk)
    data.qvel[:] = np.random.default_rng(seed).normal(scale=20.0, size=model.nv)
    data.qvel[2:5] = 0.0  # upright, and neither sinking nor tilting
    measured = []
    for i, roller in enumerate(bottom):
        x, y, _ = data.body(f"wheel_{i + 1}").xpos
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, np.array([[x], [y], [0.0]]), roller)
        measured.append(np.linalg.norm((jacobian @ data.qvel)[:2]))
    # Rigid-body velocity of the roller's material point in the carpet's plane; exact up to rounding of up to 60 m/s.
    np.testing.assert_allclose(slip(model, data), measured, rtol=0, atol=1e-9)


def roll(model: mujoco.MjModel, data: mujoco.MjData, bottom: list[int], heading: float, twist: NDArray) -> NDArray:
    """Give the robot a world twist and its wheels and bottom rollers the speeds of rolling; return the axles (4, 2)."""
    place = heading + AZIMUTHS
    outward = np.stack([np.cos(place), np.sin(place)], axis=1)
    tangent = np.stack([-np.sin(place), np.cos(place)], axis=1)
    hub = twist[:2] + twist[2] * ARM_M * tangent
    data.qvel[:2], data.qvel[5] = twist[:2], twist[2]
    for i, roller in enumerate(bottom):
        centre = data.body(f"wheel_{i + 1}").xpos
        data.qvel[model.joint(f"wheel_{i + 1}").dofadr[0]] = hub[i] @ tangent[i] / centre[2]
        # A roller turns about its axis n at the lever p from it: its surface moves by s n x p, to cancel the hub's
        # velocity along the axle.
        axis = data.xaxis[model.body(roller).jntadr[0]]
        lever = np.array([centre[0], centre[1], 0.0]) - data.xpos[roller]
        surface = np.cross(axis, lever)[:2] @ outward[i]
        data.qvel[model.body(roller).dofadr[0]] = -hub[i] @ outward[i] / surface
    return outward


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.floats(-10, 10), wheel_angles, velocities)
def test_contact_slip_is_zero_when_wheels_and_rollers_roll(
    stand: tuple[mujoco.MjModel, mujoco.MjData], heading: float, angles: NDArray, twist: NDArray
) -> None:
    model, data, bottom = pose_robot(stand, heading, angles)
    roll(model, data, bottom, heading, twist)
    np.testing.assert_allclose(slip(model, data), 0.0, atol=1e-9)  # rounding


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.floats(-10, 10), wheel_angles, velocities, velocities)
def test_contact_slip_is_the_speed_at_which_a_rolling_robot_is_pushed(
    stand: tuple[mujoco.MjModel, mujoco.MjData], heading: float, angles: NDArray, twist: NDArray, push: NDArray
) -> None:
    model, data, bottom = pose_robot(stand, heading, angles)
    roll(model, data, bottom, heading, twist)
    data.qvel[:2] += push[:2]
    data.qvel[5] += push[2]
    place = heading + AZIMUTHS
    imposed = push[:2] + push[2] * ARM_M * np.stack([-np.sin(place), np.cos(place)], axis=1)
    np.testing.assert_allclose(slip(model, data), np.linalg.norm(imposed, axis=1), atol=1e-9)  # rounding


def test_the_plant_reports_slip_where_there_is_some() -> None:
    # Told to be at 2 m/s at once on ice: for a tenth of a second the wheels spin at about that speed under a robot that
    # hardly moves. On carpet at rest, nothing slides.
    ice = replace(QUIET, carpet=CarpetSettings(friction=0.02))
    plant = MujocoPlant([ice, QUIET], np.zeros((2, 3)), [0, 0], 12)
    for frame in range(12):
        plant.advance(frame, np.array([[2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), np.zeros(2))
    telemetry = plant.telemetry()
    rims = np.abs(telemetry.wheel_speed[0]) * RADIUS_M
    hub = np.abs(TANGENTS[:, 0]) * plant.pose()[0, 0] / (12 * PERIOD_S) * 2
    # 10 %: the robot's speed is taken as twice its mean, and rollers spin a little.
    np.testing.assert_allclose(telemetry.slip[0], rims - hub, rtol=0.1)
    assert telemetry.slip[0].min() > 1.0
    assert telemetry.slip[1].max() < 1e-3


# --- energy ---


class Tape:
    """Stands between a plant and its batch of one, and keeps each step's state and controls."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._live = [batch.bind(name) for name in ("qpos", "qvel", "ctrl")]
        self.steps: list[list[NDArray]] = []

    def step(self) -> None:
        self.steps.append([live[0].copy() for live in self._live])
        self._batch.step()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._batch, name)


def contact_power(model: mujoco.MjModel, data: mujoco.MjData, velocity: NDArray) -> tuple[float, float]:
    """Power of the contacts' forces against sliding and sinking, from the bodies' velocities, W."""
    sliding = sinking = 0.0
    for index in range(data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, index, force)
        contact = data.contact[index]
        (roller,) = (g for g in contact.geom if model.geom(g).name != "carpet")
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, contact.pos[:, None], model.geom_bodyid[roller])
        normal, *tangents = contact.frame.reshape(3, 3) @ jacobian @ velocity
        # The frame's normal points from the first geom to the second, the force acts on the second.
        sign = 1 if contact.geom[1] == roller else -1
        sinking += sign * force[0] * normal
        sliding += sign * force[1:3] @ tangents
    return -sliding, -sinking


# Euler at 1/960 s makes 2 % of energy (the torque of a step works on a speed that it has changed); that falls with the
# step, which shows that nothing else is missing.
@pytest.mark.parametrize(("substeps", "tolerance"), [(1, 0.03), (4, 0.015)])
def test_energy_audit_of_a_driven_robot(substeps: int, tolerance: float) -> None:
    frames = 75
    plant = MujocoPlant([replace(QUIET, physics=PhysicsSettings(substeps=substeps))], np.zeros((1, 3)), [0], frames)
    plant._batch = tape = Tape(plant._batch)  # the plant hands out one instant a frame, the audit needs every step
    electrical, reported = 0.0, []
    for frame in range(frames):
        # Speeding up forward, curving away, braking hard, then backwards and turning: the end is in full motion.
        time = frame * PERIOD_S
        twist = [1.8 * np.sin(4.5 * time), 0.8 * np.sin(3.0 * time), 4.0 * np.sin(6.0 * time)]
        plant.advance(frame, np.array([twist]), plant.pose()[:, 2])
        electrical += (plant._voltages * plant._currents).sum() / 960
        reported.append(plant.telemetry())
        np.testing.assert_array_equal(plant._currents[-1], reported[-1].current)
    model = robot.load_model()
    model.actuator_ctrllimited[:] = 0
    model.opt.timestep /= substeps
    data = mujoco.MjData(model)
    wheels = [model.joint(f"wheel_{i}").dofadr[0] for i in (1, 2, 3, 4)]
    timestep = model.opt.timestep
    heat, hinges, bearings, sliding, sinking = np.zeros(5)
    kinetic = []
    weight = 2.3 * GRAVITY
    for (qpos, qvel, ctrl), (_, after, _) in pairwise(tape.steps):
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
        mujoco.mj_forward(model, data)
        mujoco.mj_energyVel(model, data)
        kinetic.append(data.energy[1])
        # Over a step forces are constant and do work on the mean velocity.
        mean = (qvel + after) / 2
        current = data.actuator_force / 0.036
        heat += (current**2 * (0.942 + 1.27e-3 * np.abs(qvel[wheels]) * 60 / 18)).sum() * timestep
        hinges += DRY_FRICTION * np.abs(mean[wheels]).sum() * timestep
        bearings += (model.dof_damping * mean**2).sum() * timestep
        slid, sunk = contact_power(model, data, mean)
        sliding, sinking = sliding + slid * timestep, sinking + sunk * timestep
    lifted = weight * (tape.steps[-1][0][2] - tape.steps[0][0][2])
    gained = kinetic[-1] - kinetic[0]
    spent = heat + hinges + bearings + sliding + sinking + lifted + gained
    # Each of the large terms matters, so that none hides another's error.
    assert min(heat, hinges, gained) > 0.05 * electrical
    assert sliding > 0
    assert spent == pytest.approx(electrical, rel=tolerance)
    # Shares of contact damping and lift are those of a robot that shakes a little, not a store of energy.
    assert abs(sinking + lifted) < 0.03 * electrical


# --- traction ---


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


def slide(friction: float, twist: tuple[float, float, float], steps: int = 192, volts: float = 8.0) -> Slide:
    model = robot.load_model()
    model.pair_friction[:, :2] = friction
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 192)  # settle
    speeds = TANGENTS @ twist[:2] + ARM_M * twist[2]
    # A third of the battery stalls at 36 N per rim, five times what the carpet bears, and the rollers shake little.
    data.ctrl[:] = volts * speeds / np.abs(speeds).max()
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
        pulls = [slide(friction, twist, 96, v).acceleration[axis] for v in volts]
        assert np.mean(pulls) == pytest.approx(expected * friction * GRAVITY, rel=0.1)


def test_rollers_bear_no_force_along_the_axle(slides: dict[str, Slide]) -> None:
    for result in slides.values():
        # What makes a wheel omnidirectional. Bearings leave 1 %. What else there is spins up each roller that comes
        # down to the axle's speed v: I v / q^2 = 0.9 g v a roller, 170 rollers a second at 67 rad/s, 0.05 N at 0.3 m/s;
        # the rim's force at mu = 0.1 is 0.6 N. That is at most 8 % there, and less where the rim's force grows faster.
        assert result.axle < (0.01 + 0.008 / result.friction) * result.rim


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0)], ids=["forward", "left"])
def test_a_coasting_robot_is_slowed_by_dry_friction(direction: tuple[float, float]) -> None:
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
    # inertia of wheel and geared rotor at the axle, T the dry friction of motor, gear and lint there.
    along = np.abs(TANGENTS @ direction)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    inertia = full[wheels[0], wheels[0]]
    expected = DRY_FRICTION * along.sum() / RADIUS_M / (MASS_KG + inertia * (along**2).sum() / RADIUS_M**2)
    fit = np.polyfit(np.arange(48, 240) * model.opt.timestep, speed[48:], 1)
    # Rolling on the soft carpet costs a little more than these alone, and nothing less.
    assert expected * 0.99 < -fit[0] < expected * 1.2

"""The speed at which contact points of wheels without creep slide, against the engine and against imposed motion."""

import mujoco
import numpy as np
import pytest
from benches.plant import ARM_M, AZIMUTHS, FRAME_S, RADIUS_M, TANGENTS, constant, drive, quiet
from benches.plant import mujoco as plant_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omni_mj.worlds import build
from omni_mj.worlds.wheels import contact_slip

OLD = quiet(wheels={"creep": "off"})
WORLD = build.world(OLD)
ROBOT = WORLD.robots[0]


@pytest.fixture(scope="module")
def stand() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = WORLD.model
    return model, mujoco.MjData(model)


def pose_robot(
    stand: tuple[mujoco.MjModel, mujoco.MjData], heading: float, angles: NDArray, sunk: float = 0.0
) -> tuple[mujoco.MjModel, mujoco.MjData, list[int]]:
    """Place an upright robot; also the rollers (4) that are nearest the carpet, found from their positions."""
    model, data = stand
    mujoco.mj_resetData(model, data)
    data.qpos[:7] = [0.3, -0.2, -sunk, np.cos(heading / 2), 0, 0, np.sin(heading / 2)]
    data.qpos[ROBOT.wheel_qpos] = angles
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return model, data, [int(r[np.argmin(data.xpos[r, 2])]) for r in ROBOT.rollers]


def slip(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray:
    return contact_slip(WORLD.wheels, WORLD.kinematics, data.qpos[None], data.qvel[None])[0]


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
        x, y, _ = data.xpos[ROBOT.wheels[i]]
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
        centre = data.xpos[ROBOT.wheels[i]]
        data.qvel[ROBOT.wheel_dofs[i]] = hub[i] @ tangent[i] / centre[2]
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
    plant = plant_of([OLD.replace(carpet={"friction": 0.02}), OLD])
    drive(plant, constant([[2.0, 0.0, 0.0], [0.0, 0.0, 0.0]], 12, 2))
    telemetry = plant.telemetry()
    rims = np.abs(telemetry.wheel_speed[0]) * RADIUS_M
    hub = np.abs(TANGENTS[:, 0]) * plant.pose()[0, 0] / (12 * FRAME_S) * 2
    # 10 %: the robot's speed is taken as twice its mean, and rollers spin a little.
    np.testing.assert_allclose(telemetry.slip[0], rims - hub, rtol=0.1)
    assert telemetry.slip[0].min() > 1.0
    assert telemetry.slip[1].max() < 1e-3


def test_wheels_without_creep_are_those_of_a_contact_that_slides() -> None:
    """Rims that are part of their hubs, contacts with the carpet's own friction, which limits it."""
    model = WORLD.model
    assert (model.nv, ROBOT.slip_dofs.size, model.opt.impratio) == (74, 0, 10.0)
    np.testing.assert_array_equal(model.pair_solreffriction[:, :2], [[0.0035, 1.0]] * 64)
    plant = plant_of([OLD.replace(carpet={"friction": 0.3})])
    np.testing.assert_array_equal(plant._batch.expand("pair_friction")[0, :, :2], 0.3)
    poses = drive(plant, constant([3.0, 0.0, 0.0], 20, 1))
    bound = 0.5 * 0.3 * 9.81 * (20 * FRAME_S) ** 2
    assert 0.2 * bound < poses[-1, 0, 0] < bound  # drag takes a third of it, and wheels pull aside

"""The faster wheel is the same physics: what it weighs, how it drives, where it leads."""

import mujoco
import numpy as np
import pytest

from omni_control.kinematics import Array
from omni_mj.link.radio import Received
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios import scenario
from omni_mj.scenarios.settings import PERIOD_S, SensorSettings, Settings, WheelSettings
from omni_mj.simulate.simulation import Simulation
from omni_mj.worlds import contact_roller, robot

FAST = WheelSettings(model="contact-roller")


def inertia(model: mujoco.MjModel, dofs: list[int]) -> Array:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full[np.ix_(dofs, dofs)]


def test_robots_with_either_wheel_weigh_and_turn_the_same() -> None:
    models = robot.load_model(), contact_roller.load_model()
    assert [m.nv for m in models] == [74, 14]
    assert [m.npair for m in models] == [64, 4]
    matrices = [inertia(m, [*range(6), *(m.joint(f"wheel_{i + 1}").dofadr[0] for i in range(4))]) for m in models]
    # Equal up to rounding: lumping moves nothing, and a mass matrix at rest knows nothing of the rollers' own spin.
    assert matrices[1] == pytest.approx(matrices[0], rel=1e-9, abs=1e-15)


def test_velocities_in_closed_loop_profiles_agree() -> None:
    """Ramps of 1 and 3 m/s^2 in x, y and diagonally, and a turn: within 1 % rms of the highest speed."""
    quiet = Settings(sensors=SensorSettings(gyro_noise_rad_s=0, gyro_bias_rad_s=0))
    twists = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.8, -0.8, 0], [1.5, 0, 0], [0, 1.5, 0], [0, 0, 6.0]])
    rates = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 12.0])
    size = np.linalg.norm(twists, axis=1)
    velocities = []
    for settings in (quiet, quiet.replace(wheels=FAST)):
        plant, poses = MujocoPlant([settings] * 6, np.zeros((6, 3)), [0] * 6, 90), []
        for frame in range(90):
            share = np.minimum(1.0, rates * (frame + 1) * PERIOD_S / size)
            plant.advance(frame, Received.at_once(twists * share[:, None]))
            poses.append(plant.pose())
        velocities.append(np.diff(poses, axis=0) / PERIOD_S)
    along = twists / size[:, None]
    difference = ((velocities[1] - velocities[0]) * along).sum(-1)
    assert (np.sqrt((difference**2).mean(0)) < 0.01 * size).all()


def test_the_rectangle_is_driven_alike() -> None:
    """True paths within 5 mm rms, maximum errors within 10 %, per controller and seed."""
    poses, errors = [], []
    for override in ("wheels.model=rollers", "wheels.model=contact-roller"):
        simulation = Simulation(scenario.load("rect", [override], {"seeds": 2}))
        simulation.run()
        pose, ref = simulation.trajectory.channel("pose"), simulation.trajectory.channel("ref")
        poses.append(pose[..., :2])
        errors.append(np.abs(pose - ref)[..., :2].max(0))
    apart = np.sqrt(((poses[1] - poses[0]) ** 2).sum(-1).mean(0))
    assert apart.max() < 0.005
    assert errors[1] == pytest.approx(errors[0], rel=0.1)


def test_wheel_angles_go_on_while_the_model_steps_back() -> None:
    """Angle is the integral of the wheel's speed, over many hand-overs and in either direction."""
    settings = Settings(wheels=FAST)
    plant, speeds = MujocoPlant([settings] * 2, np.zeros((2, 3)), [0, 0], 60), []
    start = plant.telemetry().wheel_angle
    for frame in range(60):
        plant.advance(frame, Received.at_once(np.array([[0.6, 0, 0], [0, 0, -5.0]])))
        speeds.append(plant.telemetry().wheel_speed)
    turned = plant.telemetry().wheel_angle - start
    assert (np.abs(turned) > 10).all()
    # Rectangles of a frame under a speed that hardly changes after the first few: 1 %.
    assert turned == pytest.approx(np.sum(speeds, axis=0) * PERIOD_S, rel=0.01)

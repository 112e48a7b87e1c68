"""Laws of the whole robot on its carpet, driven through the plant with its sensors' noise off."""

import mujoco
import numpy as np
import pytest

from omni_control.kinematics import Array
from omni_mj.link.radio import Received
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.settings import PERIOD_S, FirmwareSettings, PhysicsSettings, SensorSettings, Settings
from omni_mj.worlds import robot

QUIET = Settings(sensors=SensorSettings(gyro_noise_rad_s=0, gyro_bias_rad_s=0))
# A stiff wheel loop, so that what is seen is the contact and not the firmware.
STIFF = QUIET.replace(firmware=FirmwareSettings(kp=1.0, ki=20.0, turn_gain=0.0))


def drive(settings: Settings, commands: Array, start: Array | None = None) -> tuple[MujocoPlant, Array]:
    """Obey `commands` (frames, n, 3); return the plant and the poses (frames + 1, n, 3)."""
    frames, n = commands.shape[:2]
    plant = MujocoPlant([settings] * n, np.zeros((n, 3)) if start is None else start, [0] * n, frames)
    poses = [plant.pose()]
    for frame, command in enumerate(commands):
        plant.advance(frame, Received.at_once(command))
        poses.append(plant.pose())
    return plant, np.array(poses)


def ramp(twists: Array, acceleration: float, frames: int) -> Array:
    """Commands that speed up to each twist (n, 3) at a rate (1/s^2 of the twist's size), then stay, (frames, n, 3)."""
    share = np.minimum(1.0, acceleration * PERIOD_S * np.arange(1, frames + 1))
    return share[:, None, None] * twists


def test_a_standing_robot_does_not_creep() -> None:
    _, poses = drive(QUIET, np.zeros((600, 1, 3)), np.array([[0.3, -0.2, 0.7]]))
    # 10 s; the bound, 0.1 mm, and as much at the rim of the robot for the heading.
    assert np.hypot(*(poses[-1] - poses[0])[0, :2]) < 1e-4
    assert abs(poses[-1, 0, 2] - poses[0, 0, 2]) * 0.08 < 1e-4


def test_a_robot_that_has_stopped_stays() -> None:
    """After driving, with wheels and rollers wherever they came to rest, as little creep as from the start."""
    twists = np.array([[0.7, 0.2, 0.0], [-0.3, 0.6, 2.0], [0.0, 0.0, -4.0]])
    commands = np.concatenate([np.tile(twists, (40, 1, 1)), np.zeros((660, 3, 3))])
    _, poses = drive(QUIET, commands)
    stood = poses[-1] - poses[-601]  # the last 10 s
    assert np.hypot(stood[:, 0], stood[:, 1]).max() < 1e-4
    assert np.abs(stood[:, 2]).max() * 0.08 < 1e-4


def test_driving_in_eight_directions_and_turning_follows_the_wheels() -> None:
    """No slip: the robot covers what its wheels roll, within half a per cent of the motion at 0.5 m/s."""
    angles = np.arange(8) * np.pi / 4
    twists = np.array([[0.5 * np.cos(a), 0.5 * np.sin(a), 0.0] for a in angles] + [[0, 0, 0.5 / 0.08]])
    commands = ramp(twists, 3.0, 90)
    plant = MujocoPlant([STIFF] * 9, np.zeros((9, 3)), [0] * 9, 90)
    kinematics = robot.kinematics(robot.load_model())
    for frame in range(60):
        plant.advance(frame, Received.at_once(commands[frame]))
    pose, wheels = plant.pose(), plant.telemetry().wheel_angle
    for frame in range(60, 90):
        plant.advance(frame, Received.at_once(commands[frame]))
    moved, rolled = plant.pose() - pose, kinematics.body_twist(plant.telemetry().wheel_angle - wheels)
    # The wheels' angles integrate in the body frame; headings stay within a fraction of a degree except when turning.
    along = twists / np.linalg.norm(twists, axis=1, keepdims=True)
    assert ((moved * along).sum(1) / (rolled * along).sum(1)) == pytest.approx(np.ones(9), abs=0.005)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (-1.0, 0.0)], ids=["forward", "backward"])
def test_a_robot_with_open_motors_rolls_out_as_published(direction: tuple[float, float]) -> None:
    """TIGERs publish 4.44 N for their v2016. Whether that is the force or mass times deceleration, both fit to 15 %."""
    model = robot.load_model()
    data = mujoco.MjData(model)
    data.qpos[:], _ = robot.standing(model)
    wheels = [model.joint(f"wheel_{i + 1}").dofadr[0] for i in range(4)]
    kinematics, motor = robot.kinematics(model), robot.motor(model)
    data.qvel[:2] = 1.2 * np.array(direction)
    data.qvel[wheels] = kinematics.wheel_speeds([*data.qvel[:2], 0.0])
    speed = []
    for _ in range(300):
        data.ctrl[:] = motor.constant * motor.gear * data.qvel[wheels]  # open circuit: back-EMF, no current
        mujoco.mj_step(model, data)
        speed.append(data.qvel[:2] @ direction)
    deceleration = -np.polyfit(np.arange(60, 300) * model.opt.timestep, speed[60:], 1)[0]
    mass = float(model.body("chassis").subtreemass[0])
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    rims = np.abs(kinematics.matrix[:, :2] @ direction) / kinematics.radius
    turning = (np.diag(full)[wheels] * rims**2).sum()  # what wheels and rotors add to the mass
    assert mass * deceleration == pytest.approx(4.44, rel=0.15)
    assert (mass + turning) * deceleration == pytest.approx(4.44, rel=0.15)


@pytest.mark.parametrize(("axis", "friction"), [(0, 0.4), (1, 0.4), (0, 0.8), (1, 0.8)])
def test_friction_wheel_angles_and_loads_limit_the_acceleration(axis: int, friction: float) -> None:
    """Each spinning wheel pulls along its rim with mu times its load, which acceleration shifts between the axles."""
    settings = STIFF.replace(carpet={"friction": friction})
    speeds = np.linspace(1.2, 2.0, 16)  # at once: the wheels are there in a frame, the robots are not
    twists = np.zeros((16, 3))
    twists[:, axis] = speeds
    _, poses = drive(settings, np.tile(twists, (60, 1, 1)))
    model = robot.load_model()
    kinematics, height = robot.kinematics(model), 0.045
    pull = np.abs(kinematics.matrix[:, axis])
    levers = kinematics.arm * np.stack([np.cos(kinematics.azimuths), np.sin(kinematics.azimuths)])
    # Four equal springs under a rigid body: load per mass = g / 4 + b . lever, with the moment a h to carry.
    a = friction * 9.81 * pull.mean()
    for _ in range(50):
        sums = np.array([np.ones(4), *levers])
        moments = np.array([9.81, *(-a * height * (np.arange(2) == axis))])
        load = sums.T @ np.linalg.solve(sums @ sums.T, moments)
        a = friction * float(pull @ load)
    # From the second frame, when the wheels spin, to three quarters of their speed, so that they still do at the end.
    ends = (0.75 * speeds / a / PERIOD_S).astype(int)
    measured = [2 * np.polyfit(np.arange(2, end) * PERIOD_S, poses[2:end, i, axis], 2)[0] for i, end in enumerate(ends)]
    # 10 % for the mean of 16 runs: rollers make a robot with spinning wheels hop, and single runs scatter by 15 %.
    assert np.mean(measured) == pytest.approx(a, rel=0.1)


def test_a_mirrored_command_gives_a_mirrored_path() -> None:
    """Left and right of the robot are alike: y, heading and turn rate change their sign together."""
    fine = QUIET.replace(sensors={"encoder_counts": 1_000_000})
    one = ramp(np.array([[0.6, -0.9, -2.0]]), 1.5, 60)
    _, poses = drive(fine, np.concatenate([one, one * [1, -1, -1]], axis=1))
    # Counts of an encoder are rounded downwards in either direction: a count is 2 um at the rim.
    assert poses[:, 0] * [1, -1, -1] == pytest.approx(poses[:, 1], abs=1e-6)
    assert np.hypot(*poses[-1, 0, :2]) > 0.3


def test_half_the_timestep_gives_the_same_path() -> None:
    twists = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.7, -0.7, 0.5]])
    commands = ramp(twists, 2.0, 60)
    _, coarse = drive(QUIET, commands)
    fine_settings = QUIET.replace(physics=PhysicsSettings(substeps=2))
    _, fine = drive(fine_settings, commands)
    travelled = np.linalg.norm(coarse[-1, :, :2], axis=1)
    # 2 % of the way; most of it is the wheel loop, whose sampling lag halves with the step.
    assert (np.abs(coarse - fine)[..., :2].max((0, 2)) < 0.02 * travelled).all()

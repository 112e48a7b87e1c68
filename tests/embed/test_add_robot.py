"""Robots in scenes of others drive as on the plant `mujoco`, whatever the scene."""

import copy
import pickle
from collections.abc import Sequence
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from benches.plant import FRAME_S
from benches.rolling import make_floor
from numpy.typing import NDArray

import omni_mj as om
from omni_mj.config.resolve import resolve_settings
from omni_mj.config.robot_files import find_models_folder
from omni_mj.config.rows import Row
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.mujoco_plant import MujocoPlant

ROBOTS = ("tigers-v2016", "tigers-v2020", "robojackets")
ELLIPTIC, Integrator = mujoco.mjtCone.mjCONE_ELLIPTIC, mujoco.mjtIntegrator
NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
FIELD = find_models_folder() / "field.xml"
STEPS = 16  # of the field's timestep in a frame
RANDOM = {"randomization": {"max_wear_m": 5e-4, "mass_std": 0.1, "com_offset_std_m": 0.003}}
NOISELESS = {"gyro_noise_rad_s": 0.0, "gyro_bias_rad_s": 0.0}


def make_plant(robot: str, poses: list[list[float]], seed: int = 0, **sections: Any) -> MujocoPlant:
    """Return robots of one world of the plant, whose commands never time out."""
    chosen = resolve_settings({"firmware": {"timeout_s": 0.0}, **sections}, robot)
    rows = [Row(0, slot, "", seed, chosen, robot) for slot in range(len(poses))]
    return MujocoPlant(rows, np.array(poses))


def in_body_frame(commands: NDArray) -> ReceivedCommand:
    """Return commands (n, 3) in the body frame that arrive at once, without vision."""
    n = len(commands)
    return ReceivedCommand(
        commands, np.full(n, np.nan), np.zeros(n, int), in_body_frame=np.ones(n, bool)
    )


def accelerate(twist: NDArray, time: float) -> NDArray:
    """Return the command that reaches a twist (3,) in 0.33 s, and rests from 1.2 s on."""
    return twist * np.clip(min(3 * time, 3 * (1.2 - time)), 0, 1)


def drive_on_plant(robot: str, twist: NDArray, seconds: float = 1.5, **sections: Any) -> NDArray:
    """Return the pose (3,) of a robot on the plant that drove with a twist from the origin."""
    plant = make_plant(robot, [[0, 0, 0]], **sections)
    for frame in range(round(seconds / FRAME_S)):
        plant.advance(in_body_frame(accelerate(twist, frame * FRAME_S)[None]))
    return plant.pose()[0]


def drive_in_scene(
    scene: mujoco.MjSpec, robot: Any, twist: NDArray, seconds: float = 1.5, **options: Any
) -> tuple[NDArray, NDArray]:
    """Return pose (3,) and positions (steps, 3) of a robot that drove in a scene."""
    added = om.add_robot(scene, robot, prefix="mine/", **options)
    model, data = compile_scene(scene)
    drive, positions = added.bind(model, data), []
    for _ in range(round(seconds / model.opt.timestep)):
        drive.command(accelerate(twist, data.time))
        drive.step()
        positions.append(data.body(added.chassis).xpos.copy())
    return drive.pose, np.array(positions)


@pytest.mark.parametrize(
    ("robot", "n_robots", "substeps"), [("tigers-v2020", 1, 1), ("tigers-v2016", 2, 2)]
)
def test_on_the_field_it_has_the_bits_of_the_plant(
    robot: str, n_robots: int, substeps: int
) -> None:
    """Random commands from a random pose; two robots hit each other."""
    seed = 7
    rng = np.random.default_rng(seed)
    poses = [[0.4 * slot, 0.1 * slot, heading] for slot, heading in enumerate(rng.normal(size=2))]
    # The noise of a plant's second robot is another one than that of a drive.
    sections: dict[str, Any] = {"sensors": NOISELESS} if n_robots > 1 else {}
    plant = make_plant(robot, poses[:n_robots], seed, physics={"substeps": substeps}, **sections)
    scene = mujoco.MjSpec.from_file(str(FIELD))
    scene.option.timestep /= substeps
    added = [
        om.add_robot(scene, robot, prefix=f"robot_{slot}/", pose=pose, **sections)
        for slot, pose in enumerate(poses[:n_robots])
    ]
    model, data = compile_scene(scene)
    drives = [robot.bind(model, data, seed=seed) for robot in added]
    commands = rng.normal(size=(30, n_robots, 3))
    heading = poses[0][2]
    commands[:, 0, :2] = 2 * np.cos(heading), -2 * np.sin(heading)  # towards the other robot
    for frame_commands in commands:
        plant.advance(in_body_frame(frame_commands))
        for drive, command in zip(drives, frame_commands, strict=True):
            drive.command(command)
        for _ in range(STEPS * substeps):
            advance(drives)
    telemetry = plant.telemetry()
    for row, drive in enumerate(drives):
        assert (drive.pose[:2] == plant.pose()[row, :2]).all()
        assert (drive.winding_temperatures == telemetry.winding[row]).all()
        assert (drive.currents == telemetry.current[row]).all()
        assert drive.battery_voltage == telemetry.battery[row]


RNG = np.random.default_rng(12)
FAST_TWIST = np.array([*RNG.uniform(-1.5, 1.5, 2), RNG.uniform(-4, 4)])  # 4.6 m/s^2


@cache
def pose_on_plant(robot: str) -> NDArray:
    return drive_on_plant(robot, FAST_TWIST)


# The gain of the robot tigers-v2020 needs steps of at most 3.7 ms.
@pytest.mark.parametrize(
    ("robot", "options", "tolerance"),
    [
        ("tigers-v2016", {"timestep": 0.001}, 0.02),
        ("tigers-v2020", {"timestep": 0.002}, 0.02),
        ("robojackets", {"timestep": 0.002, "integrator": Integrator.mjINT_IMPLICITFAST}, 0.02),
        ("tigers-v2016", {"timestep": 0.002, "integrator": Integrator.mjINT_RK4}, 0.02),
        ("tigers-v2020", {"timestep": 0.002, "cone": ELLIPTIC, "impratio": 10.0}, 0.02),
        ("robojackets", {"timestep": 0.005}, 0.03),
    ],
)
def test_it_drives_as_on_the_plant_with_any_options(
    robot: str, options: dict[str, Any], tolerance: float
) -> None:
    """Creep, drag and motors bring it to the same pose; it does not hop."""
    reference = pose_on_plant(robot)
    pose, positions = drive_in_scene(make_floor("plane", **options), robot, FAST_TWIST)
    assert np.hypot(*(pose - reference)[:2]) < tolerance * np.hypot(*reference[:2])
    assert abs(np.sin(pose[2] - reference[2])) < 0.05
    assert np.ptp(positions[len(positions) // 10 :, 2]) < 2e-4


@pytest.mark.parametrize("azimuths", [(60, 180, 300), (30, 100, 180, 260, 330), range(0, 360, 60)])
def test_robots_of_three_to_six_wheels_drive_as_on_the_plant(azimuths: Sequence[int]) -> None:
    wheels = {"azimuths_deg": tuple(azimuths)}
    twist = np.array([0.5, -0.4, 2.0])
    reference = drive_on_plant("tigers-v2016", twist, wheels=wheels)
    pose, _ = drive_in_scene(make_floor("box"), "tigers-v2016", twist, wheels=wheels)
    np.testing.assert_allclose(pose, reference, atol=0.01)


@pytest.mark.parametrize("degrees", [3, 12])
def test_it_drives_uphill_as_the_plant_under_tilted_gravity(degrees: float) -> None:
    """It stands on the slope from the start, and its carpet has the slope's inclination."""
    twist = np.array([0.7, 0.3, 0.0])
    tilt = {"kind": "tilt", "angle_deg": degrees, "direction_deg": 180.0, "start_s": 0.0}
    reference = drive_on_plant("tigers-v2016", twist, fault=[tilt])
    scene, half = mujoco.MjSpec(), np.radians(degrees) / 2
    slope = [np.cos(half), 0, -np.sin(half), 0]
    scene.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[9, 9, 1], quat=slope)
    _, positions = drive_in_scene(scene, "tigers-v2016", twist)
    along = np.array([np.cos(2 * half), 0, np.sin(2 * half)])
    moved = positions[-1]
    np.testing.assert_allclose([moved @ along, moved[1]], reference[:2], atol=0.01)
    normal = np.array([-np.sin(2 * half), 0, np.cos(2 * half)])
    assert np.abs(positions @ normal).max() < 2e-4


SLOW_TWIST = np.array([0.5, 0.3, 1.0])


@cache
def pose_on_plane() -> NDArray:
    return drive_in_scene(make_floor("plane"), "tigers-v2016", SLOW_TWIST, seconds=0.6)[0]


@pytest.mark.parametrize(
    "floor",
    [
        "<geom type='plane' size='5 5 1' condim='6' friction='0.1 0.1 0.1' priority='5'/>",
        "<geom type='plane' size='5 5 1' margin='0.03'/>",
        "<geom type='plane' size='5 5 1' contype='4' conaffinity='4'/>",
        "<geom type='box' size='5 5 0.1' pos='0 0 -0.15' gap='0.01'/>",
        "<body mocap='true'><geom type='box' size='5 5 0.1'/></body>",
        "<body><joint type='slide'/><geom type='box' size='5 5 0.1' mass='1e4'/></body>",
    ],
)
def test_any_geom_is_a_floor(floor: str) -> None:
    """Its own friction, bits, margin, height and joint do not matter."""
    defaults = "<geom margin='0'/><joint armature='1' damping='1' frictionloss='2'/>"
    scene = mujoco.MjSpec.from_string(
        f"<mujoco><compiler angle='radian'/><option gravity='0 0 -9.81'/>"
        f"<default>{defaults}</default><worldbody>{floor}</worldbody>"
        "<keyframe><key name='any'/></keyframe></mujoco>"
    )
    for joint in scene.joints:
        joint.axis = [1, 0, 0]
    pose, positions = drive_in_scene(scene, "tigers-v2016", SLOW_TWIST, seconds=0.6)
    np.testing.assert_allclose(pose, pose_on_plane(), atol=2e-3)
    assert np.ptp(positions[:, 2]) < 2e-4


def test_on_an_uneven_floor_it_follows_the_floor() -> None:
    """A height field of waves of 2 cm and 3 m: the robot's center stays near the floor."""
    x, y = np.meshgrid(np.linspace(-3, 3, 121), np.linspace(-3, 3, 121))
    waves = 0.5 + 0.25 * (np.sin(2 * x) + np.cos(2 * y))  # of 4 cm
    scene = mujoco.MjSpec()
    scene.add_hfield(
        name="waves", nrow=121, ncol=121, size=[3, 3, 0.04, 0.1], userdata=waves.ravel()
    )
    scene.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="waves")
    twist = np.array([0.9, 0.5, 0.0])
    _, positions = drive_in_scene(scene, "tigers-v2016", twist, pose=(-0.5, 0.2, 0.3))
    # A height field spans from the lowest to the highest of its values.
    floor = 0.04 * (0.5 + 0.25 * (np.sin(2 * positions[:, 0]) + np.cos(2 * positions[:, 1])))
    assert np.ptp(positions[:, 0]) > 0.4
    # The wheels' arm is 83 mm: a chord of that length is at most 2 mm from these waves.
    assert np.abs(positions[:, 2] - floor).max() < 2e-3


def test_it_carries_an_arm_and_leaves_other_motors_alone() -> None:
    """An arm of 0.5 kg with its motor swings on the chassis. A fallen robot stays on the floor."""
    scene = make_floor("plane")
    carrier = om.add_robot(scene, prefix="carrier/")
    fallen = om.add_robot(scene, "tigers-v2020", prefix="fallen/", pose=(2.0, 0.0, 0.0))
    arm = scene.body(carrier.chassis).add_body(pos=[0, 0, 0.17])
    arm.add_joint(name="shoulder", axis=[0, 0, 1])
    arm.add_geom(
        name="arm",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, 0, 0.1, 0, 0],
        size=[0.01] * 3,
        mass=0.5,
        margin=0.002,
    )
    motor = scene.add_actuator(
        name="shoulder", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="shoulder"
    )
    motor.set_to_position(kp=2.0, kv=0.2)
    model, data = compile_scene(scene)
    drives = [robot.bind(model, data) for robot in (carrier, fallen)]
    free_joint = model.joint("fallen/robot").qposadr[0]
    data.qpos[free_joint + 2 : free_joint + 7] = 0.3, 0.5, 0.8, 0.2, 0.1
    data.actuator("shoulder").ctrl[0] = 1.0
    twist = np.array([0.7, 0.0, 0.0])
    for _ in range(500):
        for drive in drives:
            drive.command(accelerate(twist, data.time))
        advance(drives)
    assert data.actuator("shoulder").ctrl[0] == 1.0
    assert model.geom("arm").margin[0] == 0.002
    assert data.joint("shoulder").qpos[0] == pytest.approx(1.0, abs=0.1)
    payload = {"kind": "payload", "mass_kg": 0.5, "height_m": 0.17, "start_s": 0.0}
    loaded = drive_on_plant("tigers-v2016", twist, seconds=1.0, fault=[payload])
    assert drives[0].pose[0] == pytest.approx(loaded[0], rel=0.01)
    assert data.body("fallen/chassis").xpos[2] > -1e-3
    assert np.abs(data.qvel).max() < 60


def test_each_kind_of_command_reaches_the_motors() -> None:
    """Wheel speeds and velocities of a turn; a motor's voltage equation; held currents; a push."""
    robot, model, data = add_to_plane("tigers-v2016")
    drive = robot.bind(model, data)
    motor, arm = robot.settings.motor, robot.settings.wheels.arm_m
    step(drive, 250, wheel_speeds=[20.0] * 4)
    turn_rate = 20.0 * robot.settings.wheels.radius_m / arm
    assert drive.gyro == pytest.approx(turn_rate, rel=0.1)  # a P loop lags
    by_wheel_speeds = drive.pose
    drive.reset()
    step(drive, 250, velocity=[0.0, 0.0, turn_rate])
    assert np.sin(by_wheel_speeds[2] - drive.pose[2]) == pytest.approx(0.0, abs=0.2)

    drive.reset()
    step(drive, 400, voltages=[3.0] * 4)
    np.testing.assert_allclose(drive.voltages, 3.0)
    speeds = np.array([data.joint(f"robot_wheel_{i}").qvel[0] for i in (1, 2, 3, 4)])
    resistance = motor.resistance_ohm + motor.commutation_ohm_s * motor.gear_ratio * speeds
    current = (3.0 - motor.wheel_back_emf_v_s * speeds) / resistance
    np.testing.assert_allclose(drive.currents, current, rtol=0.02)

    drive.reset()
    assert drive.encoders == pytest.approx(0.0, abs=0.01)
    step(drive, 100, currents=[0.7] * 4)
    np.testing.assert_allclose(drive.currents, 0.7)
    assert (drive.encoders > 0.1).all()

    drive.reset()
    drive.set_push_force([0.0, 12.0])
    step(drive, 100, velocity=[0.0, 0.0, 0.0])
    assert drive.pose[1] > 0.002 > abs(drive.pose[0])


def test_mistakes_get_one_message() -> None:
    scene = make_floor("plane")
    robot = om.add_robot(scene, prefix="a_")
    mistakes: dict[str, dict[str, Any]] = {
        "give the robot another prefix": {"prefix": "a_"},
        "cannot have fault": {"fault": [{"kind": "push"}]},
        "did you mean": {"carpet": {"frictoin": 1}},
        "pose must be finite": {"pose": (0, 0)},
    }
    for message, options in mistakes.items():
        with pytest.raises(om.OmniError, match=message):
            om.add_robot(scene, **{"prefix": "b_"} | options)
    model, data = compile_scene(scene)
    other, other_data = compile_scene(make_floor("plane"))
    with pytest.raises(om.OmniError, match="no body 'a_chassis'"):
        robot.bind(other, other_data)
    drive = robot.bind(model, data)
    for command in ({}, {"velocity": [0, 0]}, {"voltages": [np.nan] * 4}, {"currents": 1}):
        with pytest.raises(om.OmniError):
            drive.command(**command)
    with pytest.raises(om.OmniError, match="not 2"):
        drive.command([0, 0, 0], voltages=[0] * 4)
    step(drive, 5, velocity=[0, 0, 0])
    mujoco.mj_resetData(model, data)
    with pytest.raises(om.OmniError, match="reset of the drive"):
        drive.step()
    drive.reset()
    drive.step()
    mujoco.mj_step(model, data)
    with pytest.raises(om.OmniError, match="without the drive"):
        drive.step()
    drive.reset()
    drive.before_step()
    mujoco.mj_step(model, data, nstep=2)
    with pytest.raises(om.OmniError, match="not advanced by one step"):
        drive.after_step()
    with pytest.raises(om.OmniError, match="call before_step, mj_step and after_step in turn"):
        drive.before_step()
    with pytest.raises(om.OmniError, match="another model"):
        robot.bind(model, other_data)


def test_it_is_put_on_the_floor_near_its_height() -> None:
    """A shelf above, a floor that is too high, and none."""
    scene = make_floor("plane")
    scene.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.5, 0.5, 0.02], pos=[0, 0, 0.27]
    )
    below = om.add_robot(scene, prefix="below_")
    above = om.add_robot(scene, prefix="above_", height=0.3)
    outside = om.add_robot(scene, prefix="outside_", height=1.0)
    model, data = compile_scene(scene)
    for robot, height in ((below, 0.0), (above, 0.29)):
        robot.bind(model, data)
        assert data.body(robot.chassis).xpos[2] == pytest.approx(height, abs=1e-3)
    with pytest.raises(om.OmniError, match="no floor below the wheels of 'outside_chassis'"):
        outside.bind(model, data)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (make_floor("plane", timestep=0.006), "scene is 0.006 s; wheels need at most 0.005 s"),
        (make_floor("plane", disableflags=NO_CONTACT), "disable contact"),
        (make_floor("plane", timestep=0.005), "wheel loops of the robot tigers-v2020 need at most"),
        (mujoco.MjSpec(), "needs a floor"),
    ],
)
def test_scenes_in_which_it_cannot_roll_are_refused(scene: mujoco.MjSpec, message: str) -> None:
    robot = om.add_robot(scene, "tigers-v2020")
    with pytest.raises(om.OmniError, match=message):
        robot.bind(*compile_scene(scene))


def test_drives_of_one_model_share_its_data_and_each_robot_has_one() -> None:
    """A second drive is refused. In a copied model it drives as the first one, to the bit."""
    scene, robots = make_two_robots()
    model, data = compile_scene(scene)
    drives = [robots[0].bind(model, data)]
    with pytest.raises(om.OmniError, match="already has a drive of 'a_chassis'"):
        robots[1].bind(model, mujoco.MjData(model))
    drives.append(robots[1].bind(model, data))
    expected = drive_all(drives)
    message = "already has a drive of '[ab]_chassis'.*copy.deepcopy"
    for other_data in (data, mujoco.MjData(model)):
        with pytest.raises(om.OmniError, match=message):
            robots[0].bind(model, other_data)
    with pytest.raises(om.OmniError, match=message):
        copy.copy(drives[0])
    twin = pickle.loads(pickle.dumps(drives[0]))
    with pytest.raises(om.OmniError, match=message):
        robots[0].bind(twin.model, twin.data)
    copied_model = copy.deepcopy(model)
    copied_data = mujoco.MjData(copied_model)
    copies = [robot.bind(copied_model, copied_data) for robot in robots]
    np.testing.assert_array_equal(drive_all(copies), expected)
    drives.clear()
    mujoco.mj_resetData(model, data)
    drives = [robot.bind(model, data) for robot in robots]
    np.testing.assert_array_equal(drive_all(drives), expected)


def test_a_reset_repeats_the_bits() -> None:
    """Heat, battery, integrators, encoders and noise start anew, whatever resets the scene."""
    scene, robots = make_two_robots()
    scene.add_key(time=7.0)
    model, data = compile_scene(scene)
    drives = [robot.bind(model, data, seed=3) for robot in robots]
    expected = drive_all(drives)
    for reset_data in (
        lambda: mujoco.mj_resetData(model, data),
        lambda: mujoco.mj_resetDataKeyframe(model, data, 0),
        lambda: None,
    ):
        reset_data()
        for drive in drives:
            drive.reset()
        np.testing.assert_array_equal(drive_all(drives), expected)


def test_a_scene_may_be_attached_with_a_prefix_and_moved() -> None:
    """The robot drives from its moved start; of two copies, each robot is chosen by its prefix."""
    twist, turn = np.array([0.6, 0.3, 1.0]), 0.5
    scene = make_floor("plane")
    robot = om.add_robot(scene, prefix="a_", pose=(0.2, 0.1, 0.3))
    outer = mujoco.MjSpec()
    outer.option.timestep = scene.option.timestep
    quaternion = [np.cos(turn / 2), 0, 0, np.sin(turn / 2)]
    for i, prefix in enumerate(("left/", "right/")):
        frame = outer.worldbody.add_frame(pos=[1 + 50 * i, 2, 0.5], quat=quaternion)
        outer.attach(scene.copy(), prefix=prefix, frame=frame)
        model = outer.compile()
        data = mujoco.MjData(model)
        if not i:
            drives = [robot.bind(model, data)]
    with pytest.raises(om.OmniError, match="scene_prefix=, one of 'left/', 'right/'"):
        robot.bind(model, data)
    drives += [robot.bind(model, data, scene_prefix=prefix) for prefix in ("left/", "right/")]
    cosine, sine = np.cos(turn), np.sin(turn)
    for drive, x in zip(drives, (1, 1, 51), strict=True):
        start = [x + 0.2 * cosine - 0.1 * sine, 2 + 0.2 * sine + 0.1 * cosine, 0.3 + turn]
        np.testing.assert_allclose(drive.pose, start, atol=1e-9)
    plain = robot.bind(*compile_scene(scene))
    step(plain, 200, velocity=twist)
    step(drives[0], 200, velocity=twist)
    x, y, heading = plain.pose
    moved = [1 + cosine * x - sine * y, 2 + sine * x + cosine * y, heading + turn]
    np.testing.assert_allclose(drives[0].pose, moved, atol=3e-3)


def test_a_drive_follows_a_scene_that_is_compiled_again_in_motion() -> None:
    """With another body before its own, it drives on as without; another robot is refused."""
    scene, robots = make_two_robots()
    model, data = compile_scene(scene)
    drives = [robot.bind(model, data) for robot in robots]
    drive_all(drives)
    undisturbed, twins = copy.deepcopy(drives), copy.deepcopy(drives)
    box = scene.worldbody.add_body(pos=[5, 5, 1])
    box.add_freejoint()
    box.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1])
    new_model, new_data = scene.recompile(model, data)
    with pytest.raises(om.OmniError, match="no body 'a_chassis'"):
        drives[0].follow(*compile_scene(make_floor("plane")))
    assert drives[0].model is model, "it stays"
    for drive in drives:
        drive.follow(new_model, new_data)
    values, expected = drive_all(drives), drive_all(undisturbed)
    np.testing.assert_array_equal(drive_all(twins), expected)
    assert drives[0].data.time == undisturbed[0].data.time
    np.testing.assert_allclose(values[:, :3], expected[:, :3], atol=5e-3)
    temperature, charge = values[:, 3:].T
    np.testing.assert_allclose(temperature, expected[:, 3], atol=0.02)
    assert (temperature > 25.3).all()
    np.testing.assert_allclose(charge, expected[:, 4], rtol=1e-5)
    assert (charge < 0.99999).all()
    with pytest.raises(om.OmniError, match="already has a drive"):
        robots[0].bind(new_model, new_data)
    robots[0].bind(model, data)  # the drives have left it


def test_the_gyro_has_bias_and_noise() -> None:
    """At rest it shows them alone: a constant bias per seed, and the noise of each frame."""
    settings = {"gyro_bias_rad_s": 0.5, "gyro_noise_rad_s": 0.02}
    biases, n_frames = [], 40
    for seed in range(4):
        scene = make_floor("plane", timestep=FRAME_S / 4)
        robot = om.add_robot(scene, sensors=settings)
        drive = robot.bind(*compile_scene(scene), seed=seed)
        drive.command(currents=[0.0] * 4)
        frames = []
        for _ in range(n_frames):
            for _ in range(4):
                drive.step()
            frames.append(drive.gyro)
        biases.append(np.mean(frames))
        # The standard deviation of n normal numbers is uncertain by its (2 n)^-0.5-fold part.
        noise = np.std(frames)
        assert noise == pytest.approx(0.02, rel=4 / np.sqrt(2 * n_frames))
    spread = np.sqrt(np.mean(np.square(biases)))
    assert 0.08 < spread < 1.1, "within the 99.8 % of four draws"
    assert len(set(biases)) == 4


def make_two_robots() -> tuple[mujoco.MjSpec, list[Any]]:
    """Return a plane with two robots whose bodies and sensors vary."""
    scene = make_floor("plane")
    return scene, [
        om.add_robot(scene, name, prefix=prefix, pose=pose, **RANDOM)
        for name, prefix, pose in (
            ("tigers-v2016", "a_", (0.0, 0.0, 0.0)),
            ("tigers-v2020", "b_", (0.8, 0.0, 2.0)),
        )
    ]


def drive_all(drives: list[Any], n_steps: int = 60) -> NDArray:
    """Drive robots in one scene; return their poses, hottest windings and charges, (n, 5)."""
    for drive in drives:
        drive.command([1.5, -0.7, 2.0])
    for _ in range(n_steps):
        advance(drives)
    return np.array(
        [[*d.pose, d.winding_temperatures.max(), d.battery_charge] for d in drives], float
    )


def test_wheels_sink_in_with_the_square_of_steps_longer_than_2_ms() -> None:
    """Loads at rest are equal, so depths are inverse to the stiffness of the contacts."""
    depths = []
    for timestep in (0.001, 0.002, 0.003, 0.005):
        robot, model, data = add_to_plane("robojackets", timestep=timestep)
        drive = robot.bind(model, data)
        step(drive, round(0.4 / timestep), currents=np.zeros(4))
        depths.append(-data.contact.dist.sum())
    assert np.divide(depths, depths[1]) == pytest.approx([1, 1, 1.5**2, 2.5**2], rel=1e-3)


def compile_scene(scene: mujoco.MjSpec) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = scene.compile()
    return model, mujoco.MjData(model)


def add_to_plane(name: str, **options: Any) -> tuple[Any, mujoco.MjModel, mujoco.MjData]:
    """Return a robot without prefix on a plane, and the scene."""
    scene = make_floor("plane", **options)
    return om.add_robot(scene, name), *compile_scene(scene)


def advance(drives: list[Any]) -> None:
    """Advance the scene of some drives by one step."""
    for drive in drives:
        drive.before_step()
    mujoco.mj_step(drives[0].model, drives[0].data)
    for drive in drives:
        drive.after_step()


def step(drive: Any, n_steps: int, **command: Any) -> None:
    """Advance a scene under one command."""
    drive.command(**command)
    for _ in range(n_steps):
        drive.step()

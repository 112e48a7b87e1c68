"""Laws of the whole robot on its carpet, driven through the plant with its sensors' noise off."""

import copy

import mujoco
import numpy as np
import pytest
from driving import FRAME_S, constant, drive, quiet, ramp
from driving import mujoco as plant_of

from omni_mj.worlds import build

# A stiff wheel loop, so that what is seen is the contact and not the firmware.
STIFF = {"firmware": {"kp": 1.0, "ki": 20.0, "turn_gain": 0.0}}


def test_a_robot_that_stands_or_has_stopped_does_not_creep() -> None:
    """From the start, and after driving, with wheels and rollers wherever they came to rest."""
    twists = np.array([[0.0, 0.0, 0.0], [0.7, 0.2, 0.0], [-0.3, 0.6, 2.0], [0.0, 0.0, -4.0]])
    start = np.array([[0.3, -0.2, 0.7], *np.zeros((3, 3))])
    commands = np.concatenate([constant(twists, 30, 4), constant([0, 0, 0], 240, 4)])
    poses = drive(plant_of([quiet()] * 4, start), commands)
    stood = poses[-1] - poses[-181]  # the last 3 s
    # A league's bound of 0.1 mm in 10 s, and as much at the rim of the robot for the heading.
    assert np.hypot(stood[:, 0], stood[:, 1]).max() < 0.3e-4
    assert np.abs(stood[:, 2]).max() * 0.08 < 0.3e-4
    assert np.abs(poses[-1, 0] - start[0]).max() < 1e-4, "nor does it jump when it settles"


@pytest.mark.parametrize("direction", [(1.0, 0.0), (-1.0, 0.0)], ids=["forward", "backward"])
def test_a_robot_with_open_motors_rolls_out_as_published(direction: tuple[float, float]) -> None:
    """TIGERs publish 4.44 N for their v2016. Whether that is the force or mass times deceleration, both fit to 15 %."""
    world = build.world()
    model, kinematics, motor = world.model, world.kinematics, world.motor
    data = mujoco.MjData(model)
    data.qpos[:], wheels = world.standing, world.robots[0].wheel_dofs
    data.qvel[:2] = 1.2 * np.array(direction)
    data.qvel[wheels] = kinematics.wheel_speeds([*data.qvel[:2], 0.0])
    speed = []
    for _ in range(300):
        data.ctrl[:] = motor.constant * motor.gear * data.qvel[wheels]  # open circuit: back-EMF, no current
        mujoco.mj_step(model, data)
        speed.append(data.qvel[:2] @ direction)
    deceleration = -np.polyfit(np.arange(60, 300) * model.opt.timestep, speed[60:], 1)[0]
    mass = float(model.body_subtreemass[world.robots[0].chassis])
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    rims = np.abs(kinematics.matrix[:, :2] @ direction) / kinematics.radius
    turning = (np.diag(full)[wheels] * rims**2).sum()  # what wheels and rotors add to the mass
    assert mass * deceleration == pytest.approx(4.44, rel=0.15)
    assert (mass + turning) * deceleration == pytest.approx(4.44, rel=0.15)


def test_friction_wheel_angles_and_loads_limit_the_acceleration() -> None:
    """Each spinning wheel pulls along its rim with mu times its load, which acceleration shifts between the axles."""
    kinematics, height = build.world().kinematics, 0.045
    levers = kinematics.arm * np.stack([np.cos(kinematics.azimuths), np.sin(kinematics.azimuths)])
    speeds = np.linspace(1.2, 2.0, 12)  # at once: the wheels are there in a frame, the robots are not
    for friction in (0.4, 0.8):
        twists, expected = np.zeros((2, 12, 3)), []
        for axis in (0, 1):
            twists[axis, :, axis] = speeds
            pull = np.abs(kinematics.matrix[:, axis])
            # Four equal springs under a rigid body: load per mass = g / 4 + b . lever, with the moment a h to carry.
            a = friction * 9.81 * pull.mean()
            for _ in range(50):
                sums = np.array([np.ones(4), *levers])
                moments = np.array([9.81, *(-a * height * (np.arange(2) == axis))])
                load = sums.T @ np.linalg.solve(sums @ sums.T, moments)
                a = friction * float(pull @ load)
            expected.append(a)
        # From the second frame, when the wheels spin, to three quarters of their speed, so that they still do then.
        ends = (0.75 * speeds / np.array(expected)[:, None] / FRAME_S).astype(int)
        settings = quiet(carpet={"friction": friction}, **STIFF)
        poses = drive(plant_of([settings] * 24), constant(twists.reshape(24, 3), ends.max(), 24))
        for axis in (0, 1):
            x = poses[:, 12 * axis : 12 * (axis + 1), axis]
            fits = [np.polyfit(np.arange(2, end) * FRAME_S, x[2:end, i], 2)[0] for i, end in enumerate(ends[axis])]
            # 10 % for the mean of 12 runs: rollers make a robot with spinning wheels hop, and single runs scatter by
            # 15 %.
            assert 2 * np.mean(fits) == pytest.approx(expected[axis], rel=0.1)


def test_a_mirrored_command_gives_a_mirrored_path() -> None:
    """Left and right of the robot are alike: y, heading and turn rate change their sign together."""
    one = np.array([0.6, -0.9, -2.0])
    commands = ramp([one, one * [1, -1, -1]], 1.5 * np.linalg.norm(one), 40)
    poses = drive(plant_of([quiet(sensors={"encoder_counts": 1_000_000})] * 2), commands)
    # Counts of an encoder are rounded downwards in either direction: a count is 2 um at the rim.
    assert poses[:, 0] * [1, -1, -1] == pytest.approx(poses[:, 1], abs=1e-6)
    assert np.hypot(*poses[-1, 0, :2]) > 0.2


def test_half_the_timestep_gives_the_same_path() -> None:
    commands = ramp([[1.0, 0, 0], [0, 1.0, 0], [0.7, -0.7, 0.5]], 2.0, 45)
    coarse, fine = (drive(plant_of([quiet(physics={"substeps": steps})] * 3), commands) for steps in (1, 2))
    travelled = np.linalg.norm(coarse[-1, :, :2], axis=1)
    # 2 % of the way; most of it is the wheel loop, whose sampling lag halves with the step.
    assert (np.abs(coarse - fine)[..., :2].max((0, 2)) < 0.02 * travelled).all()


def test_what_is_shared_of_a_world_is_left_as_it_was() -> None:
    before = copy.copy(build.world().model)
    drive(plant_of([quiet(carpet={"friction": 0.3}, physics={"substeps": 2})]), constant([1, 0, 0], 2, 1))
    for name in ("actuator_ctrllimited", "pair_friction", "dof_damping", "dof_frictionloss", "actuator_gainprm"):
        np.testing.assert_array_equal(getattr(build.world().model, name), getattr(before, name))
    assert build.world().model.opt.timestep == before.opt.timestep

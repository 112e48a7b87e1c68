"""The parts of a robot are found by what they do, whatever else a model contains."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from own_robot import written

import omni_mj as om
from omni_mj.config.resolve import resolve_settings
from omni_mj.mjcf.attachable_robot import copy_world_attributes
from omni_mj.mjcf.robot_builder import build_robot_spec
from omni_mj.mjcf.robot_parts import RobotIndices, find_by_names, find_robots

# A turning and tilting arm with three fingers on its wrist, and a tracking wheel without a motor
BODIES = """
<body name="yaw" pos="0 0 0.15"><joint name="yaw"/><geom size="0.01" mass="0.1"/>
  <body name="tilt" pos="0 0 0.05"><joint name="tilt" axis="0 1 0"/><geom size="0.01" mass="0.1"/>
    <body name="wrist" pos="0.05 0 0"><joint name="wrist" axis="1 0 0"/>
      <geom size="0.01" mass="0.1"/>
      <replicate count="3" euler="120 0 0">
        <body pos="0.02 0 0.01"><joint axis="0 1 0"/><geom size="0.005" mass="0.01"/></body>
      </replicate>
    </body>
  </body>
</body>
<body name="track" pos="0.05 0 0.02"><joint name="track" axis="0 1 0"/>
  <geom size="0.01" mass="0.1"/>
  <replicate count="8" euler="0 45 0">
    <body pos="0 0 0.015"><joint axis="1 0 0"/><geom size="0.005" mass="0.01"/></body>
  </replicate>
</body>
<site name="tilted" euler="30 0 0"/>
"""
MOTORS = """
<dcmotor joint="yaw" motorconst="0.02" resistance="1"/>
<dcmotor joint="wrist" motorconst="0.02" resistance="1"/>
<position joint="tilt"/>
"""
SENSORS = '<gyro site="tilted"/><jointpos joint="yaw"/>'
ARM = (
    f"<mujoco><worldbody>{BODIES}</worldbody><actuator>{MOTORS}</actuator>"
    f"<sensor>{SENSORS}</sensor></mujoco>"
)


def read_state(model: mujoco.MjModel, robot: RobotIndices) -> list[NDArray]:
    """Return state and sensor values of a robot's parts for random positions and speeds."""
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    data.qpos[robot.qpos] = rng.normal(size=len(robot.qpos))
    data.qvel[robot.dofs] = rng.normal(size=len(robot.dofs))
    mujoco.mj_forward(model, data)
    return [
        data.xpos[robot.bodies],
        data.qpos[[*robot.wheel_qpos, *robot.slip_qpos]],
        data.qvel[[*robot.wheel_dofs, *robot.slip_dofs, *robot.roller_dofs.ravel()]],
        data.xanchor[robot.joints],
        data.actuator_velocity[robot.motors],
        data.sensordata[[*robot.encoders, robot.gyro]],
    ]


@pytest.mark.parametrize("has_own_mjcf", [False, True])
def test_a_robot_is_found_in_a_scene_of_other_things(has_own_mjcf: bool, tmp_path: Path) -> None:
    """With an arm on it, which has motors and sensors, next to others."""
    file = tmp_path / "own.xml"
    file.write_text(written((60, 180, 300)))
    sections = {"model": {"file": str(file)}} if has_own_mjcf else {}
    alone = build_robot_spec(resolve_settings(sections).mechanics).spec.copy()
    alone_model = alone.compile()
    (expected,) = find_robots(alone_model)
    chassis = alone_model.body(expected.chassis).name
    scene = mujoco.MjSpec.from_string(ARM)
    for prefix in ("a_", "b_"):
        robot = alone.copy()
        copy_world_attributes(robot, scene)
        arm = mujoco.MjSpec.from_string(ARM)
        robot.attach(arm, frame=robot.body(chassis).add_frame(), prefix="arm_")
        scene.attach(robot, frame=scene.worldbody.add_frame(pos=[0, 1, 1]), prefix=prefix)
    model = scene.compile()
    for prefix in ("a_", "b_"):
        indices = find_by_names(expected, alone_model, model, ("", prefix))
        for values, expected_values in zip(
            read_state(model, indices), read_state(alone_model, expected), strict=True
        ):
            np.testing.assert_allclose(values, expected_values, atol=1e-9)
    scene.delete(scene.sensor("b_" + alone_model.sensor(0).name))
    with pytest.raises(om.OmniError, match=r"the model has no sensor 'b_[^']*': compile"):
        find_by_names(expected, alone_model, scene.compile(), ("", "b_"))


def test_a_users_robot_with_joints_of_its_own_is_added_to_a_scene(tmp_path: Path) -> None:
    """A light dribbler, which no wheel drives, does not change how it moves."""
    dribbler = (
        '<body pos="0.07 0 0.03"><joint axis="0 1 0"/><geom size="0.005" mass="1e-5"/></body>'
    )
    positions = []
    for name, more in (("plain", ""), ("dribbler", dribbler)):
        file = tmp_path / f"{name}.xml"
        file.write_text(written((60, 180, 300), more=more))
        scene = mujoco.MjSpec.from_string(
            '<mujoco><worldbody><geom type="plane" size="5 5 1"/></worldbody></mujoco>'
        )
        added = om.add_robot(scene, prefix="a_", model={"file": str(file)})
        model = scene.compile()
        data = mujoco.MjData(model)
        drive = added.bind(model, data)
        drive.command([0.5, 0.2, 0.0])
        for _ in range(150):
            drive.step()
        positions.append(data.body("a_base").xpos[:2].copy())
    assert np.linalg.norm(positions[0]) > 0.05
    np.testing.assert_allclose(positions[1], positions[0], atol=5e-4)

"""The parts of a robot are found by what they do, whatever else a model contains."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from own_robot import written

import omni_mj as om
from omni_mj.mjcf.robot_parts import RobotIndices, find_by_names, find_robots

OURS = (Path(om.__file__).parents[1] / "models" / "ssl_robot.xml").read_text()
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


def name_parts(text: str) -> mujoco.MjSpec:
    """Return the specification of a robot alone, with names for all its bodies and joints."""
    spec = mujoco.MjSpec.from_string(re.sub("<(option|visual|size)[ >].*", "", text))
    for element in [*spec.worldbody.geoms, *spec.worldbody.lights, *spec.keys]:
        spec.delete(element)
    n_children: dict[str, int] = {}
    for body in spec.bodies[1:]:
        parent = body.parent.name
        n_children[parent] = n_children.get(parent, 0) + 1
        body.name = body.name or f"{parent}_{n_children[parent]}"
    for joint in spec.joints:
        joint.name = joint.name or f"joint_of_{joint.parent.name}"
    return spec


def list_names(model: mujoco.MjModel, robot: RobotIndices, prefix: str) -> list[object]:
    """Return the names of a robot's parts without their prefix, sorted by kind and wheel."""
    qpos_names, dof_names = (
        [
            model.joint(joint).name
            for joint in range(model.njnt)
            for _ in range(np.size(getattr(model.joint(joint), field)))
        ]
        for field in ("qpos0", "damping")
    )
    sensors = {model.sensor_adr[i]: model.sensor(i).name for i in range(model.nsensor)}
    kinds = [
        [model.body(i).name for i in (robot.chassis, *robot.wheels, *robot.rims)],
        [model.body(i).name for i in robot.rollers.ravel()],
        [model.joint(i).name for i in robot.joints],
        [model.actuator(i).name for i in robot.motors],
        [sensors[i] for i in (*robot.encoders, robot.gyro - 2)],
        [qpos_names[i] for i in (*robot.qpos, *robot.wheel_qpos, *robot.slip_qpos)],
        [
            dof_names[i]
            for i in (*robot.dofs, *robot.wheel_dofs, *robot.slip_dofs, *robot.roller_dofs.ravel())
        ],
    ]
    assert all(name.startswith(prefix) for names in kinds for name in names)
    return [[name.removeprefix(prefix) for name in names] for names in kinds]


@pytest.mark.parametrize("text", [OURS, written((60, 180, 300))])
def test_a_robot_is_found_in_a_scene_of_other_things(text: str) -> None:
    """In any pose, with an arm on it, next to others."""
    alone = name_parts(text)
    alone_model = alone.compile()
    (expected,) = find_robots(alone_model)
    chassis = alone_model.body(expected.chassis).name
    scene = mujoco.MjSpec.from_string(ARM)
    for prefix in ("a_", "b_"):
        robot = alone.copy()
        arm = mujoco.MjSpec.from_string(ARM)
        robot.attach(arm, frame=robot.body(chassis).add_frame(), prefix="arm_")
        frame = scene.worldbody.add_frame(pos=[0.4, len(scene.bodies), 0.2], quat=[0.3, 0.5, 0, 1])
        scene.attach(robot, frame=frame, prefix=prefix)
    model = scene.compile()
    for prefix in ("a_", "b_"):
        robot = find_by_names(expected, alone_model, model, ("", prefix))
        assert list_names(model, robot, prefix) == list_names(alone_model, expected, "")
    scene.delete(scene.actuator("b_" + alone_model.actuator(expected.motors[1]).name))
    with pytest.raises(om.OmniError, match=r"the model has no actuator 'b_[^']*': compile"):
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

"""Attach robots to MuJoCo scenes."""

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from omni_control.arguments import check_array, check_types
from omni_control.errors import OmniError
from omni_mj.config.resolve import Robot, resolve_settings
from omni_mj.embed.robot_drive import SceneRobot
from omni_mj.mjcf.attachable_robot import prepare_robot
from omni_mj.mjcf.robot_builder import build_robot_spec
from omni_mj.mjcf.scene_contacts import attach_with_scene_contacts

# A robot halts `firmware.timeout_s` after the last command. In a scene, commands hold forever.
_NO_TIMEOUT = {"timeout_s": 0.0}
# Sections of settings that a scene does not replace
_SECTIONS = (
    *("body", "wheels", "motor", "drivetrain", "firmware", "sensors", "battery"),
    *("carpet", "model", "randomization", "disturbance"),
)


@check_types
def add_robot(
    scene: mujoco.MjSpec,
    robot: str | Path | Robot = "tigers-v2016",
    *,
    prefix: str = "robot_",
    pose: ArrayLike = (0.0, 0.0, 0.0),
    height: float = 0.0,
    **sections: Mapping[str, object],
) -> SceneRobot:
    """Attach a robot to a MuJoCo scene. Each one needs another prefix.

    For instance::

        scene = mujoco.MjSpec.from_file("my_scene.xml")
        robot = om.add_robot(scene, "tigers-v2016", prefix="a_")
        model = scene.compile()
        data = mujoco.MjData(model)
        drive = robot.bind(model, data)
        for _ in range(1000):
            drive.command([0.5, 0.0, 0.0])
            drive.step()

    The wheels roll on everything in the scene that collides. Robots collide with each other by
    their hulls, and with everything else.

    Args:
        scene: Specification of the scene; changed in place.
        robot: Name of a built-in robot, path of a .toml file, or result of `load_robot`.
        prefix: Prefix of the names of the robot's elements.
        pose: Pose at the start, world frame, (3,) m, m, rad.
        height: Height of the floor at the start, m. `bind` puts the robot on the surface that is
            nearest to it, within 0.3 m.
        **sections: Settings that replace those of the robot's file and the defaults, by section,
            for example carpet={"friction": 0.6} or battery={"charge": 0.5}.

    Raises:
        OmniError: The robot does not exist, settings are impossible, or the scene already has a
            robot with this prefix.
    """
    for section in sections:
        if section not in _SECTIONS:
            raise OmniError(
                f"a robot in a scene cannot have {section}; choose from {', '.join(_SECTIONS)}"
            )
    x, y, heading = check_array("pose", pose, (3,)).tolist()
    if "\0" in prefix:
        raise OmniError("prefix must be a text without NUL")
    height = check_array("height", height, ()).item()
    name = robot.name if isinstance(robot, Robot) else str(robot)
    firmware = {**_NO_TIMEOUT, **sections.get("firmware", {})}
    settings = resolve_settings({**sections, "firmware": firmware}, name)
    robot_spec = build_robot_spec(settings.mechanics)
    attachable = prepare_robot(robot_spec, settings.mechanics, has_hull=bool(robot_spec.hull_geoms))
    chassis = prefix + attachable.chassis
    if scene.body(chassis):
        raise OmniError(f"the scene already has a body {chassis!r}: give the robot another prefix")
    quaternion = [np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)]
    frame = scene.worldbody.add_frame(pos=[x, y, height], quat=quaternion)
    attach_with_scene_contacts(scene, attachable, prefix, frame)
    return SceneRobot(settings, name, prefix, chassis, (x, y, heading), height)

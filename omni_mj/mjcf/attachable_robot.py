"""Robots that are attached to a scene, with the contacts of their wheels and load sensors."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from omni_mj.config.robot_settings import Mechanics
from omni_mj.mjcf import hulls, rollers
from omni_mj.mjcf.custom_robot import RobotSpec
from omni_mj.mjcf.robot_parts import Ids, RobotIndices, find_robots

MAX_IMPEDANCE = 0.9999  # MuJoCo's limit of d

_WORLD_ATTRIBUTES = ("option", "visual", "stat", "memory", "nstack", "nconmax", "njmax")


@dataclass(frozen=True, eq=False)
class AttachableRobot:
    """A robot that can be attached to a scene.

    Attributes:
        spec: Specification of the robot alone.
        model: Model of the complete robot alone, without reduction of its rollers.
        chassis: Name of the body with the free joint.
        rims: Names of the bodies that carry the rollers, by wheel.
        contact_geoms: Names of the rollers' geoms that touch the floor.
        hull_geoms: Names of the geoms of its hull; empty if it does not collide.
        hull_spheres: Names of the spheres with which it hits other robots; see `hulls`.
        contact: Parameters of a contact pair of floor and roller.
    """

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    chassis: str
    rims: tuple[str, ...]
    contact_geoms: tuple[str, ...]
    hull_geoms: tuple[str, ...]
    hull_spheres: Sequence[str]
    contact: dict[str, Any]


def prepare_robot(robot_spec: RobotSpec, mechanics: Mechanics, has_hull: bool) -> AttachableRobot:
    """Return a robot that can be attached to scenes.

    Args:
        robot_spec: The robot, from `omni_mj.mjcf.robot_builder.build_robot_spec`.
        mechanics: Settings from which it was built.
        has_hull: Whether it collides with other robots and with walls.

    Raises:
        OmniError: It has no hull, or its hull reaches below the carpet.
    """
    spec, contact_geoms = robot_spec.spec.copy(), robot_spec.contact_geoms
    model = spec.compile()
    (robot,) = find_robots(model)
    contact = rollers.make_roller_contact(model, robot, mechanics.body.mass_kg / len(robot.wheels))
    if mechanics.wheels.model == "two-rollers":
        rollers.reduce_rollers(spec, model, robot)
        remaining = {geom.name for geom in spec.geoms}
        contact_geoms = tuple(name for name in contact_geoms if name in remaining)
    return AttachableRobot(
        spec=spec,
        model=model,
        chassis=model.body(robot.chassis).name,
        rims=tuple(model.body(rim).name for rim in robot.rims),
        contact_geoms=contact_geoms,
        hull_geoms=robot_spec.hull_geoms if has_hull else (),
        hull_spheres=hulls.enable_hulls(robot_spec, spec, model, robot) if has_hull else (),
        contact=contact,
    )


def attach_without_contacts(
    scene: mujoco.MjSpec,
    robot: AttachableRobot,
    prefix: str,
    frame: mujoco.MjsFrame | None = None,
) -> None:
    """Attach a robot to a scene, with load sensors, but without pairs of its contacts.

    Args:
        scene: Specification of the scene; changed in place.
        robot: The robot.
        prefix: Prefix of the robot's names.
        frame: Frame of the robot. Default: that of the world.
    """
    spec = robot.spec.copy()
    copy_world_attributes(spec, scene)
    scene.attach(spec, frame=frame or scene.worldbody.add_frame(), prefix=prefix)
    for rim in robot.rims:  # force on the parts on the rim, world axes
        scene.add_sensor(
            name=f"load/{prefix}{rim}",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            reftype=mujoco.mjtObj.mjOBJ_XBODY,
            refname=prefix + rim,
            # Output: force only; reduction: sum over all contacts; one result.
            intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1],
        )


def copy_world_attributes(spec: mujoco.MjSpec, source: mujoco.MjSpec) -> None:
    """Copy what a specification states for a whole world, not for its bodies."""
    for name in _WORLD_ATTRIBUTES:
        setattr(spec, name, getattr(source, name))


def attach_with_contact_pairs(
    field: mujoco.MjSpec,
    robot: AttachableRobot,
    prefix: str,
    other_spheres: Iterable[str],
    frame: mujoco.MjsFrame | None = None,
) -> list[str]:
    """Attach a robot to models/field.xml, with contact pairs of floor, rollers and hulls.

    Args:
        field: Specification of the field.
        robot: The robot.
        prefix: Prefix of the robot's names.
        other_spheres: Names of the hull spheres of robots on the field.
        frame: Frame of the robot.

    Returns:
        Names of the robot's hull spheres.
    """
    attach_without_contacts(field, robot, prefix, frame)
    for geom in robot.contact_geoms:
        field.add_pair(geomname1=hulls.CARPET, geomname2=prefix + geom, condim=3, **robot.contact)
    spheres = [prefix + name for name in robot.hull_spheres]
    hulls.connect_hull(field, spheres, other_spheres)
    return spheres


def stiffen_slip_hinges(model: mujoco.MjModel, robot: RobotIndices) -> None:
    """Let a slip speed decay within a step, by backward Euler."""
    model.dof_solref[robot.slip_dofs] = -1.0, -MAX_IMPEDANCE / model.opt.timestep
    model.dof_solimp[robot.slip_dofs, :2] = MAX_IMPEDANCE


def find_load_addresses(model: mujoco.MjModel, robot: RobotIndices, scene_prefix: str = "") -> Ids:
    """Return the addresses in sensordata of the vertical forces on the wheels, (wheels,).

    Args:
        model: Model with the robot.
        robot: Indices of the robot.
        scene_prefix: Prefix with which the scene of the robot was attached to another one.
    """
    rims = [model.body(rim).name.removeprefix(scene_prefix) for rim in robot.rims]
    # A sensor's three values are the force along x, y and z.
    return np.array([model.sensor(f"{scene_prefix}load/{rim}").adr[0] + 2 for rim in rims])

"""A user's robot in MJCF: read, checked, and adapted to a world.

Changes of the file, in addition to those of each plant (motor constants, friction of hinges):

- The robot stands upright. The origin of its chassis is on the carpet, below the intersection of
  its axles.
- A positive speed of a wheel's hinge turns the robot counter-clockwise about its center.
- Each rim gets the hinge on which rubber creeps, if the file has none. Without a rim it is on the
  wheel.
- Only rollers touch the carpet, and only hulls each other. Everything else in the file's world is
  removed.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from omni_control.errors import OmniError, to_printable
from omni_mj.config.robot_files import list_model_files
from omni_mj.config.validation import raise_errors
from omni_mj.mjcf import custom_robot_changes
from omni_mj.mjcf.model_measurements import WheelGeometry, compute_composite_inertia, measure_wheels
from omni_mj.mjcf.part_recognition import (
    RobotIndices,
    compute_initial_kinematics,
    find_chassis_names,
    find_robots,
)


@dataclass(frozen=True, eq=False)
class RobotSpec:
    """The specification of one robot, to be attached to a world.

    Attributes:
        file: Name of its source file.
        spec: Specification of the robot alone; copy it before changes.
        contact_geoms: Names of the rollers' geoms that touch the carpet.
    """

    file: str
    spec: mujoco.MjSpec
    contact_geoms: tuple[str, ...]

    @property
    def hull_geoms(self) -> tuple[str, ...]:
        """Names of the geoms with which robots collide, those of the class `hull`."""
        return tuple(geom.name for geom in self.spec.geoms if geom.classname.name == "hull")


@dataclass(frozen=True, eq=False)
class CustomRobotSpec(RobotSpec):
    """The specification of a user's robot.

    Attributes:
        implied_settings: Settings that the file determines, by section and field.
        has_uniform_rollers: Whether all rollers are equal, in one row, with one geom each.
    """

    implied_settings: dict[str, dict[str, Any]]
    has_uniform_rollers: bool


def read_custom_robot(file: str | Path) -> CustomRobotSpec:
    """Read a robot's MJCF.

    Args:
        file: Path of the MJCF.

    Raises:
        OmniError: The file does not exist, is not valid MJCF, or lacks a necessary part. One line
            per error.
    """
    path = Path(file)
    if not os.path.isfile(path):
        raise OmniError(
            f"there is no model {to_printable(str(path))}; give the path of a robot's MJCF: "
            "robot.xml"
        )
    change_times = tuple(
        file.stat().st_mtime_ns for file in list_model_files(path) if file.is_file()
    )
    try:
        return _read(path.resolve(), path.name, change_times)
    except OmniError as error:
        lines = str(error).splitlines()
    except ValueError as error:  # from MuJoCo, may have several lines
        lines = [" ".join(str(error).split())]
    raise OmniError("\n".join(f"{path.name}: {line}" for line in lines))


@lru_cache(maxsize=16)
def _read(path: Path, file: str, change_times: tuple[int, ...]) -> CustomRobotSpec:
    """Read a robot's MJCF; files are read again after they have changed."""
    spec = mujoco.MjSpec.from_file(str(path))
    if spec.compiler.settotalmass > 0:
        raise OmniError(
            "<compiler settotalmass> has no effect in a world; write masses into the model"
        )
    spec.compiler.discardvisual = spec.compiler.fusestatic = False  # keep all named elements
    custom_robot_changes.name_elements(spec)
    name, *more_names = find_chassis_names(spec.compile())
    if more_names:
        names = ", ".join([name, *more_names])
        raise OmniError(f"it has {1 + len(more_names)} robots, {names}; leave one")
    chassis = spec.body(name)
    custom_robot_changes.remove_surroundings(spec, chassis)
    custom_robot_changes.place_at_origin(chassis)
    model = spec.compile()
    (robot,) = find_robots(model)
    contact_geoms = custom_robot_changes.disable_contacts(spec, model, robot)
    geom_ids = np.array([model.geom(geom).id for geom in contact_geoms], int)
    wheels = measure_wheels(model, robot, geom_ids)
    raise_errors(_find_drive_errors(model, robot))
    custom_robot_changes.prepare_hinges(spec, model, robot, wheels)
    custom_robot_changes.raise_parts(chassis, wheels.radius - wheels.axle_height)
    model = spec.compile()
    (robot,) = find_robots(model)
    return CustomRobotSpec(
        file,
        spec,
        contact_geoms,
        _compute_implied_settings(model, robot, wheels),
        _has_uniform_rollers(model, robot),
    )


def _compute_implied_settings(
    model: mujoco.MjModel, robot: RobotIndices, wheels: WheelGeometry
) -> dict[str, dict[str, Any]]:
    """Return the settings that a model determines, by section and field."""
    motor, hub = int(robot.motors[0]), int(robot.wheel_dofs[0])
    mass, (x, _, z), inertia = compute_composite_inertia(
        model, np.flatnonzero(model.body_rootid == robot.chassis)
    )
    gear_ratio = float(model.actuator_gear[motor, 0])
    rotor_inertia = model.actuator_armature[motor] + model.dof_armature[hub] / gear_ratio**2
    body = {
        "mass_kg": mass,
        "com_x_m": x,
        "com_height_m": z,
        "yaw_inertia_kg_m2": inertia[2, 2],
        "tilt_inertia_kg_m2": (inertia[0, 0] + inertia[1, 1]) / 2,
    }
    return {
        "body": _round_values(body),
        "wheels": {
            "azimuths_deg": wheels.azimuths_deg,
            "arm_m": wheels.arm,
            "radius_m": wheels.radius,
            "rollers": robot.rollers.shape[1],
            "roller_radius_m": wheels.roller_radius,
        },
        "motor": _round_values({"gear_ratio": gear_ratio, "rotor_inertia_kg_m2": rotor_inertia}),
    }


def _round_values(values: dict[str, Any]) -> dict[str, float]:
    """Return values without the rounding errors of MuJoCo's compiler."""
    return {name: float(f"{value:.10g}") for name, value in values.items()}


def _has_uniform_rollers(model: mujoco.MjModel, robot: RobotIndices) -> bool:
    """Return whether two rollers of a wheel can represent all of them."""
    rollers = robot.rollers
    mass, inertia = model.body_mass[rollers], np.sort(model.body_inertia[rollers], axis=-1)
    data = compute_initial_kinematics(model)
    axial_positions = np.einsum("wri,wi->wr", data.xpos[rollers], data.xaxis[robot.joints])
    has_equal_mass = np.ptp(mass) < 1e-6 and np.ptp(inertia, axis=(0, 1)).max() < 1e-9
    is_one_row = np.ptp(axial_positions, axis=1).max() < 1e-4
    return bool(has_equal_mass and is_one_row and (model.body_geomnum[rollers] == 1).all())


def _find_drive_errors(model: mujoco.MjModel, robot: RobotIndices) -> Iterator[str]:
    """Yield a line for each property of a wheel or its motor that is not supported."""
    gears, armatures = model.actuator_gear[robot.motors, 0], model.actuator_armature[robot.motors]
    for motor, joint, gear, armature in zip(
        robot.motors, robot.joints, gears, armatures, strict=True
    ):
        name = model.actuator(motor).name
        if gear <= 0:
            yield (
                f"the gear of the <dcmotor> {name!r} must be above 0, not {gear:g}; turn the "
                "hinge's axis"
            )
        if armature + model.dof_armature[model.jnt_dofadr[joint]] <= 0:
            yield f"the <dcmotor> {name!r} has no rotor: give its inertia in kg m^2, armature="
        unsupported = (
            model.actuator_gainprm[motor, 2:],
            model.actuator_biasprm[motor],
            model.actuator_dynprm[motor],
        )
        if any(values.any() for values in unsupported):
            yield (
                f"the <dcmotor> {name!r} must be driven by a voltage, with motorconst, resistance, "
                "gear and armature alone; heat, friction and limits belong in the robot's file"
            )
        if model.jnt_limited[joint] or model.jnt_stiffness[joint].any():
            joint_name = model.joint(joint).name
            yield f"the hinge {joint_name!r} has a range or a spring; a wheel must turn freely"
    for quantity, values in (("gears", gears), ("rotors' inertias", armatures)):
        if np.ptp(values) > 1e-6 * np.abs(values).max():
            listed = ", ".join(f"{value:g}" for value in values)
            yield f"motors must be equal, but their {quantity} are {listed}"

"""A user's own robot in MJCF: read, checked for what the program needs, and made ready for a world.

What is changed of the file, beside what every plant writes (motors' constants, friction of hinges):

- the robot stands upright with the origin of its chassis on the carpet, under where its axles meet;
- hinges of wheels turn the robot counter-clockwise about its middle where they are positive;
- rims get the hinge on which rubber creeps, where the file has none; without a rim it is on the
  wheel;
- nothing touches anything but rollers the carpet, and hulls each other; what else is in its world
  is left out.
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
from omni_mj.config.validation import raise_errors
from omni_mj.mjcf import adapt_custom_robot
from omni_mj.mjcf.model_files import list_model_files
from omni_mj.mjcf.robot_geometry import WheelGeometry, compute_composite_inertia, measure_wheels
from omni_mj.mjcf.robot_indices import RobotIndices, find_chassis_names, find_robots


@dataclass(frozen=True, eq=False)
class RobotSpec:
    """One robot, alone, to be attached to a world.

    Attributes:
        file: name of the file that it was made of.
        spec: to be copied, not changed.
        contact_geoms: names of the rollers' geoms that touch the carpet.
        hull_geoms: names of the geoms with which robots meet.
    """

    file: str
    spec: mujoco.MjSpec
    contact_geoms: tuple[str, ...]
    hull_geoms: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class CustomRobotSpec(RobotSpec):
    """A user's own robot.

    Attributes:
        implied_settings: what it says of settings, by section and field.
        has_uniform_rollers: whether all rollers are alike, in one row and of one geom each.
    """

    implied_settings: dict[str, dict[str, Any]]
    has_uniform_rollers: bool


def read(file: str | Path) -> CustomRobotSpec:
    """Read a robot's MJCF.

    Args:
        file: its path.

    Raises:
        OmniError: there is no such file, it is no MJCF, or it lacks what the program needs; a line
            for each.
    """
    path = Path(file)
    if not os.path.isfile(path):
        raise OmniError(
            f"there is no model {to_printable(str(path))}; give the path of a robot's MJCF: robot.xml"
        )
    changed = tuple(part.stat().st_mtime_ns for part in list_model_files(path) if part.is_file())
    try:
        return _read(path.resolve(), path.name, changed)
    except (
        ValueError,
        OmniError,
    ) as error:  # MuJoCo's errors are the former, and take several lines
        lines = (
            str(error).splitlines()
            if isinstance(error, OmniError)
            else [" ".join(str(error).split())]
        )
        raise OmniError("\n".join(f"{path.name}: {line}" for line in lines)) from None


@lru_cache(maxsize=16)
def _read(path: Path, file: str, changed: tuple[int, ...]) -> CustomRobotSpec:
    spec = mujoco.MjSpec.from_file(str(path))
    if spec.compiler.settotalmass > 0:
        raise OmniError(
            "<compiler settotalmass> scales what is compiled alone, not in a world; write masses"
        )
    spec.compiler.discardvisual = spec.compiler.fusestatic = False  # all that is named stays
    adapt_custom_robot.name_all(spec)
    model = spec.compile()
    name, *others = find_chassis_names(model)
    if others:
        raise OmniError(f"it has {1 + len(others)} robots, {', '.join([name, *others])}; leave one")
    chassis = spec.body(name)
    adapt_custom_robot.isolate(spec, chassis)
    adapt_custom_robot.stand(chassis)
    model = spec.compile()
    (robot,) = find_robots(model)
    touching = adapt_custom_robot.touching(spec, model, robot)
    wheels = measure_wheels(model, robot, np.array([model.geom(name).id for name in touching], int))
    raise_errors(_unfit(model, robot))
    adapt_custom_robot.drive(spec, model, robot, wheels)
    adapt_custom_robot.lower(chassis, wheels.radius - wheels.height)
    model = spec.compile()
    (robot,) = find_robots(model)
    return CustomRobotSpec(
        file, spec, touching, hull(spec), _numbers(model, robot, wheels), _uniform(model, robot)
    )


def _numbers(
    model: mujoco.MjModel, robot: RobotIndices, wheels: WheelGeometry
) -> dict[str, dict[str, Any]]:
    """What a model says of settings, by section and field."""
    motor, hub = int(robot.motors[0]), int(robot.wheel_dofs[0])
    mass, (x, _, z), inertia = compute_composite_inertia(
        model, np.flatnonzero(model.body_rootid == robot.chassis)
    )
    gear = float(model.actuator_gear[motor, 0])
    body = {
        "mass_kg": mass,
        "com_x_m": x,
        "com_height_m": z,
        "yaw_inertia_kg_m2": inertia[2, 2],
        "tilt_inertia_kg_m2": (inertia[0, 0] + inertia[1, 1]) / 2,
    }
    rotor = {
        "gear_ratio": gear,
        "rotor_inertia_kg_m2": model.actuator_armature[motor] + model.dof_armature[hub] / gear**2,
    }
    rounded = {
        section: {
            name: float(f"{value:.10g}") for name, value in values.items()
        }  # more is rounding of the compiler's
        for section, values in (("body", body), ("motor", rotor))
    }
    geometry = {
        "azimuths_deg": wheels.azimuths,
        "arm_m": wheels.arm,
        "radius_m": wheels.radius,
        "rollers": robot.rollers.shape[1],
        "roller_radius_m": wheels.roller_radius,
    }
    return {"body": rounded["body"], "wheels": geometry, "motor": rounded["motor"]}


def _uniform(model: mujoco.MjModel, robot: RobotIndices) -> bool:
    """Whether two rollers of a wheel could stand for all."""
    rollers = robot.rollers
    mass, inertia = model.body_mass[rollers], np.sort(model.body_inertia[rollers], axis=-1)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    along = np.einsum("wri,wi->wr", data.xpos[rollers], data.xaxis[robot.joints])
    alike = np.ptp(mass) < 1e-6 and np.ptp(inertia, axis=(0, 1)).max() < 1e-9
    return bool(
        alike and np.ptp(along, axis=1).max() < 1e-4 and (model.body_geomnum[rollers] == 1).all()
    )


def hull(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Names of the geoms of the class `hull`."""
    return tuple(geom.name for geom in spec.geoms if geom.classname.name == "hull")


def _unfit(model: mujoco.MjModel, robot: RobotIndices) -> Iterator[str]:
    """Yield what a wheel or its motor cannot be here, in lines."""
    gears, armatures = model.actuator_gear[robot.motors, 0], model.actuator_armature[robot.motors]
    for motor, joint, gear, armature in zip(
        robot.motors, robot.joints, gears, armatures, strict=True
    ):
        name = model.actuator(motor).name
        if gear <= 0:
            yield f"the gear of the <dcmotor> {name!r} must be above 0, not {gear:g}; turn the hinge's axis"
        if armature + model.dof_armature[model.jnt_dofadr[joint]] <= 0:
            yield f"the <dcmotor> {name!r} has no rotor: give its inertia in kg m^2, armature="
        more = (
            model.actuator_gainprm[motor, 2:],
            model.actuator_biasprm[motor],
            model.actuator_dynprm[motor],
        )
        if any(values.any() for values in more):
            yield (
                f"the <dcmotor> {name!r} must be driven by a voltage, with motorconst, resistance, gear and armature "
                "alone; heat, friction and limits are in the robot's file"
            )
        if model.jnt_limited[joint] or model.jnt_stiffness[joint].any():
            yield f"the hinge {model.joint(joint).name!r} has a range or a spring; a wheel turns freely"
    for what, values in (("gears", gears), ("rotors' inertias", armatures)):
        if np.ptp(values) > 1e-6 * np.abs(values).max():
            yield f"motors must be alike, but their {what} are {', '.join(f'{value:g}' for value in values)}"

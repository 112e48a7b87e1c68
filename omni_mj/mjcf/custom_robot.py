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
import warnings
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from omni_control.errors import OmniError, to_printable
from omni_mj.config.robot_files import list_model_files
from omni_mj.config.robot_settings import AZIMUTH_DIGITS
from omni_mj.config.validation import SettingsModel, raise_errors
from omni_mj.mjcf.compile_check import check_compiles
from omni_mj.mjcf.robot_geometry import WheelGeometry, compute_composite_inertia, measure_wheels
from omni_mj.mjcf.robot_parts import (
    HINGE,
    Ids,
    RobotIndices,
    compute_initial_kinematics,
    find_chassis_names,
    find_robots,
)

MAX_RIPPLE = 0.005  # of the radius; wheels with more are reported
RELATIVE_TOLERANCE = 1e-6  # within which a setting equals the value in MJCF
# Solver parameters of the friction of hinges, same as in models/ssl_robot.xml.
_HINGE_FRICTION = {
    "solimp_friction": [0.999, 0.9999, 0.001, 0.5, 2.0],
    "solref_friction": [0.005, 1.0],
}
# Attributes of a body that list its children with a position.
_CHILD_LISTS = ("frames", "bodies", "geoms", "sites", "cameras", "lights")


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
        colliding_geoms: Names of the geoms that could collide in the file.
    """

    implied_settings: dict[str, dict[str, Any]]
    has_uniform_rollers: bool
    colliding_geoms: tuple[str, ...]

    def find_contradictions(self, sections: Mapping[str, Any]) -> Iterator[str]:
        """Yield a message for each value in sections of settings that differs from the file."""
        for section, fields in self.implied_settings.items():
            values = sections.get(section)
            if not isinstance(values, (Mapping, SettingsModel)):
                continue
            values = dict(values)
            for field, mjcf_value in fields.items():
                value = values.get(field, mjcf_value)
                if not _are_equal(field, mjcf_value, value):
                    yield (
                        f"{section}.{field} = {value} contradicts {self.file}, which has "
                        f"{mjcf_value}; change the model, or leave out {section}.{field}"
                    )


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
    try:
        change_times = tuple(source.stat().st_mtime_ns for source in list_model_files(path))
        return _read_robot_file(path.resolve(), path.name, change_times)
    except OmniError as error:
        lines = str(error).splitlines()
    except ValueError as error:  # from MuJoCo, may have several lines
        lines = [" ".join(str(error).split())]
    raise OmniError("\n".join(f"{path.name}: {line}" for line in lines))


@lru_cache(maxsize=16)
def _read_robot_file(path: Path, file: str, change_times: tuple[int, ...]) -> CustomRobotSpec:
    """Read and adapt a robot's MJCF.

    Args:
        path: Path of the file.
        file: Name of the file.
        change_times: Times of the last change of all files of the model, ns. They are part of the
            cache's key: changed files are read again.
    """
    check_compiles(path)
    spec = _parse_silently(path)
    if spec.compiler.settotalmass > 0:
        raise OmniError(
            "<compiler settotalmass> has no effect in a world; write masses into the model"
        )
    spec.compiler.discardvisual = spec.compiler.fusestatic = False  # keep all named elements
    _remove_ignored_inertias(spec)
    _name_elements(spec)
    name, *more_names = find_chassis_names(spec.compile())
    if more_names:
        names = ", ".join([name, *more_names])
        raise OmniError(f"it has {1 + len(more_names)} robots, {names}; leave one")
    chassis = spec.body(name)
    _isolate_robot(spec, chassis)
    model = spec.compile()
    (robot,) = find_robots(model)
    colliding_geoms = _disable_contacts(spec)
    contact_geoms = _find_contact_geoms(model, robot, colliding_geoms)
    geom_ids = np.array([model.geom(geom).id for geom in contact_geoms], int)
    wheels = measure_wheels(model, robot, geom_ids)
    raise_errors(_find_drive_errors(model, robot))
    _warn_of_ripple(file, wheels)
    _prepare_hinges(spec, model, robot, wheels)
    _raise_parts(chassis, wheels.radius - wheels.axle_height)
    model = spec.compile()
    (robot,) = find_robots(model)
    return CustomRobotSpec(
        file,
        spec,
        contact_geoms,
        _compute_implied_settings(model, robot, wheels),
        _has_uniform_rollers(model, robot),
        colliding_geoms,
    )


def _parse_silently(path: Path) -> mujoco.MjSpec:
    """Parse MJCF without MuJoCo's warnings of attached models with other options."""
    log = mujoco.MjLogConfig.get()
    outputs = log.logto_console, log.logto_file
    log.logto_console = log.logto_file = False
    log.set()
    try:
        return mujoco.MjSpec.from_file(str(path)).copy()  # a copy does not repeat warnings
    finally:
        log.logto_console, log.logto_file = outputs
        log.set()


def _remove_ignored_inertias(spec: mujoco.MjSpec) -> None:
    """Delete inertias that <compiler inertiafromgeom="true"> ignores, and let others be set."""
    always = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    bodies = [body for body in spec.bodies if body.compiler.inertiafromgeom == always]
    for body in bodies:
        body.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        body.explicitinertial, body.ipos = False, np.full(3, np.nan)  # from geoms


def _make_unique(name: str, names: Collection[str]) -> str:
    """Return a name, with underscores appended until it is not among some names."""
    while name in names:
        name += "_"
    return name


def _name_elements(spec: mujoco.MjSpec) -> None:
    """Name unnamed elements, and delete keyframes, whose world differs.

    Sensors get no limits and delays; those of real ones are settings.
    """
    for sensor in spec.sensors:
        sensor.cutoff, sensor.delay, sensor.nsample = 0.0, 0.0, 0
    for key in list(spec.keys):
        spec.delete(key)
    spec.nkey = mujoco.MjSpec().nkey
    for kind in ("body", "joint", "geom", "actuator", "sensor"):
        elements = getattr(spec, "bodies" if kind == "body" else f"{kind}s")
        names = {element.name for element in elements}
        for number, element in enumerate(elements):
            element.name = element.name or _make_unique(f"unnamed_{kind}_{number}", names)


def _isolate_robot(spec: mujoco.MjSpec, chassis: mujoco.MjsBody) -> None:
    """Delete everything outside the robot, contact pairs, and contact sensors.

    The chassis is put at the world's origin, with its axes along the world's.
    """
    world = spec.worldbody
    contact = mujoco.mjtSensor.mjSENS_CONTACT
    # Before bodies and geoms: with these, MuJoCo deletes the pairs that name them.
    elements: list[object] = [sensor for sensor in spec.sensors if sensor.type == contact]
    elements += [*spec.pairs, *(body for body in world.bodies if body.name != chassis.name)]
    elements += [*world.geoms, *world.lights, *world.cameras, *world.sites]
    for element in elements:
        spec.delete(element)
    bodies = {body.name for body in spec.bodies}
    for element in [*spec.lights, *spec.cameras]:
        if element.targetbody and element.targetbody not in bodies:
            spec.delete(element)
    chassis.set_frame(chassis.parent.add_frame())
    chassis.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    chassis.pos, chassis.quat = np.zeros(3), [1.0, 0.0, 0.0, 0.0]


def _disable_contacts(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Switch off the contacts of all geoms; return the names of those that had any."""
    colliding = [geom for geom in spec.geoms if geom.contype or geom.conaffinity]
    for geom in colliding:
        geom.contype = geom.conaffinity = 0
    return tuple(geom.name for geom in colliding)


def _find_contact_geoms(
    model: mujoco.MjModel, robot: RobotIndices, colliding_geoms: Collection[str]
) -> tuple[str, ...]:
    """Return the rollers' geoms that touch the carpet.

    Of each roller these are the geoms that could collide in the file, or all if none could.

    Raises:
        OmniError: A roller has no geom.
    """
    contact_geoms: list[str] = []
    for roller in robot.rollers.ravel():
        geoms = [model.geom(i).name for i in np.flatnonzero(model.geom_bodyid == roller)]
        if not geoms:
            raise OmniError(
                f"the roller {model.body(roller).name!r} has no geom that could touch the carpet"
            )
        contact_geoms += [name for name in geoms if name in colliding_geoms] or geoms
    return tuple(contact_geoms)


def _warn_of_ripple(file: str, wheels: WheelGeometry) -> None:
    """Warn of wheels that are not round, once per process and file."""
    ripple, radius = wheels.ripple, wheels.radius
    if ripple > MAX_RIPPLE * radius:
        warnings.warn(
            f"{file}: the wheels are not round: their axles rise and fall by {1e3 * ripple:.2g} mm "
            f"({100 * ripple / radius:.1f} % of the radius), and they roll as far as wheels of "
            f"radius {1e3 * wheels.rolling_radius:.2f} mm, not {1e3 * radius:.2f} mm; more or "
            "longer rollers are rounder",
            stacklevel=2,
        )


def _prepare_hinges(
    spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices, wheels: WheelGeometry
) -> None:
    """Orient the hinges of wheels, add missing slip hinges, and set the friction of hinges.

    Afterwards the axes of all wheel and slip hinges point to the robot's center.
    """
    data = compute_initial_kinematics(model)
    joint_names = {joint.name for joint in spec.joints}
    slip_hinges = model.dof_jntid[robot.slip_dofs]
    for i, (joint, rim, phase, is_outward) in enumerate(
        zip(robot.joints, robot.rims, robot.phases, wheels.is_outward, strict=True)
    ):
        hub = spec.joint(model.joint(joint).name)
        has_hub_direction, initial_slip = True, 0.0
        if slip_hinges.size:
            slip = spec.joint(model.joint(slip_hinges[i]).name)
            has_hub_direction = data.xaxis[joint] @ data.xaxis[slip_hinges[i]] > 0
            initial_slip = model.qpos0[robot.slip_qpos[i]]
        else:
            body = spec.body(model.body(rim).name)
            name = _make_unique(f"slip_of_{hub.name}", joint_names)
            slip = body.add_joint(name=name, type=HINGE, armature=0.0)
            to_rim = data.xmat[rim].reshape(3, 3).T  # from the world's axes to the rim's
            slip.pos = to_rim @ (data.xanchor[joint] - data.xpos[rim])
            slip.axis = to_rim @ data.xaxis[joint]
        if is_outward:
            hub.axis = -np.array(hub.axis)
        if is_outward == has_hub_direction:
            slip.axis = -np.array(slip.axis)
        slip_angle = (phase - initial_slip) if is_outward else (initial_slip - phase)
        slip.ref = np.degrees(slip_angle) if slip.compiler.degree else slip_angle
        for name, value in _HINGE_FRICTION.items():
            setattr(hub, name, value)
            setattr(slip, name, value)
        slip.damping = np.zeros_like(slip.damping)
    for address in robot.roller_dofs.ravel():  # the plant sets the friction of their bearings
        spec.joint(model.joint(model.dof_jntid[address]).name).frictionloss = 0.0


def _raise_parts(chassis: mujoco.MjsBody, height: float) -> None:
    """Raise all parts in the frame of the chassis by a height, m."""
    if abs(height) < 1e-9:
        return
    shift = np.array([0.0, 0.0, height])
    children = [child for attribute in _CHILD_LISTS for child in getattr(chassis, attribute)]
    for element in children:
        if element.frame is None:
            element.pos = np.array(element.pos) + shift
    if chassis.explicitinertial:
        chassis.ipos = np.array(chassis.ipos) + shift


def _compute_implied_settings(
    model: mujoco.MjModel, robot: RobotIndices, wheels: WheelGeometry
) -> dict[str, dict[str, Any]]:
    """Return the settings that a model determines, by section and field."""
    motor, hub = robot.motors[0], robot.wheel_dofs[0]
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
    gears, armatures = model.actuator_gear[:, 0], model.actuator_armature
    for motor, joint, roller_dofs in zip(
        robot.motors, robot.joints, robot.roller_dofs, strict=True
    ):
        name, gear = model.actuator(motor).name, gears[motor]
        if gear <= 0:
            yield (
                f"the gear of the <dcmotor> {name!r} must be above 0, not {gear:g}; turn the "
                "hinge's axis"
            )
        if armatures[motor] + model.dof_armature[model.jnt_dofadr[joint]] <= 0:
            yield f"the <dcmotor> {name!r} has no rotor: give its inertia in kg m^2, armature="
        unsupported = (
            model.actuator_gainprm[motor, 2:],
            model.actuator_biasprm[motor],
            model.actuator_dynprm[motor],
            model.actuator_delay[motor],
        )
        if any(values.any() for values in unsupported):
            yield (
                f"the <dcmotor> {name!r} must be driven by a voltage, with motorconst, resistance, "
                "gear and armature alone; heat, friction, limits and delays belong in the robot's "
                "file"
            )
        hinges = np.array([joint, *model.dof_jntid[roller_dofs]])
        is_held = model.jnt_limited | model.jnt_actfrclimited | (model.jnt_stiffness != 0)
        is_held = is_held[hinges]
        if is_held.any():
            joint_name = model.joint(hinges[is_held.argmax()]).name
            yield f"the hinge {joint_name!r} has a range or a spring; a wheel must turn freely"
    for joint in np.intersect1d(robot.joints, _find_coupled_joints(model, robot)):
        yield (
            f"the hinge {model.joint(joint).name!r} must be moved by its <dcmotor> alone: remove "
            "its other actuators, tendons and equalities"
        )
    for quantity, all_values in (("gears", gears), ("rotors' inertias", armatures)):
        values = all_values[robot.motors]
        if np.ptp(values) > 1e-6 * np.abs(values).max():
            listed = ", ".join(f"{value:g}" for value in values)
            yield f"motors must be equal, but their {quantity} are {listed}"


def _find_coupled_joints(model: mujoco.MjModel, robot: RobotIndices) -> Ids:
    """Return joints that tendons, equalities, or other actuators than those of wheels move."""
    is_other = model.actuator_trntype <= int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    is_other[robot.motors] = False
    is_equality = model.eq_type == mujoco.mjtEq.mjEQ_JOINT
    is_wrapped = model.wrap_type == mujoco.mjtWrap.mjWRAP_JOINT
    return np.concatenate(
        [
            model.actuator_trnid[is_other, 0],
            model.eq_obj1id[is_equality],
            model.eq_obj2id[is_equality],
            model.wrap_objid[is_wrapped],
        ]
    )


def _are_equal(field: str, number_1: Any, number_2: Any) -> bool:
    """Return whether two numbers or lists of numbers are equal within tolerance.

    Azimuths are equal in any order, and modulo 360 deg.
    """
    try:
        if field == "azimuths_deg":
            number_1, number_2 = (
                np.sort(np.round(azimuths, AZIMUTH_DIGITS) % 360)
                for azimuths in (number_1, number_2)
            )
        return np.shape(number_1) == np.shape(number_2) and np.allclose(
            number_1, number_2, rtol=RELATIVE_TOLERANCE, atol=1e-9
        )
    except (TypeError, ValueError):
        return False

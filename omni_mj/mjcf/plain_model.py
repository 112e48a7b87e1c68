"""A robot as plain MJCF, which rolls in any scene with a floor and MuJoCo's default options.

Rollers and hulls carry their contact bits and parameters:

- Rollers collide with the geoms of the scene (contype 1, conaffinity 1), but neither with hulls
  nor with rollers.
- Hulls collide with the geoms of the scene and with the hulls of other robots.
- All other geoms of a robot collide with nothing.

The contact of a roller has a time constant of 10 ms, an impedance of 0.97 or more and the friction
1.5. With MuJoCo's pyramidal cones, timesteps from 1 to 5 ms and all integrators, robots follow
their wheels within 1 % and do not hop. The stiff contacts of this program's worlds (`rollers`)
would slip.
"""

import math
import posixpath
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_mj.config.robot_files import FILE_ATTRIBUTES, find_models_folder, read_model_files
from omni_mj.config.settings import FULL_CELL_V, Settings
from omni_mj.mjcf import hulls
from omni_mj.mjcf.attachable_robot import copy_world_attributes
from omni_mj.mjcf.custom_robot import CustomRobotSpec
from omni_mj.mjcf.mjcf_text import format_mjcf, format_numbers, parse_mjcf
from omni_mj.mjcf.robot_builder import (
    DEFAULTS,
    build_robot_spec,
    find_child,
    write_wheels,
)
from omni_mj.mjcf.robot_geometry import compute_support_distance, make_printable_moments
from omni_mj.mjcf.robot_parts import RobotIndices, compute_initial_kinematics, find_robots

# Attributes of geoms that models/ssl_robot.xml defines for all robots, by class.
_CONTACT_ATTRIBUTES = {
    "roller": ("contype", "conaffinity", "condim", "priority", "friction", "solref", "solimp"),
    "hull": ("contype", "conaffinity"),
}
IMPEDANCE = 0.97  # of the rollers' contacts in models/ssl_robot.xml
MAX_LOAD_RATIO = 1.4  # load of a wheel over the effective mass of a roller with this impedance
VIEW_DISTANCE = 4.0  # extent of the scene for MuJoCo's cameras, over the arm of the wheels
_UNNAMED = "unnamed_"  # start of the names that `custom_robot` gives
_FILE_NAME = "ssl_robot"  # of the robot in models/


@dataclass(frozen=True)
class PlainModel:
    """A robot as plain MJCF.

    Attributes:
        name: Name of the model and of its file, without suffix.
        files: Contents of the robot's file, scene.xml, meshes and textures, by their paths.
        motors: Names of the actuators, by wheel.
    """

    name: str
    files: Mapping[str, bytes]
    motors: tuple[str, ...]


def build_plain_model(settings: Settings, name: str) -> PlainModel:
    """Return a robot as plain MJCF.

    Args:
        settings: Settings of the robot.
        name: Name of the model.

    Raises:
        OmniError: The numbers of the robot are impossible, a robot's file lacks a part, or MuJoCo
            cannot compile the result.
    """
    folder, file = find_models_folder(), settings.model.file
    if file:
        robot, sources = _build_custom_mjcf(settings, name), read_model_files(Path(file))
        assets = {path: data for path, data in sources.items() if not path.endswith(".xml")}
        _write_asset_paths(robot, assets)
    else:
        robot, assets = _build_standard_mjcf(settings, name), {}
    scene = parse_mjcf((folder / "scene.xml").read_text().replace(_FILE_NAME, name))
    extent = VIEW_DISTANCE * settings.wheels.arm_m
    find_child(scene, "statistic").set("extent", f"{extent:.2g}")
    try:
        model = mujoco.MjModel.from_xml_string(ElementTree.tostring(robot, "unicode"), assets)
        (indices,) = find_robots(model)
        _stiffen_contacts(robot, model, indices, settings.body.mass_kg)
        texts = {f"{name}.xml": format_mjcf(robot), "scene.xml": format_mjcf(scene)}
        files = {path: text.encode() for path, text in texts.items()} | assets
        mujoco.MjModel.from_xml_string(texts["scene.xml"], files)
    except ValueError as error:
        raise OmniError(f"{name}.xml: {' '.join(str(error).split())}") from error
    return PlainModel(name, files, tuple(model.actuator(i).name for i in indices.motors))


def _build_standard_mjcf(settings: Settings, name: str) -> ElementTree.Element:
    """Return models/ssl_robot.xml with the numbers of a robot."""
    path = find_models_folder() / f"{_FILE_NAME}.xml"
    root = parse_mjcf(path.read_text().replace(_FILE_NAME, name))
    write_wheels(root, settings.mechanics)
    for inertial in root.iterfind(".//body[@name]/body/inertial"):
        moments = np.array(inertial.get("diaginertia", "").split(), float)
        inertial.set("diaginertia", format_numbers(*make_printable_moments(moments)))
    (chassis,) = build_robot_spec(settings.mechanics).spec.worldbody.bodies
    motor, drivetrain = settings.motor, settings.drivetrain
    attributes_by_path: dict[str, dict[str, Any]] = {
        f"{DEFAULTS}/default[@class='wheel']/joint": {
            "frictionloss": settings.hub_friction_nm,
            "damping": motor.wheel_viscous_friction_nm_s,
        },
        f"{DEFAULTS}/default[@class='roller']/joint": {"damping": drivetrain.roller_damping_nm_s},
        f"{DEFAULTS}/dcmotor": {
            "motorconst": motor.effective_constant_nm_a,
            "resistance": motor.resistance_ohm,
            "ctrlrange": compute_full_voltage(settings) * np.array([-1, 1]),
        },
        "worldbody/body/inertial": {
            "pos": chassis.ipos,
            "mass": chassis.mass,
            "fullinertia": chassis.fullinertia,
        },
    }
    for element_path, attributes in attributes_by_path.items():
        for attribute, values in attributes.items():
            text = format_numbers(*np.atleast_1d(values))
            find_child(root, element_path).set(attribute, text)
    return root


def _build_custom_mjcf(settings: Settings, name: str) -> ElementTree.Element:
    """Return the MJCF of a user's robot with the numbers of its settings.

    Raises:
        OmniError: See `build_robot_spec`.
    """
    robot_spec = build_robot_spec(settings.mechanics)
    assert isinstance(robot_spec, CustomRobotSpec)
    spec = robot_spec.spec.copy()
    model = spec.compile()
    (robot,) = find_robots(model)
    spec.modelname = name
    copy_world_attributes(spec, mujoco.MjSpec())
    for address in robot.slip_dofs:
        spec.delete(spec.joint(model.joint(model.dof_jntid[address]).name))
    hull = robot_spec.hull_geoms or tuple(_find_body_geoms(robot_spec, model, robot))
    standard = mujoco.MjSpec.from_file(str(find_models_folder() / f"{_FILE_NAME}.xml"))
    for geom_class, geoms in (("roller", robot_spec.contact_geoms), ("hull", hull)):
        source = standard.find_default(geom_class).geom
        for geom, attribute in product(geoms, _CONTACT_ATTRIBUTES[geom_class]):
            setattr(spec.geom(geom), attribute, getattr(source, attribute))
    for geom in map(spec.geom, hull):
        if geom.type == mujoco.mjtGeom.mjGEOM_CYLINDER:
            hulls.tilt_cylinder(geom, model)
    _write_motors_and_friction(spec, model, robot, settings)
    spec.add_key(name="home")
    root = parse_mjcf(spec.to_xml())
    root.remove(find_child(root, "size"))  # the number of keys, which differs from that of a scene
    for element in root.iter():
        if element.get("name", "").startswith(_UNNAMED):
            del element.attrib["name"]
    return root


def _write_motors_and_friction(
    spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices, settings: Settings
) -> None:
    """Set motors, and the friction of wheels and rollers.

    Args:
        spec: Specification of a robot; changed in place.
        model: Model compiled from it, before changes.
        robot: Indices of the robot in the model.
        settings: Settings of the robot.
    """
    motor, drivetrain = settings.motor, settings.drivetrain
    for number, actuator in enumerate(robot.motors, start=1):
        motor_spec = spec.actuators[actuator]
        if motor_spec.name.startswith(_UNNAMED):
            motor_spec.name = f"motor_{number}"
        motor_spec.gainprm[:2] = motor.resistance_ohm, motor.effective_constant_nm_a
        motor_spec.ctrllimited = 1
        motor_spec.ctrlrange = compute_full_voltage(settings) * np.array([-1, 1])
    dofs = [(address, motor.wheel_viscous_friction_nm_s) for address in robot.wheel_dofs]
    dofs += [(address, drivetrain.roller_damping_nm_s) for address in robot.roller_dofs.ravel()]
    for address, damping in dofs:
        joint = spec.joint(model.joint(model.dof_jntid[address]).name)
        joint.damping[:] = 0.0
        joint.damping[0] = damping
        if address in robot.wheel_dofs:
            joint.frictionloss = settings.hub_friction_nm


def _stiffen_contacts(
    root: ElementTree.Element, model: mujoco.MjModel, robot: RobotIndices, mass_kg: float
) -> None:
    """Let robots with heavy loads or light wheels sink into the floor as little as the default one.

    The depth is proportional to (1 - d) d A N, with the impedance d, the inverse effective mass A
    of a roller and the load N of a wheel.

    Args:
        root: A robot's MJCF; changed in place.
        model: Model compiled from it.
        robot: Indices of the robot in the model.
        mass_kg: Mass of the robot.
    """
    ratio = float(model.body_invweight0[robot.rollers, 0].max()) * mass_kg / len(robot.wheels)
    if ratio <= MAX_LOAD_RATIO:
        return
    impedance = 0.5 + math.sqrt(0.25 - IMPEDANCE * (1 - IMPEDANCE) * MAX_LOAD_RATIO / ratio)
    pattern = rf"^{IMPEDANCE:g} {IMPEDANCE:g}\b"
    for geom in root.iter("geom"):
        if solimp := geom.get("solimp"):
            geom.set("solimp", re.sub(pattern, format_numbers(impedance, impedance), solimp))


def _write_asset_paths(root: ElementTree.Element, assets: Mapping[str, bytes]) -> None:
    """Name meshes, textures and heightfields by their paths, without folders of the compiler.

    Raises:
        OmniError: Files of attached models have the same name.
    """
    compiler = find_child(root, "compiler").attrib
    folders = {compiler.pop(name, "") for name in ("meshdir", "texturedir", "assetdir")} | {""}
    compiler.pop("strippath", "")
    for element, attribute in product(root.iter(), FILE_ATTRIBUTES):
        name = element.get(attribute, "").replace("\\", "/")
        if not name:
            continue
        paths = [posixpath.normpath(posixpath.join(folder, name)) for folder in folders]
        # The folders of attached models are not in the specification.
        ending = f"/{posixpath.basename(name)}"
        matches = [path for path in paths if path in assets]
        matches = matches or [path for path in assets if f"/{path}".endswith(ending)]
        if len({assets[path] for path in matches}) != 1:
            raise OmniError(f"several files are named {name}; give them different names")
        element.set(attribute, matches[0])


def _find_body_geoms(
    robot_spec: CustomRobotSpec, model: mujoco.MjModel, robot: RobotIndices
) -> Iterator[str]:
    """Yield the geoms that collide in the user's file, above the floor and on no wheel."""
    data, down = compute_initial_kinematics(model), np.array([0.0, 0.0, -1.0])
    for geom in map(model.geom, robot_spec.colliding_geoms):
        is_on_wheel = geom.bodyid[0] in robot.bodies[1:]  # the first one is the chassis
        if not is_on_wheel and compute_support_distance(data, geom.id, down) < 0:
            yield geom.name


def compute_full_voltage(settings: Settings) -> float:
    """Return the voltage of a full battery, V."""
    return FULL_CELL_V * settings.battery.series_cells

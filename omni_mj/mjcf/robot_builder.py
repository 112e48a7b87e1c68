"""Builder of a robot's MJCF specification: models/ssl_robot.xml with the numbers of its settings.

The file defines chassis, hull, sensors, and wheels of hub, rim and rollers. The settings define
sizes, masses and counts, see `Mechanics`. The file's first wheel is copied to each azimuth. The
mass of the chassis is that of the robot minus those of the wheels.

The file is a robot for any scene, see `plain_model`. In worlds of this program a hinge between hub
and rim slips instead of the rollers, and `world_builder` lists the contacts.
"""

import math
import xml.etree.ElementTree as ElementTree
from functools import lru_cache

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_mj.config.robot_files import find_models_folder
from omni_mj.config.robot_settings import BodySettings, Mechanics, WheelSettings
from omni_mj.config.validation import raise_errors
from omni_mj.mjcf.custom_robot import RobotSpec, read_custom_robot
from omni_mj.mjcf.robot_geometry import (
    compute_composite_inertia,
    compute_point_mass_inertia,
    set_inertial,
)
from omni_mj.mjcf.robot_parts import HINGE

Element = ElementTree.Element
DEFAULTS = "default/default"  # path of the class of all defaults
# Attributes of the classes of geoms in worlds of this program: only listed pairs touch.
_NO_CONTACT = {"contype": "0", "conaffinity": "0"}
_WORLD_CONTACTS = {"roller": _NO_CONTACT, "hull": {**_NO_CONTACT, "solref": "0.003 0.7"}}
# Dry friction of a slip hinge at rest; plants write it in every step.
_SLIP_FRICTION_NM = 0.14818005


def build_robot_spec(mechanics: Mechanics) -> RobotSpec:
    """Return the specification of a robot of the standard shape, or of a custom robot.

    Raises:
        OmniError: A custom robot lacks a part, or settings contradict its file or each other. One
            line per error.
    """
    body, wheels, gear_ratio, rotor_inertia, mjcf_file = mechanics
    if not mjcf_file:
        return _build_standard_spec(mechanics)
    custom = read_custom_robot(mjcf_file)
    motor = {"gear_ratio": gear_ratio, "rotor_inertia_kg_m2": rotor_inertia}
    sections = {"body": body, "wheels": wheels, "motor": motor}
    raise_errors(custom.find_contradictions(sections))
    if wheels.model == "two-rollers" and not custom.has_uniform_rollers:
        raise OmniError(
            f"{custom.file}: wheels.model = two-rollers needs equal rollers, in one row, with one "
            "geom each; use rollers"
        )
    return custom


@lru_cache(maxsize=16)
def _build_standard_spec(mechanics: Mechanics) -> RobotSpec:
    """Return the specification of models/ssl_robot.xml with the numbers of the settings."""
    path = find_models_folder() / "ssl_robot.xml"
    root = ElementTree.parse(path).getroot()
    write_wheels(root, mechanics)
    for geom_class, attributes in _WORLD_CONTACTS.items():
        find_child(root, f"{DEFAULTS}/default[@class='{geom_class}']/geom").attrib |= attributes
    del find_child(root, "worldbody/body/geom[@name='hull']").attrib["euler"]
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.modelfiledir = str(path.parent)
    _set_chassis_inertia(spec, mechanics.body)
    for key in list(spec.keys):  # a keyframe fits only the world of one robot
        spec.delete(key)
    for number in range(1, len(mechanics.wheels.azimuths_deg) + 1):
        spec.body(f"rim_{number}").add_joint(
            spec.default,  # not that of the wheel's hinge
            name=f"slip_{number}",
            type=HINGE,
            axis=[-1, 0, 0],
            frictionloss=_SLIP_FRICTION_NM,
        )
    rollers = tuple(geom.name for geom in spec.geoms if geom.parent.name.startswith("roller_"))
    return RobotSpec(path.name, spec, rollers)


def write_wheels(root: Element, mechanics: Mechanics) -> None:
    """Put a copy of the first wheel at each azimuth, with a motor, gear and encoder."""
    wheels, count = mechanics.wheels, len(mechanics.wheels.azimuths_deg)
    frames = _replicate_first(root, "worldbody/body/frame", count)
    for azimuth, frame in zip(wheels.azimuths_deg, frames, strict=True):
        frame.set("euler", f"0 0 {azimuth!r}")
        hub = find_child(frame, "body")
        file_radius = float(hub.get("pos", "").split()[2])
        hub.set("pos", f"{wheels.arm_m!r} 0 {wheels.radius_m!r}")
        _scale_hub(hub, wheels.radius_m / file_radius)
        _write_rollers(frame, wheels)
    # Rollers are barrels. The radius of curvature of their profile is the wheel's radius.
    half_length = math.sqrt(wheels.radius_m * wheels.roller_radius_m)
    size = wheels.roller_radius_m, wheels.roller_radius_m, half_length
    roller_geom = find_child(root, f"{DEFAULTS}/default[@class='roller']/geom")
    roller_geom.set("size", " ".join(map(repr, size)))
    _remove_skirts(root, wheels)
    _replicate_first(root, "actuator/dcmotor", count)
    _replicate_first(root, "sensor/jointpos", count)
    motor = find_child(root, f"{DEFAULTS}/dcmotor")
    motor.set("gear", repr(mechanics.gear_ratio))
    motor.set("armature", repr(mechanics.rotor_inertia))


def _remove_skirts(root: Element, wheels: WheelSettings) -> None:
    """Remove the lower parts of the shell that would touch a wheel, by angles seen from above."""
    chassis, assets = find_child(root, "worldbody/body"), find_child(root, "asset")
    meshes = {mesh.get("name"): mesh for mesh in assets.findall("mesh")}
    half_angle = math.atan2(wheels.radius_m, wheels.arm_m)  # that a wheel takes up
    for geom in chassis.findall("geom"):
        if not geom.get("name", "").startswith("skirt_"):
            continue
        mesh = meshes.get(geom.get("mesh"))
        points = geom.attrib["pos"] if mesh is None else mesh.attrib["vertex"]
        x, y, _ = np.array(points.split(), float).reshape(-1, 3).T
        angles = np.arctan2(y, x)[:, None] - np.radians(wheels.azimuths_deg)
        if (np.cos(angles) > math.cos(half_angle)).any():
            chassis.remove(geom)
            if mesh is not None:
                assets.remove(mesh)


def _scale_hub(hub: Element, factor: float) -> None:
    """Scale hub and rim to the radius of the wheel; their thickness and density do not change."""
    geom = find_child(hub, "geom")
    radius, half_thickness = map(float, geom.get("size", "").split())
    geom.set("size", f"{radius * factor!r} {half_thickness!r}")
    for body in (hub, find_child(hub, "body")):
        inertial = find_child(body, "inertial")
        inertial.set("mass", repr(float(inertial.get("mass", "")) * factor**2))
        moments = (float(moment) * factor**4 for moment in inertial.get("diaginertia", "").split())
        inertial.set("diaginertia", " ".join(map(repr, moments)))


def _write_rollers(frame: Element, wheels: WheelSettings) -> None:
    """Set number and places of a wheel's rollers."""
    rollers = find_child(frame, "body/body/replicate")
    rollers.set("count", str(wheels.rollers))
    rollers.set("euler", f"{360 / wheels.rollers!r} 0 0")
    roller = find_child(rollers, "body")
    roller.set("pos", f"0 0 {wheels.roller_radius_m - wheels.radius_m!r}")


def _replicate_first(root: Element, path: str, count: int) -> list[Element]:
    """Replace all elements at a path by copies of the first one; return the copies."""
    template, parent = find_child(root, path), find_child(root, path.rpartition("/")[0])
    for element in root.findall(path):
        parent.remove(element)
    text = ElementTree.tostring(template, encoding="unicode")
    # Names of the first wheel and its parts contain _1.
    copies = [
        ElementTree.fromstring(text.replace("_1", f"_{number}")) for number in range(1, count + 1)
    ]
    parent.extend(copies)
    return copies


def find_child(parent: Element, path: str) -> Element:
    """Return an element of models/ssl_robot.xml."""
    element = parent.find(path)
    assert element is not None, path
    return element


def _set_chassis_inertia(spec: mujoco.MjSpec, body: BodySettings) -> None:
    """Set mass and inertia of the chassis to those of the robot minus those of the wheels.

    Raises:
        OmniError: The remaining mass or inertia is impossible.
    """
    (chassis,) = spec.worldbody.bodies
    model = spec.compile()
    wheel_bodies = [i for i in range(1, model.nbody) if i != chassis.id]
    wheel_mass, wheel_center, wheel_inertia = compute_composite_inertia(model, wheel_bodies)
    mass = body.mass_kg - wheel_mass
    if mass <= 0:
        raise OmniError(
            f"body.mass_kg must be more than the {wheel_mass:.3f} kg of the wheels, "
            f"not {body.mass_kg:g}"
        )
    robot_center = np.array([body.com_x_m, 0.0, body.com_height_m])
    center = (body.mass_kg * robot_center - wheel_mass * wheel_center) / mass
    # Inertias about the robot's center of mass, by the parallel axis theorem.
    robot_inertia = np.diag(
        [body.tilt_inertia_kg_m2, body.tilt_inertia_kg_m2, body.yaw_inertia_kg_m2]
    )
    wheel_shift = wheel_mass * compute_point_mass_inertia(wheel_center - robot_center)
    chassis_shift = mass * compute_point_mass_inertia(center - robot_center)
    inertia = robot_inertia - wheel_inertia - wheel_shift - chassis_shift
    moments = np.linalg.eigvalsh(inertia)  # principal moments, ascending
    if moments[0] <= 0 or moments[2] > moments[0] + moments[1]:
        raise OmniError(
            "body.yaw_inertia_kg_m2 and body.tilt_inertia_kg_m2 leave the chassis without its "
            f"wheels the principal inertias {moments} kg m^2, which no body has"
        )
    set_inertial(chassis, mass, center, inertia)

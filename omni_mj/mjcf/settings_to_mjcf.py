"""The specification of a robot from its settings: models/ssl_robot.xml with the settings' numbers.

The file contains chassis, hull, sensors, and a wheel of hub, rim and rollers. The settings contain
sizes, masses and counts: sections `body` and `wheels`, and gear and rotor of section `motor`. The
file's first wheel is copied for each azimuth. The mass of the chassis is that of the robot minus
that of the wheels.
"""

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_mj.config.robot_files import find_robot_mjcf
from omni_mj.config.robot_settings import BodySettings, ModelSettings, WheelSettings
from omni_mj.config.settings import Settings
from omni_mj.config.validation import raise_errors
from omni_mj.mjcf.custom_robot import RobotSpec, read_custom_robot
from omni_mj.mjcf.model_measurements import (
    compute_composite_inertia,
    compute_point_mass_inertia,
    set_inertial,
)

Element = ElementTree.Element


@dataclass(frozen=True)
class RobotShape:
    """The settings on which the model of a robot depends.

    Args:
        body: Mass and inertia.
        wheels: Geometry and model of the wheels.
        gear_ratio: Turns of the motor per turn of the wheel.
        rotor_inertia: Inertia of the motor's rotor, kg m^2.
        model: A user's own model, if there is one.
    """

    body: BodySettings
    wheels: WheelSettings
    gear_ratio: float
    rotor_inertia: float
    model: ModelSettings

    @classmethod
    def from_settings(cls, settings: Settings) -> "RobotShape":
        """Return the shape of a robot with these settings."""
        motor = settings.motor
        return cls(
            settings.body,
            settings.wheels,
            motor.gear_ratio,
            motor.rotor_inertia_kg_m2,
            settings.model,
        )


def build_robot_spec(shape: RobotShape) -> RobotSpec:
    """Return the specification of a robot: ours with the shape's numbers, or a user's own model.

    Raises:
        OmniError: The model lacks a part, or numbers contradict it or each other. One line per
            error.
    """
    if not shape.model.file:
        return _build_default_robot(shape)
    custom = read_custom_robot(shape.model.file)
    motor = {"gear_ratio": shape.gear_ratio, "rotor_inertia_kg_m2": shape.rotor_inertia}
    sections = {"body": shape.body, "wheels": shape.wheels, "motor": motor}
    raise_errors(custom.find_contradictions(sections))
    if shape.wheels.model == "two-rollers" and not custom.has_uniform_rollers:
        raise OmniError(
            f"{custom.file}: wheels.model = two-rollers needs equal rollers, in one row, with one "
            "geom each; use rollers"
        )
    return custom


@lru_cache(maxsize=16)
def _build_default_robot(shape: RobotShape) -> RobotSpec:
    """Return the specification of models/ssl_robot.xml with the numbers of a shape."""
    path = find_robot_mjcf()
    root = ElementTree.parse(path).getroot()
    _write_wheels(root, shape)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.modelfiledir = str(path.parent)
    _set_chassis_inertia(spec, shape.body)
    for key in list(spec.keys):  # their size is not that of a world
        spec.delete(key)
    rollers = tuple(geom.name for geom in spec.geoms if geom.parent.name.startswith("roller_"))
    return RobotSpec(path.name, spec, rollers)


def _write_wheels(root: Element, shape: RobotShape) -> None:
    """Put a copy of the first wheel, with its motor and its encoder, at each azimuth."""
    wheels, count = shape.wheels, len(shape.wheels.azimuths_deg)
    frames = _replicate_first(root, "worldbody/body/frame", count)
    for azimuth, frame in zip(wheels.azimuths_deg, frames, strict=True):
        frame.set("euler", f"0 0 {azimuth!r}")
        _find_child(frame, "body").set("pos", f"{wheels.arm_m!r} 0 {wheels.radius_m!r}")
        _write_rollers(frame, wheels)
    _replicate_first(root, "actuator/dcmotor", count)
    _replicate_first(root, "sensor/jointpos", count)
    motor = _find_child(root, "default/dcmotor")
    motor.set("gear", repr(shape.gear_ratio))
    motor.set("armature", repr(shape.rotor_inertia))


def _write_rollers(frame: Element, wheels: WheelSettings) -> None:
    """Set number and size of a wheel's rollers."""
    rollers = _find_child(frame, "body/body/replicate")
    rollers.set("count", str(wheels.rollers))
    rollers.set("euler", f"{360 / wheels.rollers!r} 0 0")
    roller = _find_child(rollers, "body")
    roller.set("pos", f"0 0 {wheels.roller_radius_m - wheels.radius_m!r}")
    # A barrel. The radius of curvature of its profile is the wheel's radius.
    half_length = math.sqrt(wheels.radius_m * wheels.roller_radius_m)
    size = wheels.roller_radius_m, wheels.roller_radius_m, half_length
    _find_child(roller, "geom").set("size", " ".join(map(repr, size)))


def _replicate_first(root: Element, path: str, count: int) -> list[Element]:
    """Replace all elements at a path by copies of the first one; return the copies."""
    template, parent = _find_child(root, path), _find_child(root, path.rpartition("/")[0])
    for element in root.findall(path):
        parent.remove(element)
    text = ElementTree.tostring(template, encoding="unicode")
    # Names of the first wheel and its parts contain _1.
    copies = [
        ElementTree.fromstring(text.replace("_1", f"_{number}")) for number in range(1, count + 1)
    ]
    parent.extend(copies)
    return copies


def _find_child(parent: Element, path: str) -> Element:
    """Return an element of models/ssl_robot.xml."""
    element = parent.find(path)
    assert element is not None, path
    return element


def _set_chassis_inertia(spec: mujoco.MjSpec, body: BodySettings) -> None:
    """Set mass and inertia of the chassis to those of the robot minus those of its other bodies.

    Raises:
        OmniError: The remaining mass or inertia is impossible.
    """
    (chassis,) = spec.worldbody.bodies
    model = spec.compile()
    wheel_bodies = [number for number in range(1, model.nbody) if number != chassis.id]
    wheel_mass, wheel_center, wheel_inertia = compute_composite_inertia(model, wheel_bodies)
    mass = body.mass_kg - wheel_mass
    robot_center = np.array([body.com_x_m, 0.0, body.com_height_m])
    if mass <= 0:
        raise OmniError(
            f"body.mass_kg must be more than the {wheel_mass:.3f} kg of the wheels, "
            f"not {body.mass_kg:g}"
        )
    center = (body.mass_kg * robot_center - wheel_mass * wheel_center) / mass
    robot_inertia = np.diag(
        [body.tilt_inertia_kg_m2, body.tilt_inertia_kg_m2, body.yaw_inertia_kg_m2]
    )
    wheel_offset = wheel_mass * compute_point_mass_inertia(wheel_center - robot_center)
    chassis_offset = mass * compute_point_mass_inertia(center - robot_center)
    inertia = robot_inertia - wheel_inertia - wheel_offset - chassis_offset
    principal = np.linalg.eigvalsh(inertia)
    if principal[0] <= 0 or principal[2] > principal[:2].sum():
        raise OmniError(
            "body.yaw_inertia_kg_m2 and body.tilt_inertia_kg_m2 leave the chassis without its "
            f"wheels the principal inertias {principal} kg m^2, which no body has"
        )
    set_inertial(chassis, mass, center, inertia)

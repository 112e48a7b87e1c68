"""A robot as a model: the MJCF of its shape, into which the numbers of its settings are written.

models/ssl_robot.xml says what a robot is made of: chassis, hull, sensors, and a wheel of hub, rim and rollers. The
settings say how large, how heavy, how many: sections `body` and `wheels`, and of the motor its gear and rotor. Of the
file's wheels the first is copied for each azimuth; what the chassis weighs is what the wheels leave of the robot.
"""

import copy
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_mj.mjcf.geometry import composite, spread, weigh
from omni_mj.scenarios.robot_settings import BodySettings, ModelSettings, WheelSettings
from omni_mj.scenarios.settings import Settings

Element = ElementTree.Element


@dataclass(frozen=True)
class Shape:
    """What of its settings a robot's model depends on.

    Args:
        body: mass and inertia.
        wheels: their geometry, and how they are computed.
        gear: turns of the motor for one of the wheel.
        rotor_inertia: of the motor, kg m^2.
        model: a user's own, if there is one.
    """

    body: BodySettings
    wheels: WheelSettings
    gear: float
    rotor_inertia: float
    model: ModelSettings

    @classmethod
    def of(cls, settings: Settings) -> "Shape":
        """That of a robot under these settings."""
        motor = settings.motor
        return cls(settings.body, settings.wheels, motor.gear, motor.rotor_inertia_kg_m2, settings.model)


def robot(shape: Shape, file: Path) -> mujoco.MjSpec:
    """The model of one robot.

    Args:
        shape: its numbers.
        file: MJCF of its parts.

    Raises:
        OmniError: the file lacks a part, or the wheels weigh more than the robot.
    """
    root = _parsed(file)
    _write_wheels(root, shape, file.name)
    spec = _spec(root, file)
    _balance(spec, shape.body, file.name)
    return spec


def _parsed(file: Path) -> Element:
    try:
        return ElementTree.parse(file).getroot()
    except ElementTree.ParseError as error:
        raise OmniError(f"{file.name}: {error}") from error


def _spec(root: Element, file: Path) -> mujoco.MjSpec:
    try:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        raise OmniError(f"{file.name}: {' '.join(str(error).split())}") from error
    spec.modelfiledir = str(file.parent)
    return spec


def _write_wheels(root: Element, shape: Shape, file: str) -> None:
    """Put a copy of the first wheel, with its motor and its encoder, where each wheel is."""
    wheels, chassis = shape.wheels, _found(root, "worldbody/body", file)
    count = len(wheels.azimuths_deg)
    for azimuth, frame in zip(wheels.azimuths_deg, _repeat_first(chassis, "frame", count, file), strict=True):
        frame.set("euler", f"0 0 {azimuth!r}")
        _found(frame, "body", file).set("pos", f"{wheels.arm_m!r} 0 {wheels.radius_m!r}")
        _write_rollers(frame, wheels, file)
    _repeat_first(root, "actuator/dcmotor", count, file)
    _repeat_first(root, "sensor/jointpos", count, file)
    motor = _found(root, "default/dcmotor", file)
    motor.set("gear", repr(shape.gear))
    motor.set("armature", repr(shape.rotor_inertia))


def _write_rollers(frame: Element, wheels: WheelSettings, file: str) -> None:
    """Make the rollers of a wheel close its circle; without creep, the rim is part of the hub."""
    rim = _found(frame, "body/body", file)
    if wheels.creep == "off":
        rim.remove(_found(rim, "joint", file))
    rollers = _found(rim, "replicate", file)
    rollers.set("count", str(wheels.rollers))
    rollers.set("euler", f"{360 / wheels.rollers!r} 0 0")
    roller = _found(rollers, "body", file)
    roller.set("pos", f"0 0 {wheels.roller_radius_m - wheels.radius_m!r}")
    # A barrel: its profile's radius of curvature is the wheel's radius.
    barrel = wheels.roller_radius_m, wheels.roller_radius_m, math.sqrt(wheels.radius_m * wheels.roller_radius_m)
    _found(roller, "geom", file).set("size", " ".join(map(repr, barrel)))


def _repeat_first(root: Element, path: str, count: int, file: str) -> list[Element]:
    """Put copies of the first element at a path, one for each wheel, in the place of all that are there."""
    first = _found(root, path, file)
    parent = _found(root, path.rpartition("/")[0] or ".", file)
    for each in root.findall(path):
        parent.remove(each)
    copies = [_numbered(first, number) for number in range(1, count + 1)]
    parent.extend(copies)
    return copies


def _numbered(first: Element, number: int) -> Element:
    """A copy of what belongs to wheel 1, named for another."""
    element = copy.deepcopy(first)
    for each in element.iter():
        for name in ("name", "joint"):
            if value := each.get(name):
                each.set(name, value.replace("_1", f"_{number}"))
    return element


def _found(parent: Element, path: str, file: str) -> Element:
    element = parent.find(path)
    if element is None:
        raise OmniError(f"{file}: <{parent.tag}> lacks {path}, as models/ssl_robot.xml has it")
    return element


def _balance(spec: mujoco.MjSpec, body: BodySettings, file: str) -> None:
    """Give the chassis the mass and inertia that all other bodies leave it."""
    (chassis,) = (each for each in spec.worldbody.bodies)
    model = spec.compile()
    others = [number for number in range(1, model.nbody) if number != chassis.id]
    mass, centre, inertia = composite(model, others)
    left = body.mass_kg - mass
    whole = np.array([body.centre_x_m, 0.0, body.centre_height_m])
    if left <= 0:
        raise OmniError(f"body.mass_kg must be more than the {mass:.3f} kg of the wheels, not {body.mass_kg:g}")
    at = (body.mass_kg * whole - mass * centre) / left
    own = np.diag([body.tilt_inertia_kg_m2, body.tilt_inertia_kg_m2, body.yaw_inertia_kg_m2])
    own = own - inertia - mass * spread(centre - whole) - left * spread(at - whole)
    principal = np.linalg.eigvalsh(own)
    if principal[0] <= 0 or principal[2] > principal[:2].sum():
        raise OmniError(
            f"body.yaw_inertia_kg_m2 and body.tilt_inertia_kg_m2 leave the chassis without its wheels the principal "
            f"inertias {principal} kg m^2, which no body has"
        )
    weigh(chassis, left, at, own)

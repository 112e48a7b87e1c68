"""A robot as a model: the MJCF of its shape, into which the numbers of its settings are written.

models/ssl_robot.xml says what a robot is made of: chassis, hull, sensors, and a wheel of hub, rim and rollers. The
settings say how large, how heavy, how many: sections `body` and `wheels`, and of the motor its gear and rotor. Of the
file's wheels the first is copied for each azimuth; what the chassis weighs is what the wheels leave of the robot.
"""

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_mj.config import resolve
from omni_mj.config.robot_files import find_robot_mjcf
from omni_mj.config.robot_settings import BodySettings, ModelSettings, WheelSettings
from omni_mj.config.settings import Settings
from omni_mj.config.validation import raise_errors
from omni_mj.mjcf.custom_robot import RobotSpec, hull
from omni_mj.mjcf.robot_geometry import compute_composite_inertia, point_mass_inertia, set_inertial

Element = ElementTree.Element


@dataclass(frozen=True)
class RobotShape:
    """What of its settings a robot's model depends on.

    Args:
        body: mass and inertia.
        wheels: their geometry, and how they are computed.
        gear_ratio: turns of the motor for one of the wheel.
        rotor_inertia: of the motor, kg m^2.
        model: a user's own, if there is one.
    """

    body: BodySettings
    wheels: WheelSettings
    gear_ratio: float
    rotor_inertia: float
    model: ModelSettings

    @classmethod
    def from_settings(cls, settings: Settings) -> "RobotShape":
        """That of a robot under these settings."""
        motor = settings.motor
        return cls(
            settings.body,
            settings.wheels,
            motor.gear_ratio,
            motor.rotor_inertia_kg_m2,
            settings.model,
        )


def build_robot_spec(shape: RobotShape) -> RobotSpec:
    """The robot of a shape, alone: ours with the numbers of its settings, or a user's own model.

    Raises:
        OmniError: the model lacks something, or numbers contradict it or each other; a line for
            each.
    """
    if not shape.model.file:
        return _ours(shape)
    own = resolve.read_model(shape.model)
    motor = {"gear_ratio": shape.gear_ratio, "rotor_inertia_kg_m2": shape.rotor_inertia}
    raise_errors(
        resolve.find_model_contradictions(
            {"body": shape.body, "wheels": shape.wheels, "motor": motor}, own
        )
    )
    if shape.wheels.model == "two-rollers" and not own.has_uniform_rollers:
        raise OmniError(
            f"{own.file}: wheels.model = two-rollers needs rollers that are all alike, in one row, of one geom each; "
            "take rollers"
        )
    return own


@lru_cache(maxsize=16)
def _ours(shape: RobotShape) -> RobotSpec:
    path = find_robot_mjcf()
    root = ElementTree.parse(path).getroot()
    _write_wheels(root, shape)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.modelfiledir = str(path.parent)
    _balance(spec, shape.body)
    for key in list(spec.keys):  # of another size than the world's
        spec.delete(key)
    rollers = tuple(geom.name for geom in spec.geoms if geom.parent.name.startswith("roller_"))
    return RobotSpec(path.name, spec, rollers, hull(spec))


def _write_wheels(root: Element, shape: RobotShape) -> None:
    """Put a copy of the first wheel, with its motor and its encoder, where each wheel is."""
    wheels, count = shape.wheels, len(shape.wheels.azimuths_deg)
    for azimuth, frame in zip(
        wheels.azimuths_deg, _repeat_first(root, "worldbody/body/frame", count), strict=True
    ):
        frame.set("euler", f"0 0 {azimuth!r}")
        _child(frame, "body").set("pos", f"{wheels.arm_m!r} 0 {wheels.radius_m!r}")
        _write_rollers(frame, wheels)
    _repeat_first(root, "actuator/dcmotor", count)
    _repeat_first(root, "sensor/jointpos", count)
    motor = _child(root, "default/dcmotor")
    motor.set("gear", repr(shape.gear_ratio))
    motor.set("armature", repr(shape.rotor_inertia))


def _write_rollers(frame: Element, wheels: WheelSettings) -> None:
    """Make the rollers of a wheel close its circle."""
    rollers = _child(frame, "body/body/replicate")
    rollers.set("count", str(wheels.rollers))
    rollers.set("euler", f"{360 / wheels.rollers!r} 0 0")
    roller = _child(rollers, "body")
    roller.set("pos", f"0 0 {wheels.roller_radius_m - wheels.radius_m!r}")
    # A barrel: its profile's radius of curvature is the wheel's radius.
    barrel = (
        wheels.roller_radius_m,
        wheels.roller_radius_m,
        math.sqrt(wheels.radius_m * wheels.roller_radius_m),
    )
    _child(roller, "geom").set("size", " ".join(map(repr, barrel)))


def _repeat_first(root: Element, path: str, count: int) -> list[Element]:
    """Put copies of the first element at a path, one for each wheel, in the place of all that are there."""
    first, parent = _child(root, path), _child(root, path.rpartition("/")[0])
    for element in root.findall(path):
        parent.remove(element)
    text = ElementTree.tostring(first, encoding="unicode")
    read_model_files = [
        ElementTree.fromstring(text.replace("_1", f"_{number}")) for number in range(1, count + 1)
    ]
    parent.extend(read_model_files)
    return read_model_files


def _child(parent: Element, path: str) -> Element:
    """Return an element of models/ssl_robot.xml."""
    element = parent.find(path)
    assert element is not None, path
    return element


def _balance(spec: mujoco.MjSpec, body: BodySettings) -> None:
    """Give the chassis the mass and inertia that all other bodies leave it."""
    (chassis,) = spec.worldbody.bodies
    model = spec.compile()
    others = [number for number in range(1, model.nbody) if number != chassis.id]
    mass, centre, inertia = compute_composite_inertia(model, others)
    left = body.mass_kg - mass
    whole = np.array([body.com_x_m, 0.0, body.com_height_m])
    if left <= 0:
        raise OmniError(
            f"body.mass_kg must be more than the {mass:.3f} kg of the wheels, not {body.mass_kg:g}"
        )
    at = (body.mass_kg * whole - mass * centre) / left
    own = np.diag([body.tilt_inertia_kg_m2, body.tilt_inertia_kg_m2, body.yaw_inertia_kg_m2])
    own = (
        own
        - inertia
        - mass * point_mass_inertia(centre - whole)
        - left * point_mass_inertia(at - whole)
    )
    principal = np.linalg.eigvalsh(own)
    if principal[0] <= 0 or principal[2] > principal[:2].sum():
        raise OmniError(
            f"body.yaw_inertia_kg_m2 and body.tilt_inertia_kg_m2 leave the chassis without its wheels the principal "
            f"inertias {principal} kg m^2, which no body has"
        )
    set_inertial(chassis, left, at, own)

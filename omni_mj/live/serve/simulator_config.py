"""Configuration of the simulator by clients: field, robot specs and realism."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from google.protobuf.message import DecodeError

from omni_control.errors import OmniError
from omni_control.kinematics import Array, wrap_angle
from omni_mj.config import distributions
from omni_mj.config.settings import Settings
from omni_mj.live.serve.detections import RobotName
from omni_mj.live.serve.simulation_requests import (
    Refusal,
    find_unknown_fields,
    read_name,
    robot_label,
)
from omni_mj.live.wire import MM_PER_M
from omni_mj.live.wire.league_pb2 import (
    AnyMessage,
    ErForceRealism,
    FieldSize,
    RobotSpecs,
    SimulatorError,
)
from omni_mj.mjcf.field import ROBOT_HEIGHT_M, ROBOT_RADIUS_M

ERFORCE_REALISM = b"RealismConfigErForce"  # end of the type of the message
# Field of ER-Force's realism -> setting, and unit of the field over ours.
REALISM_SETTINGS = {
    "stddev_robot_p": ("vision.position_noise_m", 1.0),
    "stddev_robot_phi": ("vision.heading_noise_rad", 1.0),
    "camera_overlap": ("vision.overlap_m", 1.0),
    "missing_robot_detections": ("vision.miss_probability", 1.0),
    "vision_delay": ("vision.delay_s", 1e-9),
    "robot_command_loss": ("radio.loss_probability", 1.0),
}
SPEED_LIMITS = "vel_absolute_max", "vel_angular_max"  # of `RobotLimits`, the ones that apply
DRIBBLER_M = 0.075  # from the robot's center to the front of its kicker, models/ssl_robot.xml
RELATIVE_TOLERANCE = 0.02  # within which a spec is that of the simulated robot


class RobotLimit(NamedTuple):
    """What clients configure of a robot.

    Attributes:
        speed: Largest commanded speed, m/s.
        turn_rate: Largest commanded turn rate, rad/s.
        dribbler: Distance from the center to the dribbler, m.
    """

    speed: float = math.inf
    turn_rate: float = math.inf
    dribbler: float = DRIBBLER_M

    def scale(self, velocity: Array) -> float:
        """Return the factor, at most 1, that brings a velocity [vx, vy, w] within the limits."""
        speed, turn_rate = math.hypot(*velocity[:2]), abs(float(velocity[2]))
        return min(1.0, self.speed / max(speed, 1e-9), self.turn_rate / max(turn_rate, 1e-9))


def read_specs(
    specs: RobotSpecs, settings: Settings, limits: Mapping[RobotName, RobotLimit]
) -> tuple[RobotName, RobotLimit, list[str]]:
    """Return the robot's name, its limits, and the names of fields that do not apply.

    Dimensions apply if they are those of the simulated robot.

    Args:
        specs: The request.
        settings: Settings of the simulated robots.
        limits: Present limits. They supply fields that the request lacks.

    Raises:
        Refusal: The robot or a number is invalid.
    """
    name = read_name(specs.id)
    values = {field.name: value for field, value in specs.ListFields() if isinstance(value, float)}
    bounds = {field.name: value for field, value in specs.limits.ListFields()}
    angles = [angle for _, angle in specs.wheel_angles.ListFields()]
    is_positive = all(0 < value < math.inf for value in (*values.values(), *bounds.values()))
    if not is_positive or not np.isfinite(angles).all():
        raise Refusal("SPECS", f"{robot_label(name)}: specs must be positive and finite")
    limit = limits.get(name, RobotLimit())
    limit = RobotLimit(
        bounds.pop(SPEED_LIMITS[0], limit.speed),
        bounds.pop(SPEED_LIMITS[1], limit.turn_rate),
        values.pop("center_to_dribbler", limit.dribbler),
    )
    fixed = {
        "radius": ROBOT_RADIUS_M,
        "height": ROBOT_HEIGHT_M,
        "mass": settings.body.mass_kg,
    }
    ignored = [
        field
        for field, value in values.items()
        if not math.isclose(value, fixed.get(field, math.nan), rel_tol=RELATIVE_TOLERANCE)
    ]
    if angles and not _has_wheel_angles(settings, angles):
        ignored.append("wheel_angles")
    return name, limit, [*ignored, *bounds, *["custom"] * bool(specs.custom)]


def read_realism(message: AnyMessage, settings: Settings) -> tuple[Settings, list[SimulatorError]]:
    """Return the settings with those of a realism message, and errors for its other fields.

    Raises:
        Refusal: The message is none of ER-Force's simulator, or a value is not allowed.
    """
    if not message.type_url.endswith(ERFORCE_REALISM):
        raise Refusal("REALISM", f"serve knows realism of the type {ERFORCE_REALISM.decode()} only")
    realism = ErForceRealism()
    try:
        realism.ParseFromString(message.value)
        errors = find_unknown_fields(realism)
        values = dict[str, float]()
        for field, value in realism.ListFields():
            name, unit = REALISM_SETTINGS[field.name]
            values[name] = unit * value
        return distributions.replace_values(settings, values), errors
    except (DecodeError, OmniError) as error:
        raise Refusal("REALISM", " ".join(str(error).split())) from None


def read_field(size: FieldSize, settings: Settings) -> Settings:
    """Return the settings with the size of a client's field.

    Raises:
        Refusal: The field is too small or too large.
    """
    values = {
        "world.field_length_m": size.field_length / MM_PER_M,
        "world.field_width_m": size.field_width / MM_PER_M,
        "world.field_margin_m": size.boundary_width / MM_PER_M,
    }
    try:
        return distributions.replace_values(settings, values)
    except OmniError as error:
        raise Refusal("GEOMETRY", " ".join(str(error).split())) from None


def _has_wheel_angles(settings: Settings, angles: Sequence[float]) -> bool:
    """Return whether the simulated robot's wheels have these angles, clockwise from the front."""
    azimuths = -np.radians(settings.wheels.azimuths_deg[::-1])
    if len(azimuths) != len(angles):
        return False
    return bool((np.abs(wrap_angle(angles - azimuths)) < RELATIVE_TOLERANCE).all())

"""A robot by name or file, read, completed and checked as a whole."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from omni_control.errors import OmniError
from omni_control.traction import GRAVITY, traction_limits
from omni_mj.config import robot_files, team_model
from omni_mj.config.resolve import Robot, resolve
from omni_mj.config.robot_settings import support
from omni_mj.config.settings import Settings
from omni_mj.mjcf import world_builder


def load_robot(name_or_path: str | Path) -> Robot:
    """Read a robot, check every number of it, and build it once, so that what is wrong with it is said now.

    What it gives may be passed wherever a robot's name may. Its `facts`::

        mass_kg               with the wheels
        top_speed_ahead_m_s   at which the back-EMF of the fastest wheel is the firmware's nominal voltage; and aside
        grip_ahead_m_s2       acceleration at which the wheels begin to slide on `carpet.friction`; and aside
        tips_at_m_s2          acceleration, in the worst direction, at which a wheel lifts
        lag_ahead_s           time constant of its speed at rest, of a loop that integrates that of its gain; and aside
        drag_ahead_m_s        speed that dry friction costs; and aside. The same

    What its team is told of it is in `settings.control`: lag_s, drag_m_s, creep_s2_m, alpha_forward
    and others.

    Args:
        name_or_path: of a robot that comes with the package, or the path of a .toml file.

    Raises:
        OmniError: there is no such robot, its file is no robot's, lacks something, or its numbers
            contradict each other or physics; a line for each.
    """
    name = str(name_or_path)
    path, says = robot_files.robot_path(name), robot_files.description(name)
    settings = resolve({}, name)
    try:
        world_builder.world(settings)
    except OmniError as error:
        raise OmniError(f"{path}: {error}") from None
    return Robot(name, path, says, settings, _facts(settings))


def _facts(settings: Settings) -> Mapping[str, float]:
    body, wheels, motor = settings.body, settings.wheels, settings.motor
    kinematics = wheels.kinematics
    fastest = (
        settings.firmware.nominal_voltage_v / (motor.constant_nm_a * motor.gear) * wheels.radius_m
    )
    inside = support(wheels.azimuths_deg, wheels.arm_m, body.centre_x_m)
    of_axes = {
        "top_speed_{}_m_s": fastest / np.abs(kinematics.matrix[:, :2]).max(0),
        "grip_{}_m_s2": traction_limits(kinematics, settings.carpet.friction, body.centre_height_m),
        "lag_{}_s": team_model.lag(settings),
        "drag_{}_m_s": team_model.drag(settings),
    }
    facts = {"mass_kg": body.mass_kg, "tips_at_m_s2": inside / body.centre_height_m * GRAVITY}
    for name, values in of_axes.items():
        facts |= {
            name.format(axis): float(value)
            for axis, value in zip(("ahead", "aside"), values, strict=True)
        }
    return MappingProxyType(facts)

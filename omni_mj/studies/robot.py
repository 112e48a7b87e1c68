"""A robot by name or file, read, completed and checked as a whole."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from omni_control.errors import OmniError
from omni_control.traction import traction_limits
from omni_mj.scenarios import robots, told
from omni_mj.scenarios.resolve import Robot, resolve
from omni_mj.scenarios.robot_settings import support
from omni_mj.scenarios.settings import Settings
from omni_mj.worlds import build


def robot(name_or_path: str | Path) -> Robot:
    """Read a robot, check every number of it, and build it once, so that what is wrong with it is said now.

    What it gives may be passed wherever a robot's name may. Its `facts`::

        mass_kg               with the wheels
        top_speed_ahead_m_s   at which the back-EMF of the fastest wheel is the firmware's nominal voltage; and aside
        grip_ahead_m_s2       acceleration at which the wheels begin to slide on `carpet.friction`; and aside
        tips_at_m_s2          acceleration, in the worst direction, at which a wheel lifts
        lag_ahead_s           time constant of its speed at rest, of a loop that integrates that of its gain; and aside
        drag_ahead_m_s        speed that dry friction costs; and aside. The same
        told_lag_s            `control.lag_s` and `control.drag_m_s`, which its team is told: the means of these, if its
        told_drag_m_s         file does not say otherwise
        told_creep_s2_m       `control.creep_s2_m`, same: T ahead, by the law of creep
        told_creep_aside_s2_m `control.creep_sideways_s2_m`, T aside
        told_alpha_ahead      what it is told to reach of a command: `control.alpha_forward`; and aside. 0: not known

    Args:
        name_or_path: of a robot that comes with the package, or the path of a .toml file.

    Raises:
        OmniError: there is no such robot, its file is no robot's, lacks something, or its numbers contradict each other
            or physics; a line for each.
    """
    name = str(name_or_path)
    path, says = robots.robot_path(name), robots.description(name)
    settings = resolve({}, name)
    try:
        build.world(settings)
    except OmniError as error:
        raise OmniError(f"{path}: {error}") from None
    return Robot(name, path, says, settings, _facts(settings))


def _facts(settings: Settings) -> Mapping[str, float]:
    body, wheels, motor = settings.body, settings.wheels, settings.motor
    kinematics = wheels.kinematics
    fastest = settings.firmware.nominal_voltage_v / (motor.constant_nm_a * motor.gear) * wheels.radius_m
    ahead, aside = fastest / np.abs(kinematics.matrix[:, :2]).max(0)
    grip_ahead, grip_aside = traction_limits(kinematics, settings.carpet.friction, body.centre_height_m)
    (lag_ahead, lag_aside), (drag_ahead, drag_aside) = told.lag(settings), told.drag(settings)
    inside = support(wheels.azimuths_deg, wheels.arm_m, body.centre_x_m)
    return MappingProxyType(
        {
            "mass_kg": body.mass_kg,
            "top_speed_ahead_m_s": float(ahead),
            "top_speed_aside_m_s": float(aside),
            "grip_ahead_m_s2": float(grip_ahead),
            "grip_aside_m_s2": float(grip_aside),
            "tips_at_m_s2": inside / body.centre_height_m * told.GRAVITY_M_S2,
            "lag_ahead_s": float(lag_ahead),
            "lag_aside_s": float(lag_aside),
            "drag_ahead_m_s": float(drag_ahead),
            "drag_aside_m_s": float(drag_aside),
            "told_lag_s": settings.control.lag_s,
            "told_drag_m_s": settings.control.drag_m_s,
            "told_creep_s2_m": settings.control.creep_s2_m,
            "told_creep_aside_s2_m": settings.control.creep_sideways_s2_m,
            "told_alpha_ahead": settings.control.alpha_forward,
            "told_alpha_aside": settings.control.alpha_sideways,
        }
    )

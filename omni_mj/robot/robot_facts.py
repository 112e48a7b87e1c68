"""Load a robot and derive its top speed, traction, lag and friction loss."""

from pathlib import Path
from types import MappingProxyType

import numpy as np

from omni_control.arguments import check_types
from omni_control.errors import OmniError
from omni_control.traction_limits import GRAVITY, compute_traction_limits
from omni_mj.config import nominal_model, robot_files
from omni_mj.config.resolve import Robot, resolve_settings
from omni_mj.config.settings import Settings
from omni_mj.mjcf import world_builder
from omni_mj.mjcf.custom_robot import RobotSpec
from omni_mj.mjcf.robot_builder import build_robot_spec
from omni_mj.mjcf.robot_geometry import measure_wheels
from omni_mj.mjcf.robot_parts import find_robots


@check_types
def load_robot(name_or_path: str | Path) -> Robot:
    """Read a robot's file, check every number, and build its MuJoCo model once to find errors.

    The result may be passed wherever a robot's name may. It has these `facts`; those that end in
    _forward have a counterpart that ends in _sideways::

        mass_kg                     mass with the wheels
        top_speed_forward_m_s       speed at which the back-EMF of the fastest wheel reaches the
                                    nominal voltage of the firmware
        traction_limit_forward_m_s2 acceleration, against drag, at which wheels start to slide
                                    on `carpet.friction`; 0 if drag exceeds it in some motion
        tipping_limit_m_s2          acceleration, in the worst direction, that lifts a wheel
        lag_forward_s               time constant of the closed speed loop at low speed
        friction_loss_forward_m_s   speed lost to dry friction
        axle_ripple_m               height by which axles rise and fall from roller to roller

    `settings.control` holds the model that the robot's team assumes: assumed_lag_s,
    assumed_friction_loss_m_s, assumed_creep_s2_m, assumed_alpha_forward and others.

    Args:
        name_or_path: Name of a built-in robot, or the path of a .toml file.

    Raises:
        OmniError: The robot does not exist, its file is not a robot's or lacks a value, or its
            numbers contradict each other or physics; one line for each error.
    """
    name = str(name_or_path)
    path = robot_files.find_robot_file(name)
    description, _ = robot_files.read_robot_file(name)
    settings = resolve_settings({}, name)
    try:
        world_builder.build_world(settings)
    except OmniError as error:
        raise OmniError(f"{path}: {error}") from None
    facts = _derive_facts(settings)
    facts["axle_ripple_m"] = _measure_ripple(build_robot_spec(settings.mechanics))
    return Robot(name, path, description, settings, MappingProxyType(facts))


def _measure_ripple(robot_spec: RobotSpec) -> float:
    """Return the height by which a robot's axles rise and fall while its wheels roll, m."""
    model = robot_spec.spec.copy().compile()
    (robot,) = find_robots(model)
    contact_geoms = np.array([model.geom(name).id for name in robot_spec.contact_geoms])
    return measure_wheels(model, robot, contact_geoms).ripple


def _derive_facts(settings: Settings) -> dict[str, float]:
    """Return the facts that follow from settings, by name; see `load_robot`."""
    body, wheels, motor = settings.body, settings.wheels, settings.motor
    kinematics = wheels.kinematics
    rim_speed = settings.firmware.nominal_voltage_v / motor.wheel_back_emf_v_s * wheels.radius_m
    tipping_limit = wheels.compute_support_margin(body.com_x_m) / body.com_height_m * GRAVITY
    axis_facts = {
        "top_speed_{}_m_s": rim_speed / np.abs(kinematics.matrix[:, :2]).max(0),
        "traction_limit_{}_m_s2": _compute_traction_limits(settings),
        "lag_{}_s": nominal_model.compute_lag(settings),
        "friction_loss_{}_m_s": nominal_model.compute_friction_loss(settings),
    }
    facts = {"mass_kg": body.mass_kg, "tipping_limit_m_s2": tipping_limit}
    for name, (forward, sideways) in axis_facts.items():
        facts[name.format("forward")] = float(forward)
        facts[name.format("sideways")] = float(sideways)
    return facts


def _compute_traction_limits(settings: Settings) -> tuple[float, float]:
    """Return the highest accelerations forward and sideways; see `load_robot`."""
    body, carpet = settings.body, settings.carpet
    try:
        return compute_traction_limits(
            settings.wheels.kinematics,
            carpet.friction,
            body.com_height_m,
            carpet.rolling_resistance,
            settings.drivetrain.roller_friction,
            body.com_x_m,
        )
    except OmniError:
        return 0.0, 0.0

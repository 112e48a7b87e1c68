"""Settings of the robot: body, wheels, drivetrain, firmware, sensors and battery."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from omni_control.kinematics import Kinematics
from omni_mj.config import CYCLE_RATE_HZ
from omni_mj.config.validation import Angles, SettingsModel, setting

# Depth by which the weight presses rollers into the carpet (omni_mj.mjcf.rollers,
# 2.65 kg on 4 wheels), rounded up.
CONTACT_DEPTH_M = 7e-5


class ModelSettings(SettingsModel):
    """The MJCF of a custom robot, which defines `body`, `wheels` and gear."""

    file: str = setting(
        "", "", "path of the MJCF of a custom robot, which defines geometry and masses"
    )


class BodySettings(SettingsModel):
    """The whole robot, including wheels."""

    mass_kg: float = setting(..., "kg", "mass", 0.5, 20)
    com_x_m: float = setting(
        ..., "m", "position of the center of mass, forward of the wheels' center", -0.1, 0.1
    )
    com_height_m: float = setting(..., "m", "height of the center of mass", 0.01, 0.15)
    yaw_inertia_kg_m2: float = setting(
        ..., "kg m^2", "moment of inertia about the vertical axis at the center of mass", 1e-4, 1
    )
    tilt_inertia_kg_m2: float = setting(
        ..., "kg m^2", "moment of inertia about any horizontal axis at the center of mass", 1e-4, 1
    )


class WheelSettings(SettingsModel):
    """Omnidirectional wheels: layout, dimensions and model."""

    model: Literal["rollers", "two-rollers"] = setting(
        "rollers",
        "",
        "rollers: all rollers of a wheel; two-rollers: only those at the carpet, faster",
    )
    azimuths_deg: Annotated[Angles, Field(min_length=3, max_length=8)] = setting(
        ..., "deg", "directions of the wheels from the center, counter-clockwise from forward"
    )
    arm_m: float = setting(..., "m", "distance of the wheel contacts from the center", 0.02, 0.5)
    radius_m: float = setting(..., "m", "wheel radius", 0.01, 0.2)
    rollers: int = setting(..., "", "number of rollers of a wheel", 8, 40)
    roller_radius_m: float = setting(..., "m", "largest radius of a roller", 0.002, 0.05)

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics of a robot with these wheels."""
        return Kinematics(np.radians(self.azimuths_deg) % (2 * np.pi), self.arm_m, self.radius_m)

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if the rollers do not fit into a wheel or do not close it."""
        radius, roller, count = self.radius_m, self.roller_radius_m, self.rollers
        if 2 * roller >= radius:
            yield (
                f"wheels.roller_radius_m = {roller:g} leaves no room for an axle in a wheel of "
                f"wheels.radius_m = {radius:g}; it must be below half of that"
            )
            return
        # At its ends, half a pitch away, the radius of a barrel roller is R cos(pi/n) - (R - r).
        needed = math.pi / math.acos(1 - roller / radius)
        if count <= needed:
            yield (
                f"wheels.rollers = {count} of wheels.roller_radius_m = {roller:g} do not close a "
                f"wheel of wheels.radius_m = {radius:g}: their ends do not meet; it takes "
                f"{math.floor(needed) + 1} at least, or thicker ones"
            )
        elif self.model == "two-rollers":
            clearance = radius - compute_roller_depth(radius, roller, math.tau / count)
            if clearance < CONTACT_DEPTH_M:
                yield (
                    f"wheels.rollers = {count} is too many for wheels.model = two-rollers: with "
                    f"wheels.roller_radius_m = {roller:g} more than two of a wheel touch the "
                    "carpet; take rollers"
                )


class DrivetrainSettings(SettingsModel):
    """The drivetrain between motor and carpet: gear, roller bearings and rubber."""

    gear_friction_nm: float = setting(
        ..., "N m", "dry friction torque of a gear, at the wheel", 0, 1
    )
    roller_friction: float = setting(
        ..., "", "dry friction of a roller's bearing: force at its rim over normal force", 0, 1
    )
    roller_damping_nm_s: float = setting(
        ..., "N m s/rad", "viscous friction of a roller's bearing", 0, 2e-5
    )
    creep_stiffness: float = setting(
        ..., "", "creep stiffness: traction over normal force per slip, below friction", 0.1, 1e3
    )


class FirmwareSettings(SettingsModel):
    """Control loops on the robot: a PID loop per wheel, a turn-rate loop and a heading filter.

    By default the wheel loops are proportional with feedforward, as in the firmware of TIGERs
    (k_i = 0) and RoboJackets. Gains refer to the wheel, not to the motor.
    """

    rate_hz: int = setting(
        CYCLE_RATE_HZ,
        "Hz",
        "rate of the wheel and turn-rate loops; must divide 960",
        60,
        CYCLE_RATE_HZ,
    )
    kp: float = setting(0.3, "V s/rad", "proportional gain of a wheel loop", 0, 100)
    ki: float = setting(0.0, "V/rad", "integral gain of a wheel loop", 0, 1000)
    kd: float = setting(0.0, "V s^2/rad", "derivative gain of a wheel loop", 0, 1)
    feedforward: float = setting(
        1.0, "", "feedforward gain: fraction of the desired speed's back-EMF", 0, 2
    )
    nominal_voltage_v: float = setting(
        ..., "V", "battery voltage that the firmware assumes for its duty cycles", 1, 60
    )
    turn_rate_gain: float = setting(
        1.0, "", "proportional gain of the turn-rate loop on the gyro", 0, 10
    )
    heading_gain: float = setting(
        2.0, "1/s", "heading filter: heading correction per difference from vision", 0, 30
    )
    gyro_bias_gain: float = setting(
        0.5, "1/s^2", "heading filter: gyro bias correction per difference from vision", 0, 100
    )
    current_limit_a: float = setting(..., "A", "current limit of a motor driver", 0.1, 1e3)
    timeout_s: float = setting(
        0.0,
        "s",
        "stop after this time without a command (league's simulators: 0.1); 0: never",
        0,
        60,
    )
    thermal_derating: bool = setting(
        False, "", "limit the current of a motor whose winding nears its maximum temperature"
    )

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if the loop rate does not divide the rate of the physics."""
        rates = [CYCLE_RATE_HZ // n for n in range(1, 17) if CYCLE_RATE_HZ % n == 0]
        if self.rate_hz not in rates:
            yield (
                f"firmware.rate_hz must divide the {CYCLE_RATE_HZ} Hz of the physics "
                f"({', '.join(map(str, rates))}), not {self.rate_hz}"
            )


class SensorSettings(SettingsModel):
    """Encoders and gyro."""

    encoder_counts: int = setting(
        ..., "", "encoder counts per revolution of a motor, all four edges", 1, 1_000_000
    )
    gyro_noise_rad_s: float = setting(
        0.005, "rad/s", "standard deviation of the gyro, averaged over a frame", 0, 10
    )
    gyro_bias_rad_s: float = setting(
        0.01, "rad/s", "standard deviation of the gyro bias, drawn once per seed", 0, 10
    )


class BatterySettings(SettingsModel):
    """A lithium polymer battery."""

    charge: float = setting(
        0.5, "", "initial state of charge: 1 full (4.2 V a cell), 0.5 nominal (3.7 V)", 0, 1
    )
    series_cells: int = setting(..., "", "number of cells in series", 1, 6)
    capacity_ah: float = setting(..., "Ah", "capacity", 0.01, 100)
    resistance_ohm: float = setting(
        ..., "ohm", "internal resistance, including wires and connectors", 0, 1
    )
    cut_off_v: float = setting(
        ..., "V", "cut-off voltage: below it for a second, the battery switches off", 0, 60
    )


def compute_roller_depth(radius: float, roller_radius: float, angle: float) -> float:
    """Return how far a roller reaches below the wheel's axle, m.

    Rollers are ellipsoids about a chord of the wheel, with the semi-axes r across and sqrt(R r)
    along the chord. The curvature of their profile is that of the wheel, 1/R.

    Args:
        radius: Radius R of the wheel, m.
        roller_radius: Largest radius r of the roller, m.
        angle: Angle of the roller's center from the lowest point of the wheel, rad.
    """
    c, s = math.cos(angle), math.sin(angle)
    semi_axis = math.sqrt(radius * roller_radius)
    return (radius - roller_radius) * c + math.hypot(roller_radius * c, semi_axis * s)


def compute_support_margin(azimuths: Sequence[float], arm: float, x: float) -> float:
    """Return the distance of a point (x, 0) from the edge of the support polygon, m.

    The polygon connects the wheel contacts. The distance is negative for a point outside.

    Args:
        azimuths: Directions of the wheels, deg.
        arm: Distance of the contacts from the center, m.
        x: Position of the point, m.
    """
    angles = sorted(math.radians(azimuth % 360) for azimuth in azimuths)
    margin = math.inf
    for start, end in pairwise([*angles, angles[0] + math.tau]):
        middle, half = (start + end) / 2, (end - start) / 2
        margin = min(margin, arm * math.cos(half) - x * math.cos(middle))
    return margin

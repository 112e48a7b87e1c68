"""Settings of the robot, of the carpet under it, and of what varies from robot to robot."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from omni_control.kinematics import Kinematics
from omni_mj.config import CYCLE_RATE_HZ
from omni_mj.config.validation import Angles, Patches, SettingsModel, setting

# By which a robot's weight presses rollers into the carpet (omni_mj.mjcf.contact_parameters, 2.65
# kg on 4 wheels), rounded up.
SINKS_M = 7e-5


class ModelSettings(SettingsModel):
    """A robot's own MJCF, which then says what `body`, `wheels` and gear would; empty: the shape that comes along."""

    file: str = setting(
        "", "", "path of the MJCF of a robot of yours, which says its geometry and masses"
    )


class BodySettings(SettingsModel):
    """The whole robot, wheels included."""

    mass_kg: float = setting(..., "kg", "mass", 0.5, 20)
    com_x_m: float = setting(..., "m", "centre of mass, ahead of the middle", -0.1, 0.1)
    com_height_m: float = setting(..., "m", "centre of mass, height", 0.01, 0.15)
    yaw_inertia_kg_m2: float = setting(
        ..., "kg m^2", "about the vertical axis through the centre of mass", 1e-4, 1
    )
    tilt_inertia_kg_m2: float = setting(
        ..., "kg m^2", "about any horizontal axis through it", 1e-4, 1
    )


class WheelSettings(SettingsModel):
    """The wheels: where they are, what they are made of, and how they are computed."""

    model: Literal["rollers", "two-rollers"] = setting(
        "rollers", "", "rollers: all of each wheel; two-rollers: those at the carpet, faster"
    )
    azimuths_deg: Annotated[Angles, Field(min_length=3, max_length=8)] = setting(
        ..., "deg", "where they are, counter-clockwise from ahead"
    )
    arm_m: float = setting(..., "m", "from the robot's centre to where they touch", 0.02, 0.5)
    radius_m: float = setting(..., "m", "radius", 0.01, 0.2)
    rollers: int = setting(..., "", "rollers of a wheel", 8, 40)
    roller_radius_m: float = setting(..., "m", "radius of a roller", 0.002, 0.05)

    @property
    def kinematics(self) -> Kinematics:
        """Of a robot with these wheels."""
        return Kinematics(np.radians(self.azimuths_deg) % (2 * np.pi), self.arm_m, self.radius_m)

    def find_contradictions(self) -> Iterator[str]:
        """Yield what wheels cannot be, a line each: rollers that do not fit or close a wheel."""
        radius, roller, count = self.radius_m, self.roller_radius_m, self.rollers
        if 2 * roller >= radius:
            yield (
                f"wheels.roller_radius_m = {roller:g} leaves no room for an axle in a wheel of wheels.radius_m = "
                f"{radius:g}; it must be below half of that"
            )
            return
        # A barrel thins from its middle to its ends, half a pitch away: there its radius is R
        # cos(pi/n) - (R - r).
        needed = math.pi / math.acos(1 - roller / radius)
        if count <= needed:
            yield (
                f"wheels.rollers = {count} of wheels.roller_radius_m = {roller:g} do not close a wheel of "
                f"wheels.radius_m = {radius:g}: their ends do not meet; it takes {math.floor(needed) + 1} at least, or "
                "thicker ones"
            )
        elif (
            self.model == "two-rollers"
            and radius - compute_roller_depth(radius, roller, math.tau / count) < SINKS_M
        ):
            yield (
                f"wheels.rollers = {count} is too many for wheels.model = two-rollers: with wheels.roller_radius_m = "
                f"{roller:g} more than two of a wheel touch the carpet; take rollers"
            )


class DrivetrainSettings(SettingsModel):
    """What is between motor and carpet."""

    gear_friction_nm: float = setting(..., "N m", "dry friction of a gear, at the wheel", 0, 1)
    roller_friction: float = setting(
        ..., "", "dry friction of a roller's bearing, at its rim: share of the load", 0, 1
    )
    roller_damping_nm_s: float = setting(
        ..., "N m s/rad", "viscous friction of a roller's bearing", 0, 2e-5
    )
    creep_stiffness: float = setting(
        ...,
        "",
        "traction over load per slip, below friction",
        0.1,
        1e3,
    )


class CarpetSettings(SettingsModel):
    """The carpet under the rollers."""

    friction: float = setting(
        0.8, "", "coefficient of friction, all wheels (the league's simulators)", 0.01, 5
    )
    rolling_resistance: float = setting(
        ..., "", "rolling resistance of its pile, against any motion: share of the load", 0, 1
    )
    nap: float = setting(
        0.0,
        "",
        "how its drag changes with direction: it is pile (1 + nap cos(direction - nap_direction_deg))",
        0,
        1,
    )
    nap_direction_deg: float = setting(
        0.0, "deg", "direction of travel straight against its fibres, in the world", -360, 360
    )
    patches: Patches = setting(
        (),
        "m, m, m, 1",
        "circles [x, y, radius, friction] of other friction; where several overlap, the last counts",
        0,
        50,
    )


class RandomizationSettings(SettingsModel):
    """What sets robots of a kind apart, drawn once per seed and robot; normal numbers are cut at 3 deviations."""

    wheel_friction_std: float = setting(
        0.0, "", "standard deviation of each wheel's friction, relative", 0, 0.3
    )
    max_wear_m: float = setting(
        0.0, "m", "each wheel has lost up to this of its rollers' radius, uniformly", 0, 0.001
    )
    torque_constant_std: float = setting(
        0.0, "", "standard deviation of each motor's torque constant, relative", 0, 0.3
    )
    mass_std: float = setting(
        0.0, "", "standard deviation of what the wheels carry, relative (batteries, covers)", 0, 0.3
    )
    com_offset_std_m: float = setting(
        0.0, "m", "standard deviation of where the middle of that mass is, ahead and aside", 0, 0.01
    )


class FirmwareSettings(SettingsModel):
    """What runs on the robot: wheel loops, one PID per wheel, with gains at the wheel, and heading.

    By default the wheel loops are proportional with feed-forward, as in the firmware of TIGERs (k_i
    = 0) and RoboJackets.
    """

    rate_hz: int = setting(
        CYCLE_RATE_HZ,
        "Hz",
        "rate of the wheel and turn-rate loops: 960 divided by a whole number",
        60,
        CYCLE_RATE_HZ,
    )
    kp: float = setting(0.3, "V s/rad", "voltage per error of the wheel speed", 0, 100)
    ki: float = setting(0.0, "V/rad", "voltage per integrated error", 0, 1000)
    kd: float = setting(0.0, "V s^2/rad", "voltage per rate of the error", 0, 1)
    feed_forward: float = setting(
        1.0, "", "share of the wanted speed's back-EMF that is fed forward", 0, 2
    )
    nominal_voltage_v: float = setting(..., "V", "battery voltage that it reckons with", 1, 60)
    turn_rate_gain: float = setting(
        1.0, "", "turn rate added per error of the turn rate that the gyro shows", 0, 10
    )
    heading_gain: float = setting(2.0, "1/s", "heading corrected per difference to vision's", 0, 30)
    gyro_bias_gain: float = setting(
        0.5, "1/s^2", "gyro bias corrected per difference to vision's heading", 0, 100
    )
    current_limit_a: float = setting(
        ..., "A", "highest current that a motor's driver lets through", 0.1, 1e3
    )
    timeout_s: float = setting(
        0.0,
        "s",
        "a robot stops when no command has come for so long (simulators of the league: 0.1); 0: never",
        0,
        60,
    )
    thermal_derating: bool = setting(
        False, "", "limit the current of a motor that nears its highest winding temperature"
    )

    def find_contradictions(self) -> Iterator[str]:
        """Yield what its clock cannot do."""
        rates = [CYCLE_RATE_HZ // n for n in range(1, 17) if CYCLE_RATE_HZ % n == 0]
        if self.rate_hz not in rates:
            yield (
                f"firmware.rate_hz must divide the {CYCLE_RATE_HZ} Hz of the physics ({', '.join(map(str, rates))}), "
                f"not {self.rate_hz}"
            )


class SensorSettings(SettingsModel):
    """The sensors on the robot."""

    encoder_counts: int = setting(..., "", "counts per revolution of a motor", 1, 1_000_000)
    gyro_noise_rad_s: float = setting(
        0.005, "rad/s", "standard deviation of the gyro over a frame", 0, 10
    )
    gyro_bias_rad_s: float = setting(
        0.01, "rad/s", "standard deviation of its bias, one per seed", 0, 10
    )


class BatterySettings(SettingsModel):
    """The battery: LiPo."""

    charge: float = setting(
        0.5, "", "state of charge at the start: 1 full (4.2 V a cell), 0.5 nominal (3.7 V)", 0, 1
    )
    series_cells: int = setting(..., "", "cells in series", 1, 6)
    capacity_ah: float = setting(..., "Ah", "capacity", 0.01, 100)
    resistance_ohm: float = setting(
        ..., "ohm", "internal resistance: cells, wires and connectors", 0, 1
    )
    cut_off_v: float = setting(
        ..., "V", "below it, over a second, the battery gives no more power", 0, 60
    )


def compute_roller_depth(radius: float, roller_radius: float, angle: float) -> float:
    """Return how far a roller reaches below the axle when it is `angle` (rad) away from the bottom, m.

    Rollers are ellipsoids about a chord of the wheel, with half-axes r across and sqrt(R r) along,
    the barrel whose profile has the wheel's radius R of curvature.
    """
    c, s = math.cos(angle), math.sin(angle)
    along = math.sqrt(radius * roller_radius)
    return (radius - roller_radius) * c + math.hypot(roller_radius * c, along * s)


def compute_support_margin(azimuths: Sequence[float], arm: float, x: float) -> float:
    """Return how far a point (x, 0) is inside the polygon of the wheels' contacts, m; negative outside."""
    around = sorted(math.radians(azimuth % 360) for azimuth in azimuths)
    inside = math.inf
    for one, other in pairwise([*around, around[0] + math.tau]):
        middle, half = (one + other) / 2, (other - one) / 2
        inside = min(inside, arm * math.cos(half) - x * math.cos(middle))
    return inside

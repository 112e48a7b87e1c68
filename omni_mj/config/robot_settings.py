"""Settings of the robot: body, wheels, drivetrain, firmware, sensors and battery."""

import math
import warnings
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from pydantic import field_validator

from omni_control.kinematics import Kinematics
from omni_mj.config import CYCLE_RATE_HZ
from omni_mj.config.validation import FROM_ROBOT, Angles, SettingsModel, setting

# Depth by which the weight of 2.65 kg on 4 wheels presses rollers into the carpet, rounded up
# (contact stiffness: omni_mj.mjcf.rollers).
CONTACT_DEPTH_M = 7e-5
AZIMUTH_DIGITS = 6  # decimal places of azimuths in deg by which wheels are ordered


class ModelSettings(SettingsModel):
    """A custom robot in MJCF, MuJoCo's XML format. It defines `body`, `wheels` and the gear."""

    file: str = setting(
        "", "path of the MJCF file of a custom robot, which defines geometry and masses"
    )


class BodySettings(SettingsModel):
    """The whole robot, including wheels."""

    mass_kg: float = setting(FROM_ROBOT, "mass", "kg", low=0.5, high=20)
    com_x_m: float = setting(
        FROM_ROBOT,
        "forward position of the center of mass, from the center of the wheel contacts",
        "m",
        low=-0.1,
        high=0.1,
    )
    com_height_m: float = setting(
        FROM_ROBOT, "height of the center of mass", "m", low=0.01, high=0.15
    )
    yaw_inertia_kg_m2: float = setting(
        FROM_ROBOT,
        "moment of inertia about the vertical axis at the center of mass",
        "kg m^2",
        low=1e-4,
        high=1,
    )
    tilt_inertia_kg_m2: float = setting(
        FROM_ROBOT,
        "moment of inertia about any horizontal axis at the center of mass",
        "kg m^2",
        low=1e-4,
        high=1,
    )


class WheelSettings(SettingsModel):
    """Omnidirectional wheels: layout, dimensions and contact model."""

    model: Literal["rollers", "two-rollers"] = setting(
        "rollers",
        "simulated rollers of a wheel: all (rollers), or the two at the carpet (two-rollers, "
        "faster)",
    )
    azimuths_deg: Angles = setting(
        FROM_ROBOT,
        "directions of the wheels from the center, counter-clockwise from forward, in any order",
        "deg",
        min_length=3,
        max_length=8,
    )
    arm_m: float = setting(
        FROM_ROBOT, "distance of the wheel contacts from the center", "m", low=0.02, high=0.5
    )
    radius_m: float = setting(FROM_ROBOT, "wheel radius", "m", low=0.01, high=0.2)
    rollers: int = setting(FROM_ROBOT, "number of rollers of a wheel", low=8, high=40)
    roller_radius_m: float = setting(
        FROM_ROBOT, "largest radius of a roller", "m", low=0.002, high=0.05
    )

    @field_validator("azimuths_deg")
    @classmethod
    def _order_wheels(cls, azimuths: tuple[float, ...]) -> tuple[float, ...]:
        """Return the azimuths from forward, counter-clockwise, so that wheel 1 is front left.

        Warn of a layout whose left and right differ, but not its front and rear: teams also give
        the directions in which wheels roll, or count from the left.

        Raises:
            ValueError: The azimuths are in radians.
        """
        if max(map(abs, azimuths)) <= math.tau:
            degrees = [round(math.degrees(azimuth), 1) for azimuth in azimuths]
            raise ValueError(
                f"wheels.azimuths_deg must be in degrees, not {list(azimuths)}; "
                f"did you mean {degrees}?"
            )
        turned = [[azimuth + turn for azimuth in azimuths] for turn in (-90, 90)]
        if not _is_symmetric(azimuths) and _is_symmetric(turned[0]):
            choices = " or ".join(str([round(a % 360, 3) for a in layout]) for layout in turned)
            warnings.warn(
                f"wheels.azimuths_deg = {list(azimuths)} differ between left and right; they are "
                "the directions to the wheels, counter-clockwise from forward; did you mean "
                f"{choices}?",
                stacklevel=2,
            )
        return tuple(sorted(azimuths, key=lambda azimuth: round(azimuth, AZIMUTH_DIGITS) % 360))

    @property
    def kinematics(self) -> Kinematics:
        """Kinematics of a robot with these wheels."""
        return Kinematics(np.radians(self.azimuths_deg) % (2 * np.pi), self.arm_m, self.radius_m)

    @property
    def contact_ratio(self) -> float:
        """Length of a roller's contact along the rim over its length along the axle.

        In Hertz's theory a contact is an ellipse whose semi-axes have about the ratio of the radii
        of curvature to the power 2/3 (K. L. Johnson, Contact Mechanics, section 4.2). The radii are
        those of the wheel and of the roller.
        """
        return float((self.radius_m / self.roller_radius_m) ** (2 / 3))

    def compute_support_margin(self, x: float) -> float:
        """Return the distance of a point from the edge of the support polygon, m.

        The polygon connects the wheel contacts. The distance is negative for a point outside.

        Args:
            x: Forward position of the point on the robot's x axis, m.
        """
        angles = sorted(math.radians(azimuth % 360) for azimuth in self.azimuths_deg)
        margin = math.inf
        for start, end in pairwise([*angles, angles[0] + math.tau]):
            middle, half = (start + end) / 2, (end - start) / 2
            margin = min(margin, self.arm_m * math.cos(half) - x * math.cos(middle))
        return margin

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message if rollers do not fit into a wheel, or do not close its circumference.

        A roller of the largest radius r is a barrel. Its axle is a chord of the wheel of radius R,
        at the distance R - r from the center. Its profile is an arc of the wheel's circumference.
        """
        radius, roller_radius, count = self.radius_m, self.roller_radius_m, self.rollers
        if 2 * roller_radius >= radius:
            yield (
                f"wheels.roller_radius_m = {roller_radius:g} leaves no room for an axle in a wheel "
                f"of wheels.radius_m = {radius:g}; it must be below half of that"
            )
            return
        # At the ends of one of n rollers, at the angle pi / n from its middle, the barrel's radius
        # R cos(pi / n) - (R - r) must be positive.
        n_needed = math.pi / math.acos(1 - roller_radius / radius)
        if count <= n_needed:
            yield (
                f"wheels.rollers = {count} of wheels.roller_radius_m = {roller_radius:g} do not "
                f"close a wheel of wheels.radius_m = {radius:g}, because their ends do not meet; "
                f"take at least {math.floor(n_needed) + 1}, or thicker ones"
            )
        elif self.model == "two-rollers":
            # All others are at least the angle 2 pi / n from the lowest point of the wheel.
            clearance = radius - compute_roller_depth(radius, roller_radius, math.tau / count)
            if clearance < CONTACT_DEPTH_M:
                yield (
                    f"wheels.rollers = {count} is too many for wheels.model = two-rollers: with "
                    f"wheels.roller_radius_m = {roller_radius:g} more than two of a wheel touch "
                    "the carpet; take wheels.model = rollers"
                )


class Mechanics(NamedTuple):
    """The settings on which the MJCF model of a robot depends.

    Attributes:
        body: Mass and inertia.
        wheels: Geometry and model of the wheels.
        gear_ratio: Turns of the motor per turn of the wheel.
        rotor_inertia: Inertia of a motor's rotor, kg m^2.
        mjcf_file: Path of a custom robot's MJCF; empty for the standard robot shape.
    """

    body: BodySettings
    wheels: WheelSettings
    gear_ratio: float
    rotor_inertia: float
    mjcf_file: str


class DrivetrainSettings(SettingsModel):
    """The drivetrain between motor and carpet: gear, roller bearings and rubber."""

    gear_friction_nm: float = setting(
        FROM_ROBOT, "dry friction torque of a gear, at the wheel", "N m", low=0, high=1
    )
    efficiency: float = setting(
        1.0,
        "fraction of a motor's torque that the gear passes when driving; the rest is friction, "
        "which adds to the torque when braking",
        low=0.1,
        high=1,
    )
    roller_friction: float = setting(
        FROM_ROBOT,
        "dry friction of a roller's bearing: force at its rim over normal force",
        low=0,
        high=1,
    )
    roller_damping_nm_s: float = setting(
        FROM_ROBOT,
        "viscous friction torque of a roller's bearing per its speed",
        "N m s/rad",
        low=0,
        high=2e-5,
    )
    creep_stiffness: float = setting(
        FROM_ROBOT,
        "slope of traction over normal force against slip, as long as friction does not limit it",
        low=0.1,
        high=1e3,
    )


class FirmwareSettings(SettingsModel):
    """Control loops on the robot: a PID loop per wheel, a turn-rate loop and a heading filter.

    By default the wheel loops are proportional with feedforward, as in the firmware of TIGERs
    (k_i = 0) and RoboJackets. Gains refer to speeds of the wheel, not of the motor.
    """

    rate_hz: int = setting(
        CYCLE_RATE_HZ,
        f"rate of the wheel and turn-rate loops; must divide {CYCLE_RATE_HZ}",
        "Hz",
        low=60,
        high=CYCLE_RATE_HZ,
    )
    kp: float = setting(0.3, "proportional gain of a wheel loop", "V s/rad", low=0, high=100)
    ki: float = setting(0.0, "integral gain of a wheel loop", "V/rad", low=0, high=1000)
    kd: float = setting(0.0, "derivative gain of a wheel loop", "V s^2/rad", low=0, high=1)
    feedforward: float = setting(
        1.0,
        "feedforward gain: feedforward voltage over the back-EMF at the desired speed",
        low=0,
        high=2,
    )
    nominal_voltage_v: float = setting(
        FROM_ROBOT,
        "battery voltage by which the firmware converts voltages to duty cycles",
        "V",
        low=1,
        high=60,
    )
    turn_rate_gain: float = setting(
        1.0, "proportional gain of the turn-rate loop, which uses the gyro", low=0, high=10
    )
    heading_gain: float = setting(
        2.0,
        "heading filter: rate of heading correction per difference from vision",
        "1/s",
        low=0,
        high=30,
    )
    gyro_bias_gain: float = setting(
        0.5,
        "heading filter: rate of gyro bias correction per difference from vision",
        "1/s^2",
        low=0,
        high=100,
    )
    current_limit_a: float = setting(
        FROM_ROBOT, "current limit of a motor driver", "A", low=0.1, high=1e3
    )
    timeout_s: float = setting(
        0.0,
        "time without a command after which a robot stops (league's simulators: 0.1); 0: never",
        "s",
        low=0,
        high=60,
    )
    thermal_derating: bool = setting(
        False, "limit the current of a motor whose winding nears its maximum temperature"
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
        FROM_ROBOT,
        "encoder counts per revolution of a motor, all four edges",
        low=1,
        high=1_000_000,
    )
    gyro_noise_rad_s: float = setting(
        0.005, "standard deviation of the gyro, averaged over a frame", "rad/s", low=0, high=10
    )
    gyro_bias_rad_s: float = setting(
        0.01, "standard deviation of the gyro bias, drawn once per seed", "rad/s", low=0, high=10
    )


class BatterySettings(SettingsModel):
    """A lithium polymer battery."""

    charge: float = setting(
        0.5, "initial state of charge: 1 full (4.2 V a cell), 0.5 nominal (3.7 V)", low=0, high=1
    )
    series_cells: int = setting(FROM_ROBOT, "number of cells in series", low=1, high=6)
    capacity_ah: float = setting(FROM_ROBOT, "capacity", "Ah", low=0.01, high=100)
    resistance_ohm: float = setting(
        FROM_ROBOT, "internal resistance, including wires and connectors", "ohm", low=0, high=1
    )
    cut_off_v: float = setting(
        FROM_ROBOT,
        "cut-off voltage: below it for a second, the battery switches off",
        "V",
        low=0,
        high=60,
    )


def _is_symmetric(azimuths: Sequence[float]) -> bool:
    """Return whether azimuths in deg are symmetric about the forward direction."""
    left, right = (
        sorted(round(sign * azimuth, 3) % 360 for azimuth in azimuths) for sign in (1, -1)
    )
    return left == right


def compute_roller_depth(radius: float, roller_radius: float, angle: float) -> float:
    """Return how far a roller reaches below the wheel's axle, m.

    In MuJoCo, rollers are ellipsoids instead of barrels. The semi-axes are r across the axle and
    sqrt(R r) along it. So the curvature of their profile in the middle is that of the wheel, 1/R.

    Args:
        radius: Radius R of the wheel, m.
        roller_radius: Largest radius r of the roller, m.
        angle: Angle of the roller's center from the lowest point of the wheel, rad.
    """
    c, s = math.cos(angle), math.sin(angle)
    semi_axis = math.sqrt(radius * roller_radius)
    return (radius - roller_radius) * c + math.hypot(roller_radius * c, semi_axis * s)

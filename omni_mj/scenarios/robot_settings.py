"""Settings of the robot's body and wheels, of the carpet under them, and of what varies from robot to robot."""

from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from omni_control.kinematics import Kinematics
from omni_mj.scenarios import robot_checks
from omni_mj.scenarios.checking import Angles, Checked, Patches, setting
from omni_mj.scenarios.robots import of_robot


class ModelSettings(Checked):
    """A robot's own MJCF, which then says what `body`, `wheels` and gear would; empty: the shape that comes along.

    Names of parts, separated by spaces, are needed where neither structure nor the file's custom data says them.
    """

    file: str = setting("", "", "path of the MJCF of a robot of yours, which says its geometry and masses")
    chassis: str = setting("", "", "which body it is, if several carry wheels")
    wheels: str = setting("", "", "hinges of the wheels, in their order")
    motors: str = setting("", "", "<dcmotor>s of the wheels, in their order")
    encoders: str = setting("", "", "<jointpos> sensors of the wheels, in their order")
    gyro: str = setting("", "", "the <gyro> sensor, if there are several")
    hull: str = setting("", "", "geoms with which robots meet; otherwise those of the class hull")

    @property
    def names(self) -> dict[str, str]:
        """Names of parts by role."""
        return {role: text for role, text in self.values().items() if role != "file"}


class BodySettings(Checked):
    """The whole robot, wheels included."""

    mass_kg: float = setting(of_robot("body.mass_kg"), "kg", "mass", 0.5, 20)
    centre_x_m: float = setting(of_robot("body.centre_x_m"), "m", "centre of mass, ahead of the middle", -0.1, 0.1)
    centre_height_m: float = setting(of_robot("body.centre_height_m"), "m", "centre of mass, height", 0.01, 0.15)
    yaw_inertia_kg_m2: float = setting(
        of_robot("body.yaw_inertia_kg_m2"), "kg m^2", "about the vertical axis through the centre of mass", 1e-4, 1
    )
    tilt_inertia_kg_m2: float = setting(
        of_robot("body.tilt_inertia_kg_m2"), "kg m^2", "about any horizontal axis through it", 1e-4, 1
    )


class WheelSettings(Checked):
    """The wheels: where they are, what they are made of, and how they are computed."""

    model: Literal["rollers", "two-rollers"] = setting(
        "rollers", "", "rollers: all of each wheel; two-rollers: those at the carpet, faster"
    )
    creep: Literal["on", "off"] = setting(
        "on", "", "on: rubber creeps under traction, as measured; off: wheels that do not, for comparison"
    )
    azimuths_deg: Angles = setting(
        of_robot("wheels.azimuths_deg"),
        "deg",
        "where they are, counter-clockwise from ahead",
        3,
        8,
        several=True,
    )
    arm_m: float = setting(of_robot("wheels.arm_m"), "m", "from the robot's centre to where they touch", 0.02, 0.5)
    radius_m: float = setting(of_robot("wheels.radius_m"), "m", "radius", 0.01, 0.2)
    rollers: int = setting(of_robot("wheels.rollers"), "", "rollers of a wheel", 8, 40)
    roller_radius_m: float = setting(of_robot("wheels.roller_radius_m"), "m", "radius of a roller", 0.002, 0.05)

    @property
    def kinematics(self) -> Kinematics:
        """Of a robot with these wheels."""
        return Kinematics(np.radians(self.azimuths_deg) % (2 * np.pi), self.arm_m, self.radius_m)

    @model_validator(mode="after")
    def _are_wheels(self) -> Self:
        if wrong := "\n".join(robot_checks.wheels(self)):
            raise ValueError(wrong)
        return self


class DriveSettings(Checked):
    """What is between motor and carpet."""

    gear_friction_nm: float = setting(
        of_robot("drive.gear_friction_nm"), "N m", "dry friction of a gear, at the wheel", 0, 1
    )
    roller_friction: float = setting(
        of_robot("drive.roller_friction"), "", "dry friction of a roller's bearing, at its rim: share of the load", 0, 1
    )
    roller_damping_nm_s: float = setting(
        of_robot("drive.roller_damping_nm_s"), "N m s/rad", "viscous friction of a roller's bearing", 0, 2e-5
    )
    creep_stiffness: float = setting(
        of_robot("drive.creep_stiffness"),
        "",
        "traction over load per slip, below friction",
        0.1,
        1e3,
    )


class CarpetSettings(Checked):
    """The carpet under the rollers."""

    friction: float = setting(0.8, "", "coefficient of friction, all wheels (the league's simulators)", 0.01, 5)
    pile: float = setting(
        of_robot("carpet.pile"), "", "rolling resistance of its pile, against any motion: share of the load", 0, 1
    )
    nap: float = setting(
        0.0, "", "how its drag changes with direction: it is pile (1 + nap cos(direction - nap_deg))", 0, 1
    )
    nap_deg: float = setting(0.0, "deg", "direction of travel straight against its fibres, in the world", -360, 360)
    patches: Patches = setting(
        (),
        "m, m, m, 1",
        "circles [x, y, radius, friction] of other friction; where several overlap, the last counts",
        0,
        50,
        several=True,
    )


class VariationSettings(Checked):
    """What sets robots of a kind apart, drawn once per seed and robot; normal numbers are cut at 3 deviations."""

    friction: float = setting(0.0, "", "standard deviation of each wheel's friction, relative", 0, 0.3)
    wear_m: float = setting(0.0, "m", "each wheel has lost up to this of its rollers' radius, uniformly", 0, 0.001)
    motor_constant: float = setting(0.0, "", "standard deviation of each motor's torque constant, relative", 0, 0.3)
    mass: float = setting(0.0, "", "standard deviation of what the wheels carry, relative (batteries, covers)", 0, 0.3)
    centre_m: float = setting(
        0.0, "m", "standard deviation of where the middle of that mass is, ahead and aside", 0, 0.01
    )

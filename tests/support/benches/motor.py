"""Motors by the rows of their datasheets, reckoned here by hand: maxon's EC 45 flat of 24 V, and those of the robots.

The 24 V winding has a sheet that is published whole, so that it is the motor of every test of the motor's law. No
robot that comes along has it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_mj.robots import builtin
from omni_mj.scenarios import robots
from omni_mj.scenarios.motor_settings import MotorSettings

RPM = 30 / np.pi  # turns per minute in a rad/s
# maxon's catalogue, EC 45 flat 50 W 24 V, as settings of `motor`; behind 60:18, with a quarter of its friction dry.
SHEET = {
    "nominal_voltage_v": 24.0,
    "no_load_rpm": 6250.0,
    "no_load_current_a": 0.238,
    "nominal_rpm": 5170.0,
    "nominal_torque_nm": 0.0911,
    "nominal_current_a": 2.52,
    "resistance_ohm": 0.942,
    "constant_nm_a": 0.036,
    "rotor_inertia_kg_m2": 1.35e-5,
    "gear": 60 / 18,
    "dry_share": 0.25,
}


@dataclass(frozen=True)
class Reckoned:
    """What the rows of a sheet say of a motor.

    Commutation, dry and viscous friction are at the motor's shaft; those `at the wheel` act there.
    """

    constant: float  # N m/A
    resistance: float  # ohm
    gear: float
    nominal_current: float  # A
    nominal_speed: float  # rad/s
    commutation: float  # ohm s/rad
    dry: float  # N m
    viscous: float  # N m s/rad

    @property
    def back_emf(self) -> float:
        """V s/rad of the wheel, which is N m/A at the wheel."""
        return self.constant * self.gear

    def friction(self, wheel_speed: Any) -> Any:
        """Torque of the motor's own friction at the wheel, N m."""
        return self.gear * (self.dry + self.viscous * self.gear * np.abs(wheel_speed))

    def series(self, wheel_speed: Any) -> Any:
        """Resistance with commutation's part, ohm."""
        return self.resistance + self.commutation * self.gear * np.abs(wheel_speed)

    def outer_loss(self, current: Any, wheel_speed: Any) -> Any:
        """Heat of a housing, W: commutation's X |w| i^2, and the power of dry and viscous friction."""
        drop = self.series(wheel_speed) - self.resistance
        return drop * np.square(current) + self.friction(wheel_speed) * np.abs(wheel_speed)


def reckoned(rows: Mapping[str, float]) -> Reckoned:
    """The nominal row, of which resistance and back-EMF leave a voltage for commutation; the no-load row's torque."""
    constant, resistance, current = rows["constant_nm_a"], rows["resistance_ohm"], rows["nominal_current_a"]
    speed = rows["nominal_rpm"] / RPM
    left = rows["nominal_voltage_v"] - resistance * current - constant * speed
    lost = constant * rows["no_load_current_a"]
    return Reckoned(
        constant=constant,
        resistance=resistance,
        gear=rows["gear"],
        nominal_current=current,
        nominal_speed=speed,
        commutation=left / (current * speed),
        dry=rows["dry_share"] * lost,
        viscous=(1 - rows["dry_share"]) * lost / (rows["no_load_rpm"] / RPM),
    )


def sheet(**changes: float) -> MotorSettings:
    """The motor of 24 V, with other values of some fields."""
    return MotorSettings(**SHEET | changes)


MAXON = reckoned(SHEET)
ROBOTS = {name: reckoned(robots.sections(name)["motor"]) for name in builtin()}
OWN = ROBOTS[robots.DEFAULT]

"""The constants of a motor behind its gear, from the rows of its datasheet."""

from dataclasses import dataclass
from typing import Self

from omni_mj.scenarios.motor_settings import MotorSettings


@dataclass(frozen=True)
class Motor:
    """A motor at 25 deg C, all at its own shaft; the wheel turns `gear` times slower.

    Voltage: V = (resistance + commutation |w|) I + constant w. Torque: constant I at the air gap, of which the shaft
    gets what dry + viscous |w| leave.

    Attributes:
        constant: torque per current, which is voltage per speed, N m/A = V s/rad.
        resistance: of the terminals, ohm.
        commutation: what commutation adds to it per speed, ohm s/rad.
        dry: friction that is the same at every speed (bearings), N m.
        viscous: friction per speed (iron, windage), N m s/rad.
        inertia: of the rotor, kg m^2.
        gear: turns of the motor in one of the wheel.
    """

    constant: float
    resistance: float
    commutation: float
    dry: float
    viscous: float
    inertia: float
    gear: float

    @classmethod
    def of(cls, sheet: MotorSettings) -> Self:
        """That of a datasheet; how its rows give the constants is told in `MotorSettings`."""
        return cls(
            constant=sheet.constant_nm_a,
            resistance=sheet.resistance_ohm,
            commutation=sheet.commutation_ohm_s,
            dry=sheet.dry_friction_nm,
            viscous=sheet.viscous_friction_nm_s,
            inertia=sheet.rotor_inertia_kg_m2,
            gear=sheet.gear,
        )

    @property
    def speed_constant(self) -> float:
        """Back-EMF per speed of the wheel, V s/rad."""
        return self.constant * self.gear

    @property
    def wheel_dry(self) -> float:
        """Dry friction at the wheel, N m."""
        return self.dry * self.gear

    @property
    def wheel_viscous(self) -> float:
        """Friction per speed at the wheel, N m s/rad."""
        return self.viscous * self.gear**2

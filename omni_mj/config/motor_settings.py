"""Settings of the motor: the rows of its datasheet, which are checked against each other."""

import math
from collections.abc import Iterator
from typing import Any

from pydantic import field_validator

from omni_mj.config.validation import FROM_ROBOT, SettingsModel, setting

RAD_S_PER_RPM = math.pi / 30
# Relative tolerance of the voltage that the no-load rows imply: rows are rounded, and motors vary.
NO_LOAD_TOLERANCE = 0.05
# Relative tolerance of the nominal torque: some datasheets give the torque of the air gap, others
# that of the shaft, with torque constants that differ by up to 8 %.
TORQUE_TOLERANCE = 0.2


class MotorSettings(SettingsModel):
    """A motor as in its datasheet, and the gear. Thermal defaults: maxon EC 45 flat 50 W.

    With the resistance R and the torque constant k of a datasheet, V = R I + k w gives a higher
    speed w at the nominal voltage and current than the datasheet. The reason is a further voltage
    drop X |w| I by commutation. The coefficient X follows from the nominal point (index N):

        V_N = R I_N + X w_N I_N + k w_N.

    On maxon's datasheet, k I_N equals the nominal torque within 0.5 %. So this torque is that of
    the air gap, and includes the motor's own friction. If it were the torque of the shaft, the
    nominal current would be 2.77 A instead of 2.52 A.

    No datasheet says which fraction of the no-load friction is dry. TIGERs' firmware assumes that
    all of it is proportional to speed. The self-test of their v2020 (Nanotec DF45, test_motor.c)
    implies that two thirds are dry at 356 rad/s, including the bearings of the wheel.
    """

    nominal_voltage_v: float = setting(
        FROM_ROBOT, "datasheet: nominal voltage, for which all rows hold", "V", low=0.1, high=1000
    )
    no_load_rpm: float = setting(FROM_ROBOT, "datasheet: no-load speed", "rpm", low=1, high=1e6)
    no_load_current_a: float = setting(
        FROM_ROBOT, "datasheet: no-load current", "A", low=0, high=1000
    )
    nominal_rpm: float = setting(FROM_ROBOT, "datasheet: nominal speed", "rpm", low=1, high=1e6)
    nominal_torque_nm: float = setting(
        FROM_ROBOT,
        "datasheet: nominal torque; only checked against the other rows",
        "N m",
        low=1e-6,
        high=1000,
    )
    nominal_current_a: float = setting(
        FROM_ROBOT, "datasheet: nominal (maximum continuous) current", "A", low=1e-3, high=1000
    )
    resistance_ohm: float = setting(
        FROM_ROBOT, "datasheet: terminal resistance at 25 deg C", "ohm", low=1e-4, high=1e3
    )
    torque_constant_nm_a: float = setting(
        FROM_ROBOT, "datasheet: torque constant at 25 deg C", "N m/A", low=1e-6, high=100
    )
    torque_factor: float = setting(
        1.0,
        "torque per current in the robot over the datasheet's; it scales the back-EMF alike",
        low=0.1,
        high=2,
    )
    rotor_inertia_kg_m2: float = setting(
        FROM_ROBOT, "datasheet: rotor inertia", "kg m^2", low=0, high=1e-3
    )
    gear_ratio: float = setting(
        FROM_ROBOT, "gear ratio: turns of the motor per turn of the wheel", low=1, high=1000
    )
    dry_friction_fraction: float = setting(
        FROM_ROBOT,
        "dry fraction of the no-load friction; the rest is viscous (eddy currents, windage)",
        low=0,
        high=1,
    )

    winding_c: float = setting(
        25.0, "initial temperature of the winding", "deg C", low=-20, high=200
    )
    housing_c: float = setting(
        25.0, "initial temperature of the housing", "deg C", low=-20, high=200
    )
    ambient_c: float = setting(25.0, "temperature of the air", "deg C", low=-20, high=60)
    max_winding_c: float = setting(
        125.0, "maximum temperature of the winding", "deg C", low=0, high=300
    )
    winding_housing_resistance_k_w: float = setting(
        8.28, "thermal resistance between winding and housing", "K/W", low=0.01, high=1e3
    )
    housing_ambient_resistance_k_w: float = setting(
        1.57, "thermal resistance between housing and air", "K/W", low=0.01, high=1e3
    )
    winding_heat_capacity_j_k: float = setting(
        3.48,
        "heat capacity of the winding: time constant 28.8 s over 8.28 K/W",
        "J/K",
        low=0.01,
        high=1e4,
    )
    housing_heat_capacity_j_k: float = setting(
        49.9,
        "heat capacity of the housing: time constant 78.3 s over 1.57 K/W",
        "J/K",
        low=0.01,
        high=1e5,
    )
    winding_resistance_per_k: float = setting(
        0.00393,
        "temperature coefficient of the winding's resistance (copper)",
        "1/K",
        low=0,
        high=0.1,
    )
    torque_constant_per_k: float = setting(
        -0.001,
        "temperature coefficient of the torque constant (NdFeB, typical)",
        "1/K",
        low=-0.01,
        high=0,
    )

    @field_validator("gear_ratio", mode="before")
    @classmethod
    def _name_inverted_gear(cls, ratio: Any) -> Any:
        """Refuse a ratio written the other way round, as turns of the wheel per turn of the motor.

        Raises:
            ValueError: The ratio is between 0 and 1.
        """
        if isinstance(ratio, int | float) and 0 < ratio < 1:
            raise ValueError(
                f"motor.gear_ratio must be turns of the motor per turn of the wheel (1 to 1000), "
                f"not {ratio!r}; did you mean {1 / ratio:.3g}?"
            )
        return ratio

    @property
    def commutation_ohm_s(self) -> float:
        """Coefficient X of the voltage drop by commutation, ohm s/rad."""
        commutation_voltage = self.nominal_voltage_v - self._linear_voltage_v
        return commutation_voltage / (self.nominal_rpm * RAD_S_PER_RPM * self.nominal_current_a)

    @property
    def _linear_voltage_v(self) -> float:
        """Voltage R I_N + k w_N of resistance and back-EMF at the nominal point, V."""
        speed = self.nominal_rpm * RAD_S_PER_RPM
        return self.resistance_ohm * self.nominal_current_a + self.torque_constant_nm_a * speed

    @property
    def _no_load_friction_nm(self) -> float:
        """Friction torque of the motor at the no-load speed, N m."""
        return self.torque_constant_nm_a * self.no_load_current_a

    @property
    def effective_constant_nm_a(self) -> float:
        """Torque per current in the robot at 25 deg C, N m/A, and back-EMF per speed, V s/rad."""
        return self.torque_factor * self.torque_constant_nm_a

    @property
    def wheel_back_emf_v_s(self) -> float:
        """Back-EMF per wheel speed, V s/rad, and torque at the wheel per current, N m/A."""
        return self.effective_constant_nm_a * self.gear_ratio

    @property
    def wheel_dry_friction_nm(self) -> float:
        """Dry part of the friction torque, at the wheel, N m."""
        return self.dry_friction_fraction * self._no_load_friction_nm * self.gear_ratio

    @property
    def wheel_viscous_friction_nm_s(self) -> float:
        """Viscous part of the friction torque per wheel speed, at the wheel, N m s/rad."""
        viscous_friction = (1 - self.dry_friction_fraction) * self._no_load_friction_nm
        return viscous_friction / (self.no_load_rpm * RAD_S_PER_RPM) * self.gear_ratio**2

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message for each row that contradicts the others."""
        advice = "; take all rows from one datasheet"
        nominal_voltage = f"motor.nominal_voltage_v = {self.nominal_voltage_v:g}"
        if self.commutation_ohm_s < 0:
            yield (
                "motor.nominal_rpm and motor.nominal_current_a need "
                f"{self._linear_voltage_v:.4g} V with motor.torque_constant_nm_a and "
                f"motor.resistance_ohm, above {nominal_voltage}{advice}"
            )
        speed = self.no_load_rpm * RAD_S_PER_RPM
        resistance = self.resistance_ohm + self.commutation_ohm_s * speed
        voltage = resistance * self.no_load_current_a + self.torque_constant_nm_a * speed
        if abs(voltage / self.nominal_voltage_v - 1) > NO_LOAD_TOLERANCE:
            yield (
                f"motor.no_load_rpm and motor.no_load_current_a need {voltage:.4g} V with "
                f"motor.torque_constant_nm_a, not {nominal_voltage} within "
                f"{NO_LOAD_TOLERANCE:.0%}{advice}"
            )
        torque = self.torque_constant_nm_a * self.nominal_current_a
        if abs(self.nominal_torque_nm / torque - 1) > TORQUE_TOLERANCE:
            yield (
                f"motor.nominal_torque_nm = {self.nominal_torque_nm:g} is not "
                f"motor.torque_constant_nm_a times motor.nominal_current_a, {torque:.4g}, within "
                f"{TORQUE_TOLERANCE:.0%}{advice}"
            )

"""Settings of the motor: the rows of its datasheet, which must agree with each other."""

import math
from collections.abc import Iterator

from omni_mj.config.validation import SettingsModel, setting

RAD_S_PER_RPM = math.pi / 30
# Largest relative difference from the nominal voltage: samples and rounding of rows differ.
NO_LOAD_TOLERANCE = 0.05
# Datasheets print the torque of the air gap or of the shaft, and their constants differ by 8 %.
TORQUE_TOLERANCE = 0.2


class MotorSettings(SettingsModel):
    """A motor as in its datasheet, and the gear. Thermal defaults: maxon EC 45 flat 50 W.

    Values without a row are derived. The line given by resistance and torque constant does not meet
    the nominal point of the datasheet. Commutation causes a voltage drop X |w| I that grows with
    current and speed, so that at the nominal point

        V_N = R I_N + X w_N I_N + k w_N.

    On maxon's datasheet, k I_N equals the nominal torque within 0.5 %. So this torque is that of
    the air gap and includes the motor's own friction. If it were the torque of the shaft, friction
    would count twice, and the current would be 2.77 A instead of 2.52 A.

    No datasheet says how much of the no-load friction is dry. TIGERs' firmware assumes that all of
    it is proportional to speed. The self-test of their v2020 (Nanotec DF45, test_motor.c) implies
    that two thirds are dry at 356 rad/s, including the bearings of the wheel.
    """

    nominal_voltage_v: float = setting(
        ..., "V", "datasheet: nominal voltage, for which all rows hold", 0.1, 1000
    )
    no_load_rpm: float = setting(..., "rpm", "datasheet: no-load speed", 1, 1e6)
    no_load_current_a: float = setting(..., "A", "datasheet: no-load current", 0, 1000)
    nominal_rpm: float = setting(..., "rpm", "datasheet: nominal speed", 1, 1e6)
    nominal_torque_nm: float = setting(
        ..., "N m", "datasheet: nominal torque; only checked against the other rows", 1e-6, 1000
    )
    nominal_current_a: float = setting(
        ..., "A", "datasheet: nominal (maximum continuous) current", 1e-3, 1000
    )
    resistance_ohm: float = setting(
        ..., "ohm", "datasheet: terminal resistance at 25 deg C", 1e-4, 1e3
    )
    torque_constant_nm_a: float = setting(
        ..., "N m/A", "datasheet: torque constant at 25 deg C", 1e-6, 100
    )
    rotor_inertia_kg_m2: float = setting(..., "kg m^2", "datasheet: rotor inertia", 0, 1)
    gear_ratio: float = setting(
        ..., "", "gear ratio: turns of the motor per turn of the wheel", 0.01, 1000
    )
    dry_friction_fraction: float = setting(
        ..., "", "dry fraction of the no-load friction; the rest is viscous (iron, windage)", 0, 1
    )

    winding_c: float = setting(25.0, "deg C", "initial temperature of the windings", -20, 200)
    housing_c: float = setting(25.0, "deg C", "initial temperature of the housings", -20, 200)
    ambient_c: float = setting(25.0, "deg C", "temperature of the air", -20, 60)
    max_winding_c: float = setting(125.0, "deg C", "maximum temperature of the windings", 0, 300)
    winding_housing_k_w: float = setting(
        8.28, "K/W", "thermal resistance between winding and housing", 0.01, 1e3
    )
    housing_ambient_k_w: float = setting(
        1.57, "K/W", "thermal resistance between housing and air", 0.01, 1e3
    )
    winding_j_k: float = setting(
        3.48, "J/K", "heat capacity of the winding: 28.8 s / 8.28 K/W", 0.01, 1e4
    )
    housing_j_k: float = setting(
        49.9, "J/K", "heat capacity of the housing: 78.3 s / 1.57 K/W", 0.01, 1e5
    )
    winding_resistance_per_k: float = setting(
        0.00393, "1/K", "temperature coefficient of the winding's resistance (copper)", 0, 0.1
    )
    torque_constant_per_k: float = setting(
        -0.001, "1/K", "temperature coefficient of the torque constant (NdFeB, typical)", -0.01, 0
    )

    @property
    def commutation_ohm_s(self) -> float:
        """Commutation resistance per motor speed X, which fits the nominal row, ohm s/rad."""
        commutation_voltage = self.nominal_voltage_v - self._linear_voltage_v
        return commutation_voltage / (self.nominal_rpm * RAD_S_PER_RPM * self.nominal_current_a)

    @property
    def _linear_voltage_v(self) -> float:
        """Voltage of resistance and back-EMF at the nominal point, V."""
        speed = self.nominal_rpm * RAD_S_PER_RPM
        return self.resistance_ohm * self.nominal_current_a + self.torque_constant_nm_a * speed

    @property
    def no_load_friction_nm(self) -> float:
        """Friction torque of the motor at the no-load speed, N m."""
        return self.torque_constant_nm_a * self.no_load_current_a

    @property
    def dry_friction_nm(self) -> float:
        """Dry part of the friction torque, N m."""
        return self.dry_friction_fraction * self.no_load_friction_nm

    @property
    def viscous_friction_nm_s(self) -> float:
        """Viscous part of the friction torque per motor speed, N m s/rad."""
        no_load_speed = self.no_load_rpm * RAD_S_PER_RPM
        return (1 - self.dry_friction_fraction) * self.no_load_friction_nm / no_load_speed

    @property
    def wheel_back_emf_v_s(self) -> float:
        """Back-EMF per speed of the wheel, V s/rad."""
        return self.torque_constant_nm_a * self.gear_ratio

    @property
    def wheel_dry_friction_nm(self) -> float:
        """Dry part of the friction torque at the wheel, N m."""
        return self.dry_friction_nm * self.gear_ratio

    @property
    def wheel_viscous_friction_nm_s(self) -> float:
        """Viscous part of the friction torque per wheel speed, at the wheel, N m s/rad."""
        return self.viscous_friction_nm_s * self.gear_ratio**2

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message for each row that contradicts the others."""
        voltage, commutation = self.nominal_voltage_v, self.commutation_ohm_s
        advice = "; take all rows from one datasheet"
        if commutation < 0:
            yield (
                "motor.nominal_rpm with motor.nominal_current_a takes "
                f"{self._linear_voltage_v:.4g} V by "
                "motor.torque_constant_nm_a and motor.resistance_ohm alone, above "
                f"motor.nominal_voltage_v = {voltage:g}{advice}"
            )
        speed, current = self.no_load_rpm * RAD_S_PER_RPM, self.no_load_current_a
        resistance = self.resistance_ohm + max(commutation, 0) * speed
        needed_voltage = resistance * current + self.torque_constant_nm_a * speed
        if abs(needed_voltage / voltage - 1) > NO_LOAD_TOLERANCE:
            yield (
                f"motor.no_load_rpm with motor.no_load_current_a takes {needed_voltage:.4g} V by "
                f"motor.torque_constant_nm_a, not motor.nominal_voltage_v = {voltage:g} within "
                f"{NO_LOAD_TOLERANCE:.0%}{advice}"
            )
        torque = self.torque_constant_nm_a * self.nominal_current_a
        if abs(self.nominal_torque_nm / torque - 1) > TORQUE_TOLERANCE:
            yield (
                f"motor.nominal_torque_nm = {self.nominal_torque_nm:g} is not "
                f"motor.torque_constant_nm_a times motor.nominal_current_a, {torque:.4g}, within "
                f"{TORQUE_TOLERANCE:.0%}{advice}"
            )

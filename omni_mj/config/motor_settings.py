"""The motor by the rows of its datasheet, which must agree with each other."""

import math
from collections.abc import Iterator

from omni_mj.config.validation import SettingsModel, setting

RAD_S = math.pi / 30  # in a turn per minute
NO_LOAD_TOLERANCE = 0.05  # of the nominal voltage; samples differ, and the rows' digits
# Sheets print the torque of the air gap or of the shaft, and their constants differ by some 8 %
TORQUE_TOLERANCE = 0.2


class MotorSettings(SettingsModel):
    """A motor and its gear, as the datasheet prints them; thermal rows are those of the maxon EC 45 flat 50 W.

    What no row says is derived. The line of resistance and torque constant misses the nominal row:
    commutation costs a voltage X |w| I that grows with current and speed, and at the nominal point,
    where the current is the sheet's,

        V_N = R I_N + X w_N I_N + k w_N.

    On maxon's page k I_N is the nominal torque within 0.5 %, so that this torque is the air gap's,
    with the motor's own friction inside: taken as the shaft's, friction would count twice, and the
    current be 2.77 A instead of 2.52.

    How much of the no-load friction is dry no sheet says. TIGERs' firmware takes all of it as
    proportional to speed; the self-test of their v2020 (Nanotec DF45, test_motor.c) implies two
    thirds dry at 356 rad/s, the wheel's bearings with it.
    """

    nominal_voltage_v: float = setting(
        ..., "V", "datasheet: nominal voltage, at which its rows hold", 0.1, 1000
    )
    no_load_rpm: float = setting(..., "rpm", "datasheet: no-load speed", 1, 1e6)
    no_load_current_a: float = setting(..., "A", "datasheet: no-load current", 0, 1000)
    nominal_rpm: float = setting(..., "rpm", "datasheet: nominal speed", 1, 1e6)
    nominal_torque_nm: float = setting(
        ..., "N m", "datasheet: nominal torque; others are checked by it", 1e-6, 1000
    )
    nominal_current_a: float = setting(
        ..., "A", "datasheet: nominal current, borne for ever", 1e-3, 1000
    )
    resistance_ohm: float = setting(
        ..., "ohm", "datasheet: terminal resistance at 25 deg C", 1e-4, 1e3
    )
    torque_constant_nm_a: float = setting(
        ..., "N m/A", "datasheet: torque constant at 25 deg C", 1e-6, 100
    )
    rotor_inertia_kg_m2: float = setting(..., "kg m^2", "datasheet: inertia of the rotor", 0, 1)
    gear_ratio: float = setting(..., "", "turns of the motor in one of the wheel", 0.01, 1000)
    dry_friction_fraction: float = setting(
        ...,
        "",
        "share of the no-load friction that is dry; the rest grows with speed (iron, windage)",
        0,
        1,
    )

    winding_c: float = setting(25.0, "deg C", "temperature of the windings at the start", -20, 200)
    housing_c: float = setting(25.0, "deg C", "temperature of the housings at the start", -20, 200)
    ambient_c: float = setting(25.0, "deg C", "temperature of the air", -20, 60)
    max_winding_c: float = setting(
        125.0, "deg C", "highest permissible temperature of the windings", 0, 300
    )
    winding_housing_k_w: float = setting(
        8.28, "K/W", "thermal resistance from winding to housing", 0.01, 1e3
    )
    housing_ambient_k_w: float = setting(
        1.57, "K/W", "thermal resistance from housing to air", 0.01, 1e3
    )
    winding_j_k: float = setting(
        3.48, "J/K", "heat capacity of the winding: 28.8 s / 8.28 K/W", 0.01, 1e4
    )
    housing_j_k: float = setting(
        49.9, "J/K", "heat capacity of the housing: 78.3 s / 1.57 K/W", 0.01, 1e5
    )
    winding_resistance_per_k: float = setting(
        0.00393, "1/K", "rise of the winding's resistance (copper)", 0, 0.1
    )
    torque_constant_per_k: float = setting(
        -0.001, "1/K", "change of the torque constant (NdFeB, typical)", -0.01, 0
    )

    @property
    def commutation_ohm_s(self) -> float:
        """Commutation's resistance per motor speed, ohm s/rad, by which the nominal row's current is the sheet's."""
        speed, current = self.nominal_rpm * RAD_S, self.nominal_current_a
        on_the_line = self.resistance_ohm * current + self.torque_constant_nm_a * speed
        return (self.nominal_voltage_v - on_the_line) / (speed * current)

    @property
    def no_load_friction_nm(self) -> float:
        """Torque of the motor's own friction at the no-load speed, N m."""
        return self.torque_constant_nm_a * self.no_load_current_a

    @property
    def dry_friction_nm(self) -> float:
        """The part of it that is the same at every speed, N m."""
        return self.dry_friction_fraction * self.no_load_friction_nm

    @property
    def viscous_friction_nm_s(self) -> float:
        """The part of it that is proportional to speed, N m s/rad."""
        return (
            (1 - self.dry_friction_fraction) * self.no_load_friction_nm / (self.no_load_rpm * RAD_S)
        )

    def find_contradictions(self) -> Iterator[str]:
        """Yield what a motor cannot be, a line each."""
        volts, commutation = self.nominal_voltage_v, self.commutation_ohm_s
        sheet = "; take all rows from one page"
        if commutation < 0:
            needed = volts - commutation * self.nominal_rpm * RAD_S * self.nominal_current_a
            yield (
                f"motor.nominal_rpm with motor.nominal_current_a takes {needed:.4g} V by motor.torque_constant_nm_a and "
                f"motor.resistance_ohm alone, above motor.nominal_voltage_v = {volts:g}{sheet}"
            )
        speed, current = self.no_load_rpm * RAD_S, self.no_load_current_a
        needed = (
            self.resistance_ohm + max(commutation, 0) * speed
        ) * current + self.torque_constant_nm_a * speed
        if abs(needed / volts - 1) > NO_LOAD_TOLERANCE:
            yield (
                f"motor.no_load_rpm with motor.no_load_current_a takes {needed:.4g} V by motor.torque_constant_nm_a, not "
                f"motor.nominal_voltage_v = {volts:g} within {NO_LOAD_TOLERANCE:.0%}{sheet}"
            )
        torque = self.torque_constant_nm_a * self.nominal_current_a
        if abs(self.nominal_torque_nm / torque - 1) > TORQUE_TOLERANCE:
            yield (
                f"motor.nominal_torque_nm = {self.nominal_torque_nm:g} is not motor.torque_constant_nm_a times "
                f"motor.nominal_current_a, {torque:.4g}, within {TORQUE_TOLERANCE:.0%}{sheet}"
            )

"""The motor's datasheet: what is derived from its rows, and rows that no motor has."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maxon import SHEET, sheet

from omni_control.errors import OmniError
from omni_mj.scenarios.motor_settings import MotorSettings
from omni_mj.scenarios.scenario import load

RPM = 30 / math.pi


@settings(deadline=None, max_examples=100, derandomize=True)
@given(
    constant=st.floats(0.01, 0.1),
    resistance=st.floats(0.1, 2.0),
    drop=st.floats(0.0, 0.1),
    losses=st.floats(0.001, 0.03),
    load=st.floats(0.05, 0.15),
    share=st.floats(0, 1),
)
def test_the_rows_of_a_motor_give_its_constants_back(
    constant: float, resistance: float, drop: float, losses: float, load: float, share: float
) -> None:
    """A sheet is printed from a motor that is known: its rows at 24 V, by Kirchhoff's law, the no-load row too."""
    volts, stall = 24.0, 24.0 / resistance
    nominal, no_load = load * stall, losses * load * stall
    speed = (volts * (1 - drop) - resistance * nominal) / constant
    commutation = volts * drop / (speed * nominal)
    free = (volts - resistance * no_load) / (constant + commutation * no_load)
    sheet = MotorSettings(
        nominal_voltage_v=volts,
        no_load_rpm=free * RPM,
        no_load_current_a=no_load,
        nominal_rpm=speed * RPM,
        nominal_torque_nm=constant * nominal,
        nominal_current_a=nominal * (1 - 1e-12),  # rounding must not make commutation negative where there is none
        resistance_ohm=resistance,
        constant_nm_a=constant,
        dry_share=share,
    )
    # Rounding: what is left of 24 V for commutation has 14 digits.
    assert sheet.commutation_ohm_s == pytest.approx(commutation, rel=1e-6, abs=1e-11 * volts / (speed * nominal))
    friction = constant * no_load
    assert sheet.no_load_friction_nm == pytest.approx(friction)
    assert sheet.dry_friction_nm == pytest.approx(share * friction)
    assert sheet.dry_friction_nm + sheet.viscous_friction_nm_s * free == pytest.approx(friction)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ({"resistance_ohm": 2.5}, r"motor.nominal_rpm with motor.nominal_current_a takes 25.79 V .* 24; take"),
        ({"no_load_rpm": 5500.0}, r"motor.no_load_rpm with motor.no_load_current_a takes 21.* V"),
        ({"nominal_torque_nm": 0.15}, r"motor.nominal_torque_nm = 0.15 is not .* 0.09072, within 20%"),
        (
            {"nominal_current_a": 0.2, "nominal_torque_nm": 0.0072, "nominal_rpm": 6300.0},
            "motor.nominal_current_a = 0.2 must be above motor.no_load_current_a = 0.238",
        ),
    ],
)
def test_rows_that_no_motor_has_are_named(rows: dict[str, float], message: str) -> None:
    with pytest.raises(OmniError, match=message) as error:
        sheet(**rows)
    assert len(str(error.value).splitlines()) == 1
    with pytest.raises(OmniError, match=message):
        load("rect", [f"motor.{name}={value}" for name, value in (SHEET | rows).items()])


def test_all_that_is_wrong_with_a_sheet_is_said_at_once() -> None:
    with pytest.raises(OmniError) as error:
        sheet(nominal_voltage_v=12.0, nominal_torque_nm=1.0)
    assert len(str(error.value).splitlines()) == 3


def test_another_page_is_a_motor_too() -> None:
    """maxon EC 45 flat 50 W in its 18 V winding, same catalogue (part 651607): X by hand."""
    sheet = MotorSettings(
        nominal_voltage_v=18.0, no_load_rpm=5740.0, no_load_current_a=0.277, nominal_rpm=4690.0,
        nominal_torque_nm=0.112, nominal_current_a=3.68, resistance_ohm=0.447, constant_nm_a=0.0295,
    )  # fmt: skip
    # 18 V - 0.447 ohm * 3.68 A - 0.0295 V s/rad * 491.1 rad/s = 1.867 V, at 3.68 A and 491.1 rad/s.
    assert sheet.commutation_ohm_s == pytest.approx(1.033e-3, rel=2e-3)

"""Battery: energy, sag, and undervoltage protection."""

import numpy as np
import pytest
from benches.robot import Battery

from omni_mj.config.resolve import resolve_settings

PACK = resolve_settings(
    {
        "battery": {
            "series_cells": 6,
            "capacity_ah": 1.0,
            "resistance_ohm": 0.05,
            "charge": 0.5,
            "cut_off_v": 18.0,
        }
    }
)


def test_half_charge_gives_the_nominal_voltage_and_full_charge_the_highest() -> None:
    assert Battery(PACK).state.voltage[0] == pytest.approx(6 * 3.7)
    assert Battery(PACK.replace(battery={"charge": 1.0})).state.voltage[0] == pytest.approx(6 * 4.2)


def test_power_in_is_power_out_and_the_voltage_sags() -> None:
    """V_battery I_battery = sum V I, because drivers have no losses; braking motors give back."""
    battery = Battery(PACK)
    open_voltage = battery.state.voltage[0]
    volts, amperes = [10.0, -6.0, 3.0, 8.0], [4.0, -2.0, -1.0, 0.0]
    current = battery.load(volts, amperes)
    assert current * open_voltage == pytest.approx(np.dot(volts, amperes))
    assert battery.state.voltage[0] == pytest.approx(open_voltage - 0.05 * current)


def test_current_reduces_the_charge() -> None:
    battery = Battery(PACK)
    battery.discharge(6.0, 60 * 60)
    assert battery.state.charge[0] == pytest.approx(0.5 - 6.0 * 60 / 3600)


def test_after_a_deep_discharge_the_battery_is_off() -> None:
    battery = Battery(PACK.replace(battery={"charge": 0.06}))
    battery.discharge(20.0, 30)
    assert battery.state.is_on[0], "a sag of half a second does not trip the protection"
    battery.discharge(60.0, 300)
    assert not battery.state.is_on[0]
    assert battery.load([0.0] * 4, [5.0, -5.0, 1.0, 0.0]) == 0
    assert battery.state.voltage[0] == 0

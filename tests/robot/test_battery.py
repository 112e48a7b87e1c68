"""The battery: energy, sag, and the protection against deep discharge."""

import numpy as np
import pytest
from benches.robot import Battery

from omni_mj.config.settings import Settings

PACK = Settings(
    battery={
        "series_cells": 6,
        "capacity_ah": 1.0,
        "resistance_ohm": 0.05,
        "charge": 0.5,
        "cut_off_v": 18.0,
    }
)


def test_half_a_charge_is_the_nominal_voltage_and_a_full_one_the_highest() -> None:
    assert Battery(PACK).state.voltage[0] == pytest.approx(6 * 3.7)
    assert Battery(PACK.replace(battery={"charge": 1.0})).state.voltage[0] == pytest.approx(6 * 4.2)


def test_power_in_is_power_out_and_the_voltage_sags() -> None:
    """A driver passes power without loss: V_battery I_battery = sum V I; braking motors give back."""
    battery = Battery(PACK)
    before, volts, amperes = (
        battery.state.voltage[0],
        [10.0, -6.0, 3.0, 8.0],
        [4.0, -2.0, -1.0, 0.0],
    )
    drawn = battery.load(volts, amperes)
    assert drawn * before == pytest.approx(np.dot(volts, amperes))
    assert battery.state.voltage[0] == pytest.approx(before - 0.05 * drawn)


def test_what_is_drawn_leaves_the_charge() -> None:
    battery = Battery(PACK)
    battery.discharge(6.0, 60 * 60)
    assert battery.state.charge[0] == pytest.approx(0.5 - 6.0 * 60 / 3600)


def test_a_deep_discharge_ends_in_a_battery_that_gives_nothing_and_motors_that_are_shorted() -> (
    None
):
    battery = Battery(PACK.replace(battery={"charge": 0.06}))
    battery.discharge(20.0, 30)
    assert battery.state.is_on[0], "a sag of half a second is averaged away"
    battery.discharge(60.0, 300)
    assert not battery.state.is_on[0]
    assert battery.load([0.0] * 4, [5.0, -5.0, 1.0, 0.0]) == 0
    assert battery.state.voltage[0] == 0

"""The battery: voltage over charge, sag, bookkeeping of charge and energy, cut-off, and what an empty one does."""

import numpy as np
import pytest
from default_robot import ARM_M, GRAVITY, MASS_KG, RADIUS_M
from driving import FRAME_S, constant, drive, quiet
from driving import mujoco as plant_of
from hypothesis import given, settings
from hypothesis import strategies as st
from maxon import OWN
from numpy.typing import NDArray
from omni_mj.onboard.battery import Battery
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq

from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios.settings import BatterySettings, Settings

STEPS = 16
SIX_CELLS = {"cells": 6, "capacity_ah": 1.3, "resistance_ohm": 0.08, "cut_off_v": 20.4}
AT_REST = np.zeros((1, 4))

unit = st.floats(0, 1)
four_duties = st.lists(st.floats(-1, 1), min_size=4, max_size=4)
four_currents = st.lists(st.floats(-20, 20), min_size=4, max_size=4)


def battery(**values: float) -> Battery:
    """A 6S LiPo, but for what is given."""
    return Battery([BatterySettings.model_construct(**SIX_CELLS | values)])  # unchecked: of more cells, too


def open_circuit(charge: float) -> float:
    """Voltage without load at a state of charge, V."""
    one = battery(charge=charge)
    one.load(AT_REST, AT_REST)
    return float(one.voltage[0])


def test_open_circuit_voltages_of_a_6s_lipo() -> None:
    for charge, voltage in ((1.0, 25.2), (0.5, 22.2)):  # TIGERs: full and nominal; exact
        assert open_circuit(charge) == pytest.approx(voltage, rel=1e-12)
        assert battery(charge=charge).voltage[0] == pytest.approx(voltage, rel=1e-12)  # before the first load too


@settings(deadline=None, max_examples=60, derandomize=True)
@given(unit, unit)
def test_open_circuit_voltage_rises_with_charge(one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert open_circuit(low) <= open_circuit(high)
    # LiPo cells: 4.2 V at most, and an empty one at about 3 V.
    assert 6 * 2.9 <= open_circuit(low) <= 6 * 4.2


@settings(deadline=None, max_examples=60, derandomize=True)
@given(charge=unit, cells=st.integers(1, 14), resistance=st.floats(0, 1), duty=four_duties, current=four_currents)
def test_the_terminals_sag_by_resistance_times_the_current_drawn(
    charge: float, cells: int, resistance: float, duty: list[float], current: list[float]
) -> None:
    one = battery(charge=charge, cells=cells, resistance_ohm=resistance)
    rest = float(one.voltage[0])
    assert rest == pytest.approx(cells / 6 * open_circuit(charge))
    one.load(np.array([duty]) * rest, np.array([current]))
    voltage = float(one.voltage[0])
    # A driver without loss passes on power, V_b i_b = sum of (d V_b) i: what it draws, and Ohm's law on that.
    drawn = sum(d * i for d, i in zip(duty, current, strict=True))
    assert voltage == pytest.approx(rest - resistance * drawn, abs=1e-9)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(charge=unit, resistance=st.floats(1e-3, 0.1), duty=four_duties, current=four_currents)
def test_what_leaves_the_battery_is_the_power_at_the_motors_terminals(
    charge: float, resistance: float, duty: list[float], current: list[float]
) -> None:
    one = battery(charge=charge, resistance_ohm=resistance)
    rest = float(one.voltage[0])
    for _ in range(2):  # terminals of drivers that keep their duties while the battery sags
        before = one.voltage[:, None].copy()
        one.load(np.array([duty]) * before, np.array([current]))
    ampere, motors = (rest - one.voltage[0]) / resistance, (np.array(duty) * one.voltage[0]) @ current
    assert ampere * one.voltage[0] == pytest.approx(motors, abs=1e-6)


def test_it_takes_nothing_beyond_its_voltage_and_nothing_once_it_is_dead() -> None:
    # A motor at 50 V: of its 50 V * -4 A a battery of 22.2 V takes 22.2 V * -4 A; the driver burns the rest.
    one = battery(charge=0.5, resistance_ohm=0.1)
    one.load(np.array([[50.0, 0, 0, 0]]), np.array([[-4.0, 0, 0, 0]]))
    assert one.voltage[0] == pytest.approx(22.2 + 0.4, rel=1e-12)
    dead = battery(charge=0.5, cut_off_v=23.0)
    for _ in range(2):
        discharge(dead, np.zeros((120, 1)))
        charge = dead.charge[0]
    dead.load(np.full((1, 4), 5.0), np.full((1, 4), -9.0))
    dead.discharge(FRAME_S)
    assert (dead.alive[0], dead.voltage[0], dead.charge[0]) == (False, 0.0, charge)


def discharge(one: Battery, drawn: NDArray) -> NDArray:
    """States of charge (frames,) under battery currents (frames, steps)."""
    all_of_it = np.array([[1.0, 0.0, 0.0, 0.0]])
    charges = []
    for frame in drawn:
        for ampere in frame:
            one.load(all_of_it * one.voltage[:, None], np.array([[ampere, 0.0, 0.0, 0.0]]))
        one.discharge(FRAME_S)
        charges.append(float(one.charge[0]))
    return np.array(charges)


def test_charge_is_the_integral_of_the_current() -> None:
    frames = 20 * 60  # twenty seconds of driving and braking
    time = (np.arange(frames * STEPS) + 0.5) / (60 * STEPS)
    ampere = 12 * np.sin(time) ** 2 - 3 * np.sin(0.2 * time)
    charges = discharge(battery(charge=0.9, capacity_ah=1.3), ampere.reshape(frames, STEPS))
    fine = np.linspace(0, 20, 100_001)
    coulombs = cumulative_trapezoid(12 * np.sin(fine) ** 2 - 3 * np.sin(0.2 * fine), fine, initial=0)
    at_ends = np.interp((np.arange(frames) + 1) / 60, fine, coulombs)
    # Coulomb counting against an integral of the closed form; midpoints of 1/960 s err by less than 1e-6.
    np.testing.assert_allclose(charges, 0.9 - at_ends / (1.3 * 3600), rtol=0, atol=1e-6)


def test_a_battery_gives_its_capacity() -> None:
    # 1.3 Ah: 13 A for six minutes, to the last second. Each call is a second here.
    one = battery(charge=1.0, capacity_ah=1.3, cut_off_v=0.0, resistance_ohm=0.0)
    for second in range(361):
        assert (one.charge[0] > 1e-9) == (second < 360)
        one.load(np.array([[1.0, 0, 0, 0]]) * one.voltage, np.array([[13.0, 0, 0, 0]]))
        one.discharge(1.0)
    assert one.charge[0] == 0.0


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.floats(0.1, 1), st.floats(-10, -0.1))
def test_braking_charges_it_but_never_beyond_full(charge: float, ampere: float) -> None:
    one = battery(charge=charge, resistance_ohm=0.05)
    rest = one.voltage[0]
    charges = discharge(one, np.full((10, 4), ampere))
    assert one.voltage[0] > rest  # charging raises the terminals' voltage
    expected = np.minimum(1.0, charge - ampere * (np.arange(10) + 1) * FRAME_S / (1.3 * 3600))
    np.testing.assert_allclose(charges, expected, rtol=0, atol=1e-12)


def test_it_bears_a_load_that_leaves_its_limit_however_much_that_swings() -> None:
    # Of the nominal 22.2 V, 1.8 V may be lost on 0.08 ohm: 22.5 A. Within each frame it is twice that, then nothing.
    one = battery(charge=0.5, resistance_ohm=0.08, cut_off_v=20.4, capacity_ah=100.0)
    discharge(one, np.tile([2 * 0.98 * 22.5, 0.0], (600, 8)))
    assert one.alive[0]


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.floats(25, 100))
def test_it_cuts_off_once_the_mean_voltage_has_sunk_below_its_limit(ampere: float) -> None:
    one = battery(charge=0.5, resistance_ohm=0.08, cut_off_v=20.4, capacity_ah=100.0)
    # A first-order mean with a time constant of 1 s falls from 22.2 V towards the loaded voltage.
    loaded = 22.2 - 0.08 * ampere
    at = np.log((22.2 - loaded) / (20.4 - loaded))
    frames = 0
    while one.alive[0] and frames < 600:
        discharge(one, np.array([[2 * ampere, 0.0]]))
        frames += 1
    # Two frames, and 2 % for the mean of frames instead of a continuous one; at 25 A, where the mean hardly crosses,
    # the charge that was drawn adds 0.2 % of volts.
    assert frames * FRAME_S == pytest.approx(at, abs=2 * FRAME_S + 0.04 * at)
    one.load(AT_REST, AT_REST)
    assert one.voltage[0] == 0.0


def test_cut_off_stays_cut_off() -> None:
    one = battery(charge=0.5)
    discharge(one, np.full((120, 4), 100.0))
    assert not one.alive[0]
    discharge(one, np.zeros((600, 1)))  # its open circuit would be above the limit again
    one.load(np.full((1, 4), 0.5), np.full((1, 4), 3.0))
    assert not one.alive[0]
    assert one.voltage[0] == 0.0


def test_batteries_are_each_robots_own() -> None:
    six, four = SIX_CELLS | {"resistance_ohm": 0.1}, {"cells": 4, "resistance_ohm": 0.08, "cut_off_v": 0.0}
    chosen = [BatterySettings(charge=1.0, **six), BatterySettings(charge=0.5, **four)]
    two = Battery(chosen)
    duty, current = np.array([[0.5] * 4, [1.0] * 4]), np.array([[2.0] * 4, [-1.0] * 4])
    two.load(duty * two.voltage[:, None], current)
    np.testing.assert_allclose(two.voltage, [25.2 - 0.1 * 4, 4 * 3.7 + 0.08 * 4])


# --- on the robot: 4S LiPo ---


def robot_with(**values: float) -> Settings:
    """The default robot, but for its battery; gyro and turn-rate loop do not disturb."""
    return quiet(battery=values, firmware={"turn_gain": 0.0})


def turn(chosen: list[Settings], rate: float, frames: int) -> MujocoPlant:
    plant = plant_of(chosen)
    drive(plant, constant([0.0, 0.0, rate], frames, len(chosen)))
    return plant


def steady_speed(wanted: float, battery_v: float) -> float:
    """Wheel speed at which the loop's voltage, as far as the battery gives it, just bears friction and the pile's drag.

    (K g W + k_p (W - w)) V_b / V_n = K g w + (R + X g w) T(w) / (K g), with the torque T of motor, gear and pile at the
    wheel; rollers do not turn. A full battery drives it beyond what is wanted.
    """
    chosen, kp, share = Settings(), 0.3, battery_v / 14.8
    pile = chosen.carpet.pile * MASS_KG * GRAVITY / 4 * RADIUS_M

    def missing(speed: float) -> float:
        torque = OWN.friction(speed) + chosen.drive.gear_friction_nm + pile
        told = (wanted * OWN.back_emf + kp * (wanted - speed)) * share
        return told - OWN.back_emf * speed - OWN.series(speed) * torque / OWN.back_emf

    return float(brentq(missing, 0.0, 2 * wanted))


def test_a_low_battery_weakens_the_wheel_loop() -> None:
    wanted = 15.0 * ARM_M / RADIUS_M
    plant = turn([robot_with(charge=charge, cut_off_v=0.0) for charge in (1.0, 0.5, 0.05)], 15.0, 60)
    telemetry = plant.telemetry()
    # What the terminals give under this load, a few tenths of a volt below 16.8, 14.8 and 13.6 V.
    np.testing.assert_allclose(telemetry.battery, [16.8, 14.8, 13.6], atol=0.3)
    expected = [steady_speed(wanted, voltage) for voltage in telemetry.battery]
    # 1 %: the rollers' viscous bearings, the encoder's counts; without the pile's drag it would be 3 %.
    np.testing.assert_allclose(telemetry.wheel_speed.mean(1), expected, rtol=0.01)
    assert expected[0] - expected[2] > 0.03 * wanted


def test_with_the_nominal_battery_the_firmwares_volts_are_volts() -> None:
    # Without sag, 14.8 V times the duty of 14.8 V: the first step's voltage is k_p and feed-forward times the speed.
    plant = turn([robot_with(charge=0.5, resistance_ohm=0.0)], 2.0, 1)
    first = (0.3 + OWN.back_emf) * 2.0 * ARM_M / RADIUS_M
    assert plant.telemetry().voltage_peak[0] == pytest.approx(first, rel=1e-6)
    full = turn([robot_with(charge=1.0, resistance_ohm=0.0)], 2.0, 1)
    assert full.telemetry().voltage_peak[0] == pytest.approx(first * 16.8 / 14.8, rel=1e-6)


def test_an_empty_battery_stops_the_robot() -> None:
    frames = 120
    plant = plant_of([robot_with(charge=0.04)])
    positions, battery_v = [], []
    for command in constant([1.0, 0.0, 0.0], frames, 1):
        drive(plant, command[None])
        positions.append(plant.pose()[0, 0])
        battery_v.append(plant.telemetry().battery[0])
    # 13.3 V are below the cut-off, 13.6 V, from the start: what drives is cut at once, and the shorted motors brake. It
    # stands half a second later, but for what a soft contact creeps: a tenth of vision's noise.
    assert battery_v[-1] == 0.0
    assert (plant.telemetry().voltage == 0.0).all()
    dead = battery_v.index(0.0)
    assert dead + 60 < frames
    assert positions[-1] - positions[dead] < 0.3
    assert positions[-1] == pytest.approx(positions[dead + 30], abs=1.3e-4)


def test_the_battery_feeds_the_motors_without_loss_but_its_own() -> None:
    resistance, frames, speed = 0.3, 90, 12.0
    plant = turn([robot_with(charge=0.5, resistance_ohm=resistance, cut_off_v=0.0)], speed, frames)
    telemetry = plant.telemetry()
    # Steady: (V_oc - V_b) / R_b is what it gives, and times V_b the four motors' power. A second and a half of 4 W
    # takes 0.1 permille of the charge, or 0.1 mV.
    ampere = (14.8 - telemetry.battery[0]) / resistance
    motors = (telemetry.voltage * telemetry.current).sum()
    # 2 %: the encoder's counts change voltages from step to step, and the terminals' is a step newer.
    assert ampere * telemetry.battery[0] == pytest.approx(motors, rel=0.02)
    assert ampere > 0.15

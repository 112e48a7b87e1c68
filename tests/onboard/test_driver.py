"""The drivers of the motors: no current is beyond their limit, and they say when it would have been."""

import numpy as np
import pytest
from driving import FRAME_S, constant, drive, quiet
from driving import mujoco as plant_of
from hypothesis import given, settings
from hypothesis import strategies as st
from maxon import MAXON, sheet
from numpy.typing import NDArray
from omni_mj.onboard.motors import Motors

from omni_mj.link.radio import Received
from omni_mj.plants import Telemetry
from omni_mj.plants.mujoco import MujocoPlant

LIMIT_A = 9.0  # the default robot's
FULL_SPEED = 3.0  # m/s


@settings(deadline=None, max_examples=200, derandomize=True)
@given(
    voltage=st.floats(-25.2, 25.2),
    speed=st.floats(-200, 200),
    winding=st.floats(-20, 200),
    housing=st.floats(-20, 200),
    limit=st.floats(0.1, 30),
    strength=st.floats(0.5, 1.5),
)
def test_the_voltage_moves_no_farther_than_the_limit_asks(
    voltage: float, speed: float, winding: float, housing: float, limit: float, strength: float
) -> None:
    chosen = sheet(winding_c=winding, housing_c=housing)
    motors = Motors([chosen], 4, FRAME_S, limit, strength)
    terminals, current = motors.drive(np.full((1, 4), voltage), np.full((1, 4), speed))
    # Kirchhoff by hand, with copper and magnets at their temperatures: what would flow, cut at the limit either way.
    resistance = 0.942 * (1 + 0.00393 * (winding - 25)) + MAXON.commutation * MAXON.gear * abs(speed)
    back_emf = 0.036 * strength * (1 - 0.001 * (housing - 25)) * MAXON.gear * speed
    free = (voltage - back_emf) / resistance
    np.testing.assert_allclose(current, np.clip(free, -limit, limit), rtol=1e-9, atol=1e-9)
    assert np.abs(current).max() <= limit
    # The terminals' voltage is the one that drives it; where nothing is limited, it is exactly what was asked for.
    np.testing.assert_allclose(terminals, back_emf + current * resistance, rtol=1e-9, atol=1e-9)
    if abs(free) < limit:
        np.testing.assert_array_equal(terminals, voltage)
    # A chopper lowers the voltage over the winding: it lies between the back-EMF and what was asked for.
    assert min(voltage, back_emf) - 1e-9 <= terminals.min() <= terminals.max() <= max(voltage, back_emf) + 1e-9
    motors.warm(current[None], np.full((1, 1, 4), speed))
    np.testing.assert_array_equal(motors.limited, float(abs(free) > limit))


def test_motors_are_each_their_own() -> None:
    """Rows with other datasheets, limits and magnets: together as alone."""
    sheets = [sheet(), sheet(gear=1.0, resistance_ohm=0.65, dry_share=0.5, winding_c=90.0)]
    limits, strength = np.array([[9.0], [3.0]]), np.array([[1.0, 0.9, 1.1, 1.0], [1.0] * 4])
    together = Motors(sheets, 4, FRAME_S, limits, strength)
    voltage, speed = np.linspace(-20, 20, 8).reshape(2, 4), np.linspace(60, -30, 8).reshape(2, 4)
    currents = together.drive(voltage, speed)[1]
    together.warm(np.array([currents, currents / 2]), np.array([speed, speed]))
    after = together.drive(voltage, speed)
    for row in range(2):
        alone = Motors([sheets[row]], 4, FRAME_S, limits[row], strength[[row]])
        single = alone.drive(voltage[[row]], speed[[row]])[1]
        np.testing.assert_array_equal(single, currents[[row]])
        alone.warm(np.array([single, single / 2]), np.array([speed[[row]]] * 2))
        np.testing.assert_array_equal(alone.limited, together.limited[[row]])
        for whole, own in zip(after, alone.drive(voltage[[row]], speed[[row]]), strict=True):
            np.testing.assert_array_equal(own, whole[[row]])
    # A motor with weak magnets runs against less back-EMF, and gives less torque per ampere.
    assert together.constant[0, 1] < together.constant[0, 0] < together.constant[0, 2]


def test_limited_is_the_share_of_the_periods_steps() -> None:
    motors, still = Motors([sheet()], 2, FRAME_S, 10.0), np.zeros((1, 2))
    for strong, share in ((4, 0.25), (0, 0.0), (16, 1.0)):
        currents = [motors.drive(np.array([[24.0 * (k < strong), 1.0]]), still)[1] for k in range(16)]
        motors.warm(np.array(currents), np.zeros((16, 1, 2)))
        np.testing.assert_array_equal(motors.limited, [[share, 0.0]])


def reversal(plant: MujocoPlant, frames: int) -> list[Telemetry]:
    """What robots do that are at full speed when they are told the opposite."""
    n = len(plant.pose())
    drive(plant, constant([FULL_SPEED, 0.0, 0.0], 90, n))
    told = []
    for _ in range(frames):
        plant.advance(Received.at_once(np.tile([-FULL_SPEED, 0.0, 0.0], (n, 1)), plant.pose()[:, 2]))
        told.append(plant.telemetry())
    return told


def peak(told: list[Telemetry]) -> NDArray:
    """Largest current of each robot, A."""
    largest: NDArray = np.max([each.current_peak for each in told], axis=0)
    return largest


def test_a_reversal_at_full_speed_hot_cold_and_on_any_battery() -> None:
    # Wheels that keep turning while the voltage reverses: on slippery carpet, unlimited, that is above 20 A.
    slippery = {"carpet": {"friction": 0.5}}
    hot = {"winding_c": 125.0, "housing_c": 90.0}
    chosen = [
        quiet(**slippery),
        quiet(**slippery, motor=hot),
        quiet(**slippery, battery={"charge": 1.0}),
        quiet(**slippery, battery={"charge": 0.05, "cut_off_v": 0.0}),
        quiet(**slippery, firmware={"current_limit_a": 4.0}),
        quiet(**slippery, firmware={"current_limit_a": 1000.0}),
    ]
    plant = plant_of(chosen)
    told = reversal(plant, 30)
    limits = np.array([LIMIT_A] * 4 + [4.0, 1000.0])
    assert (peak(told) <= limits + 1e-9).all()
    assert peak(told)[5] > 20
    limited = np.array([each.current_limited for each in told])
    assert ((limited >= 0) & (limited <= 1)).all()
    assert limited[:, :5].any((0, 2)).all(), "each meets its limit, and says so"
    assert not limited[:, 5].any()
    assert peak(told)[:5] == pytest.approx(limits[:5], abs=1e-9), "which is used to the full"
    assert all((each.duty_peak <= 1).all() for each in told)


def test_a_dead_battery_brakes_with_no_more_than_the_limit() -> None:
    plant = plant_of([quiet(battery={"charge": 0.5}, firmware={"current_limit_a": 2.0})])
    drive(plant, constant([2.0, 0.0, 0.0], 60, 1))
    plant._battery.alive[:], plant._battery._average[:] = False, 0.0  # it gives up at speed
    told = []
    for _ in range(30):
        plant.advance(Received.at_once(np.array([[2.0, 0.0, 0.0]]), plant.pose()[:, 2]))
        told.append(plant.telemetry())
    assert peak(told[2:])[0] == pytest.approx(2.0, abs=1e-9)
    charge = plant._battery.charge[0]
    drive(plant, constant([2.0, 0.0, 0.0], 30, 1))
    assert plant._battery.charge[0] == charge
    assert abs(plant.twist()[0, 0]) < 0.01


def test_the_battery_gives_the_power_at_the_terminals_while_the_driver_limits() -> None:
    """Charge bookkeeping over a reversal: its electrical energy, at the battery's open circuit less its own loss."""
    resistance, capacity = 0.1, 1.3
    battery = {"resistance_ohm": resistance, "capacity_ah": capacity, "cut_off_v": 0.0}
    plant = plant_of([quiet(battery=battery, carpet={"friction": 0.5})])
    drive(plant, constant([FULL_SPEED, 0.0, 0.0], 90, 1))
    energy, heat, limited = 0.0, 0.0, 0.0
    start = plant._battery.charge[0]
    for _ in range(30):
        before = plant._battery.charge[0]
        plant.advance(Received.at_once(np.array([[-FULL_SPEED, 0.0, 0.0]]), plant.pose()[:, 2]))
        power = (plant._voltages * plant.currents).sum((1, 2))
        drawn = power / plant._supplies[:, 0, 0]  # each step's current is the motors' power over that step's voltage
        given = (before - plant._battery.charge[0]) * capacity * 3600
        assert given == pytest.approx(drawn.mean() * FRAME_S, abs=1e-9)
        energy, heat = energy + power.mean() * FRAME_S, heat + resistance * (drawn**2).mean() * FRAME_S
        limited += plant.telemetry().current_limited.max()
    assert limited > 0.5
    assert heat > 0.01 * energy
    # All that leaves the cells, at 14.8 V less the few mV of this half second, is the motors' and the battery's heat.
    # 0.5 %: the terminals sag a step after the current.
    assert (start - plant._battery.charge[0]) * capacity * 3600 * 14.8 == pytest.approx(energy + heat, rel=5e-3)

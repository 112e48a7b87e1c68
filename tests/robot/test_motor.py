"""Motors by their datasheets, and their temperatures by the exact solution of the two nodes."""

import numpy as np
import pytest
from benches.robot import (
    FRAME_S,
    MAXON,
    ROBOT_MOTORS,
    RPM,
    SHEET,
    drive_motor,
    heat_motor,
    motor_settings,
)
from scipy.integrate import solve_ivp

import omni_mj as om
from omni_mj.config.resolve import resolve_settings

BENCH = resolve_settings({"motor": SHEET, "firmware": {"current_limit_a": 1e3}})


def test_the_motor_reproduces_the_rows_of_its_data_sheet() -> None:
    """Nominal current and torque at the nominal speed; friction torque at the no-load speed."""
    gear, volts = SHEET["gear_ratio"], SHEET["nominal_voltage_v"]
    speeds = np.array([SHEET["nominal_rpm"], SHEET["no_load_rpm"]]) / RPM / gear
    _, (nominal, free) = drive_motor(BENCH, volts, speeds)
    assert nominal == pytest.approx(SHEET["nominal_current_a"], rel=1e-9)
    assert nominal * MAXON.constant == pytest.approx(SHEET["nominal_torque_nm"], rel=0.01)
    assert free == pytest.approx(SHEET["no_load_current_a"], abs=0.05 * SHEET["nominal_current_a"])


@pytest.mark.parametrize("name", ROBOT_MOTORS)
def test_motors_of_all_robots_follow_ohms_law_with_back_emf_and_commutation(name: str) -> None:
    """V = (R + X |w|) I + K w, at any speed and in both directions."""
    robot, speeds = ROBOT_MOTORS[name], np.linspace(-80, 80, 9)
    settings = om.load_scenario("rect", robot=name).settings
    volts, amperes = drive_motor(settings.replace(firmware={"current_limit_a": 1e3}), 8.0, speeds)
    np.testing.assert_allclose(
        robot.series_resistance(speeds) * amperes + robot.back_emf * speeds, volts, rtol=1e-9
    )


@pytest.mark.parametrize("speed", [-60.0, 0.0, 60.0])
@pytest.mark.parametrize("voltage", [-24.0, 24.0])
def test_the_driver_holds_the_current_to_its_limit(voltage: float, speed: float) -> None:
    limit = 3.0
    chosen = resolve_settings({"motor": SHEET, "firmware": {"current_limit_a": limit}})
    volts, amperes = drive_motor(chosen, voltage, speed)
    free = (voltage - MAXON.back_emf * speed) / MAXON.series_resistance(speed)
    assert amperes[0] == pytest.approx(np.clip(free, -limit, limit))
    assert volts[0] == pytest.approx(
        MAXON.series_resistance(speed) * amperes[0] + MAXON.back_emf * speed
    )


def test_resistance_rises_with_temperature() -> None:
    _, (cold,) = drive_motor(BENCH, 5.0, 0.0)
    _, (warm,) = drive_motor(BENCH, 5.0, 0.0, winding=125.0)
    assert cold / warm == pytest.approx(1 + 0.00393 * 100)


@pytest.mark.parametrize(("current", "speed"), [(2.5, 0.0), (4.0, 60.0), (0.5, 120.0)])
def test_temperatures_solve_the_differential_equation_of_two_nodes(
    current: float, speed: float
) -> None:
    """C_w T_w' = R(T_w) I^2 - q, C_h T_h' = P + q - (T_h - T_a) / R_ha, q = (T_w - T_h) / R_wh.

    P does not include losses of the gear.
    """
    s, frames = motor_settings(winding_c=40.0, housing_c=30.0), 3600

    def rates(_: float, t: np.ndarray) -> list[float]:
        heat_flow = (t[0] - t[1]) / s.winding_housing_resistance_k_w
        copper = MAXON.resistance * (1 + s.winding_resistance_per_k * (t[0] - 25)) * current**2
        lost_heat = (t[1] - s.ambient_c) / s.housing_ambient_resistance_k_w
        housing = MAXON.housing_heat(current, speed) - lost_heat
        return [
            (copper - heat_flow) / s.winding_heat_capacity_j_k,
            (heat_flow + housing) / s.housing_heat_capacity_j_k,
        ]

    exact = solve_ivp(rates, (0, frames * FRAME_S), [40.0, 30.0], rtol=1e-10, atol=1e-9).y[:, -1]
    winding, housing = heat_motor(
        resolve_settings({"motor": s, "drivetrain": {"efficiency": 0.6}}),
        np.full(frames, current),
        np.full(frames, speed),
    )
    np.testing.assert_allclose([winding[-1], housing[-1]], exact, atol=2e-3)

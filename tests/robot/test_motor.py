"""Motors by their data sheet, and their heat by the exact solution of its differential equation."""

import numpy as np
import pytest
from benches.robot import FRAME_S, MAXON, ROBOTS, RPM, SHEET, drive_motor, heat_motor, sheet
from scipy.integrate import solve_ivp

import omni_mj as om
from omni_mj.config.settings import Settings

BENCH = Settings(motor=SHEET, firmware={"current_limit_a": 1e3})


def test_the_rows_of_the_sheet_come_out() -> None:
    """At the nominal speed the nominal current and torque; at the no-load speed a torque that friction takes."""
    gear, volts = SHEET["gear_ratio"], SHEET["nominal_voltage_v"]
    speeds = np.array([SHEET["nominal_rpm"], SHEET["no_load_rpm"]]) / RPM / gear
    _, (nominal, free) = drive_motor(BENCH, volts, speeds)
    assert nominal == pytest.approx(SHEET["nominal_current_a"], rel=1e-9)
    assert nominal * MAXON.constant == pytest.approx(SHEET["nominal_torque_nm"], rel=0.01)
    assert free == pytest.approx(SHEET["no_load_current_a"], abs=0.05 * SHEET["nominal_current_a"])


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robots_motor_obeys_ohms_law_with_back_emf_and_commutation(name: str) -> None:
    """V = (R + X |w|) I + K w, at any speed and in both directions."""
    robot, speeds = ROBOTS[name], np.linspace(-80, 80, 9)
    settings = om.load_scenario("rect", robot=name).settings
    volts, amperes = drive_motor(settings.replace(firmware={"current_limit_a": 1e3}), 8.0, speeds)
    np.testing.assert_allclose(
        robot.series(speeds) * amperes + robot.back_emf * speeds, volts, rtol=1e-9
    )


@pytest.mark.parametrize("speed", [-60.0, 0.0, 60.0])
@pytest.mark.parametrize("voltage", [-24.0, 24.0])
def test_the_driver_holds_the_current_to_its_limit(voltage: float, speed: float) -> None:
    limit = 3.0
    chosen = Settings(motor=SHEET, firmware={"current_limit_a": limit})
    volts, amperes = drive_motor(chosen, voltage, speed)
    free = (voltage - MAXON.back_emf * speed) / MAXON.series(speed)
    assert amperes[0] == pytest.approx(np.clip(free, -limit, limit))
    assert volts[0] == pytest.approx(MAXON.series(speed) * amperes[0] + MAXON.back_emf * speed)


def test_copper_resists_more_when_it_is_warm() -> None:
    _, (cold,) = drive_motor(BENCH, 5.0, 0.0)
    _, (warm,) = drive_motor(BENCH, 5.0, 0.0, winding=125.0)
    assert cold / warm == pytest.approx(1 + 0.00393 * 100)


@pytest.mark.parametrize(("current", "speed"), [(2.5, 0.0), (4.0, 60.0), (0.5, 120.0)])
def test_temperatures_are_those_of_the_two_nodes_differential_equation(
    current: float, speed: float
) -> None:
    """C_w T_w' = R(T_w) I^2 - (T_w - T_h) / R_wh; C_h T_h' = losses + (T_w - T_h) / R_wh - (T_h - T_a) / R_ha."""
    s, frames = sheet(winding_c=40.0, housing_c=30.0), 3600

    def rates(_: float, t: np.ndarray) -> list[float]:
        inner = (t[0] - t[1]) / s.winding_housing_k_w
        copper = MAXON.resistance * (1 + s.winding_resistance_per_k * (t[0] - 25)) * current**2
        outer = MAXON.outer_loss(current, speed) - (t[1] - s.ambient_c) / s.housing_ambient_k_w
        return [(copper - inner) / s.winding_j_k, (inner + outer) / s.housing_j_k]

    exact = solve_ivp(rates, (0, frames * FRAME_S), [40.0, 30.0], rtol=1e-10, atol=1e-9).y[:, -1]
    winding, housing = heat_motor(
        Settings(motor=s), np.full(frames, current), np.full(frames, speed)
    )
    np.testing.assert_allclose([winding[-1], housing[-1]], exact, atol=2e-3)

"""Firmware: kinematics, wheel loops, heading, timeout, slow loops, derating, restart."""

from typing import Any

import numpy as np
import pytest
from benches.plant import RADIUS_M, TANGENTS
from benches.robot import CYCLES, FRAME_S, Firmware
from numpy.typing import NDArray

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.settings import Settings

PURE: dict[str, Any] = {"turn_rate_gain": 0.0, "feedforward": 0.0, "kp": 0.1}


def settings(**firmware: Any) -> Settings:
    return resolve_settings({"firmware": PURE | firmware})


def desired_speeds(x: float, y: float, turn: float = 0.0) -> NDArray:
    """Wheel speeds of equation 3, rad/s."""
    return (TANGENTS @ [x, y] + resolve_settings().wheels.arm_m * turn) / RADIUS_M


def duties(speeds: NDArray, gain: float) -> NDArray:
    return np.clip(gain * speeds / resolve_settings().firmware.nominal_voltage_v, -1, 1)


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.5])
def test_duties_of_wheels_at_rest_are_the_gain_times_the_speeds_of_equation_3(
    heading: float,
) -> None:
    """Velocities in the world frame are rotated by the heading, those in the body frame are not."""
    firmware = Firmware([settings()], heading)
    firmware.accept(x=0.4, y=-0.2, turn=1.5)
    c, s = np.cos(heading), np.sin(heading)
    expected = duties(desired_speeds(c * 0.4 - s * 0.2, -s * 0.4 - c * 0.2, 1.5), 0.1)
    np.testing.assert_allclose(firmware.run(0.0, 0.0)[:, 0], expected)
    firmware.accept(x=0.4, y=-0.2, in_body_frame=np.array([True]))
    np.testing.assert_allclose(firmware.run(0.0, 0.0)[:, 0], duties(desired_speeds(0.4, -0.2), 0.1))
    firmware.accept(wheel_speeds=np.full((4, 1), 7.0))
    np.testing.assert_allclose(firmware.run(0.0, 0.0)[:, 0], duties(np.full(4, 7.0), 0.1))


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.5])
def test_a_new_heading_applies_at_once(heading: float) -> None:
    """As in a robot that was switched on with it, and not only from the next frame on."""
    corrected, reference = Firmware([settings()], 2.0), Firmware([settings()], heading)
    corrected.accept()
    corrected.run(0.0, 0.0)
    corrected.set_heading(heading)
    for firmware in (corrected, reference):
        firmware.accept(x=0.4, y=-0.2)
    np.testing.assert_allclose(corrected.run(0.0, 0.0), reference.run(0.0, 0.0), atol=1e-12)


def test_the_wheel_loop_is_a_pid_with_anti_windup() -> None:
    period = 1 / 960
    firmware = Firmware([settings(ki=4.0, kd=2e-4)])
    firmware.accept(x=0.3)
    errors, speeds = desired_speeds(0.3, 0.0), []
    for cycle in range(1, 6):
        slope = 2e-4 * errors / period if cycle == 1 else 0.0
        volts = 0.1 * errors + 4.0 * errors * cycle * period + slope
        speeds.append(firmware.run(0.0, 0.0)[:, 0])
        np.testing.assert_allclose(speeds[-1], duties(volts, 1.0))
    saturated = Firmware([settings(ki=50.0)])
    saturated.accept(x=500.0)
    for _ in range(100):
        saturated.run(0.0, 0.0)
    saturated.accept(x=0.0)
    assert np.abs(saturated.run(0.0, 0.0)).max() == 0, (
        "the integral is frozen while the voltage is at its limit"
    )


def test_encoders_round_down_to_counts() -> None:
    counts = (
        resolve_settings().sensors.encoder_counts
        * resolve_settings().motor.gear_ratio
        / (2 * np.pi)
    )
    firmware = Firmware([settings()])
    firmware.run(0.0, 0.0)
    assert np.abs(firmware.run(0.0, 0.9 / counts)).max() == 0
    duty = firmware.run(0.0, 3.5 / counts)
    np.testing.assert_allclose(duty[:, 0], duties(np.full(4, -3 / counts * 960), 0.1))


def test_slow_loops_run_in_every_kth_cycle_and_hold_duties_in_between() -> None:
    firmware = Firmware([settings(rate_hz=240), settings()])
    firmware.accept(x=0.3)
    duties_by_cycle = []
    for cycle in range(12):
        if cycle == 5:
            firmware.accept(x=0.6)
        duties_by_cycle.append(firmware.run(0.0, 0.0))
    slow, fast = np.array(duties_by_cycle)[:, 0].T
    assert (slow == np.where(np.arange(12) < 8, slow[0], 2 * slow[0])).all()
    assert (fast == np.where(np.arange(12) < 5, fast[0], 2 * fast[0])).all()


def test_a_robot_without_new_commands_halts_until_it_gets_one() -> None:
    firmware = Firmware([settings(timeout_s=0.1)])
    firmware.accept(x=0.3)
    moves = [np.abs(firmware.run(0.0, 0.0)).max() > 0 for _ in range(120)]
    assert moves == [True] * 96 + [False] * 24
    firmware.accept(x=0.3, is_new=np.array([False]))
    assert not firmware.run(0.0, 0.0).any()
    firmware.accept(x=0.3)
    assert firmware.run(0.0, 0.0).any()


@pytest.mark.parametrize("age", [7, 29], ids=["late", "as old as the memory"])
def test_the_heading_is_the_integral_of_the_gyro_corrected_by_delayed_vision(age: int) -> None:
    """A heading of vision is compared with the estimate when it was sent; bias is estimated."""
    rate, bias = 1.0, 0.05
    firmware, true = Firmware([settings()], 0.0), [0.0]
    for frame in range(1200):
        sent_frame = max(frame - age, 0)
        firmware.begin_frame(true[sent_frame], frame - sent_frame)
        for _ in range(CYCLES):
            firmware.run(rate + bias, 0.0)
        true.append(true[-1] + rate * FRAME_S)
    assert firmware.heading[0] == pytest.approx(true[-1], abs=2e-3)
    blind = Firmware([settings()], 0.0)
    for _ in range(60 * CYCLES):
        blind.run(rate + bias, 0.0)
    assert blind.heading[0] == pytest.approx(1.05)


def test_the_turn_rate_loop_adds_its_gain_times_the_rate_error() -> None:
    firmware = Firmware([settings(turn_rate_gain=2.0)])
    firmware.accept(turn=3.0)
    expected = duties(desired_speeds(0, 0, 3.0 + 2.0 * (3.0 - 1.0)), 0.1)
    np.testing.assert_allclose(firmware.run(1.0, 0.0)[:, 0], expected)


@pytest.mark.parametrize(("winding", "fraction"), [(100.0, np.inf), (120.0, 0.5), (130.0, 0.0)])
def test_derating_reduces_the_current_near_the_temperature_limit(
    winding: float, fraction: float
) -> None:
    """Twice the nominal current 10 K below the limit of 125 degrees, none at it."""
    chosen = resolve_settings(
        {
            "firmware": PURE | {"kp": 5.0, "thermal_derating": True},
            "motor": {"max_winding_c": 125.0},
        }
    )
    firmware = Firmware([chosen])
    firmware.winding = np.full((4, 1), winding)
    firmware.begin_frame()
    firmware.accept(x=2.0)
    volts = firmware.run(0.0, 0.0)[:, 0] * chosen.firmware.nominal_voltage_v
    max_volts = fraction * 2 * chosen.motor.nominal_current_a * chosen.motor.resistance_ohm
    np.testing.assert_allclose(np.abs(volts), min(max_volts, chosen.firmware.nominal_voltage_v))


def test_a_restarted_processor_halts_until_vision_sends_a_heading() -> None:
    firmware = Firmware([settings()], 0.5, has_faults=True)
    firmware.accept(x=0.3)
    for off, vision_heading, moves in (
        (False, np.nan, True),
        (True, 1.0, False),
        (False, np.nan, False),
        (False, 2.0, False),
    ):
        firmware.begin_frame(vision_heading, off=off)
        assert firmware.run(0.0, 0.0).any() == moves
    assert firmware.heading[0] == pytest.approx(2.0)
    firmware.accept(x=0.3)
    assert firmware.run(0.0, 0.0).any()

"""Firmware: kinematics, encoders, heading. test_firmware_description.py checks the loops."""

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
    """As in a robot that was switched on with it: from this cycle on, without a gyro bias."""
    chosen = [settings(turn_rate_gain=1.0)]
    corrected, reference = Firmware(chosen, 2.0), Firmware(chosen, heading)
    corrected.begin_frame(1.0)  # vision differs from the estimate, as from a biased gyro
    corrected.accept()
    corrected.run(0.0, 0.0)
    corrected.set_heading(heading)
    for firmware in (corrected, reference):
        firmware.accept(x=0.4, y=-0.2)
    np.testing.assert_allclose(corrected.run(0.0, 0.0), reference.run(0.0, 0.0), atol=1e-12)


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

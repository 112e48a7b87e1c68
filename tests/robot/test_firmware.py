"""Firmware: the estimated heading. test_firmware_description.py checks everything else."""

from typing import Any

import numpy as np
import pytest
from benches.robot import CYCLES, FRAME_S, Firmware

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.settings import Settings

PURE: dict[str, Any] = {"turn_rate_gain": 0.0, "feedforward": 0.0, "kp": 0.1}


def settings(**firmware: Any) -> Settings:
    return resolve_settings({"firmware": PURE | firmware})


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

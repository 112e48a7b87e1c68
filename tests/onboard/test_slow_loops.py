"""Loops slower than the physics: they reckon as loops that are called so seldom do, and hold between."""

import numpy as np
import pytest
from numpy.typing import NDArray
from omni_mj.onboard.firmware import Firmware

from omni_control.kinematics import Kinematics
from omni_mj.link.radio import Received
from omni_mj.scenarios.settings import Settings

KINEMATICS = Kinematics(np.radians([60.0, 135, 225, 300]), arm=0.08, radius=0.0285)
FRAME_S = 1 / 60
STILL = np.zeros(1)
COLD = np.full((1, 4), 25.0)


def slow(rate: int, **gains: float) -> Settings:
    return Settings(firmware={"rate_hz": rate, "kp": 0.3, "ki": 2.0, "kd": 0.001, **gains})


def played(chosen: list[Settings], calls: int = 48) -> NDArray:
    """Duties (calls, n, 4) of firmware that is called at 960 Hz, of wheels and gyros that swing."""
    n = len(chosen)
    firmware = Firmware(chosen, KINEMATICS, np.zeros(n), 1 / 960, FRAME_S)
    duties = []
    for k in range(calls):
        if k % 16 == 0:
            firmware.receive(Received.at_once(np.tile([0.5, 0.2 + k / 100, 1.0], (n, 1))), np.full((n, 4), 25.0))
        angle = np.tile(0.3 * np.sin(k / 7 + np.arange(4)), (n, 1))
        duties.append(firmware.duties(np.full(n, np.cos(k / 5)), angle))
    return np.array(duties)


@pytest.mark.parametrize("every", [2, 5, 10])
def test_a_slower_loop_reckons_in_every_kth_cycle_and_holds_between(every: int) -> None:
    """What it gives is what a loop gives that is called so seldom, its integral, derivative and gyro over that time.

    Exactly up to rounding; commands come every 16 cycles, at which 2, 5 and 10 have run or wait for their turn.
    """
    (chosen,), calls = [slow(960 // every)], 48
    slower = played([chosen], calls)[:, 0]
    alone = Firmware([slow(960)], KINEMATICS, np.zeros(1), every / 960, FRAME_S)
    for k in range(calls):
        if k % 16 == 0:
            alone.receive(Received.at_once(np.array([[0.5, 0.2 + k / 100, 1.0]])), COLD)
        if k % every == 0:
            angle = 0.3 * np.sin(k / 7 + np.arange(4))[None]
            expected = alone.duties(np.array([np.cos(k / 5)]), angle)[0]
        np.testing.assert_allclose(slower[k], expected, rtol=1e-12, atol=1e-12)


def test_rates_are_each_robots_own_bit_for_bit() -> None:
    """A robot at full rate beside slower ones gives what it gives alone."""
    chosen = [slow(960), slow(192), slow(96)]
    together = played(chosen)
    for i, each in enumerate(chosen):
        assert together[:, i].tobytes() == played([each])[:, 0].tobytes()


def test_what_a_caller_does_to_held_duties_stays_with_it() -> None:
    """The plant switches off robots that failed in the very array."""
    firmware = Firmware([slow(96)], KINEMATICS, np.zeros(1), 1 / 960, FRAME_S)
    firmware.receive(Received.at_once(np.array([[1.0, 0.0, 0.0]])), COLD)
    first = firmware.duties(STILL, np.zeros((1, 4)))
    kept = first.copy()
    first[:] = 0.0
    np.testing.assert_array_equal(firmware.duties(STILL, np.zeros((1, 4))), kept)

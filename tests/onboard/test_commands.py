"""What firmware makes of commands that are not the field's velocities, and of silence."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omni_mj.onboard.firmware import Firmware

from omni_control.kinematics import Kinematics, world_to_body
from omni_mj.link.radio import Received
from omni_mj.scenarios.settings import Settings

CYCLE_S, PERIOD_S = 1 / 960, 1 / 60
COLD = np.full((1, 4), 25.0)
angles, speeds = st.floats(-3.1, 3.1), st.floats(-3, 3)


@cache
def settings_of(**firmware: float) -> Settings:
    return Settings(firmware=firmware)


def firmware_of(heading: float = 0.0, **firmware: float) -> tuple[Firmware, Kinematics]:
    chosen = settings_of(**firmware)
    kinematics = chosen.wheels.kinematics
    return Firmware([chosen], kinematics, np.array([heading]), CYCLE_S, PERIOD_S), kinematics


def received(command: list[float], **how: object) -> Received:
    return Received(np.array([command]), np.full(1, np.nan), np.zeros(1, int), np.ones(1, bool), **how)  # type: ignore[arg-type]


def duties(firmware: Firmware, heard: Received | None) -> np.ndarray:
    """Of a robot that stands, in its first cycle with a command."""
    if heard is not None:
        firmware.obey(heard)
    return firmware.duties(np.zeros(1), np.zeros((1, 4)))


@settings(deadline=None, max_examples=40, derandomize=True)
@given(angles, speeds, speeds, speeds)
def test_velocities_of_the_body_and_rim_speeds_are_those_of_the_world_seen_by_the_robot(
    heading: float, vx: float, vy: float, w: float
) -> None:
    """The world's turned back by the heading; their rim speeds by equation 4, without the loop on the gyro (w = 0)."""
    world = [vx, vy, w]
    body = world_to_body(world, heading)
    expected = duties(firmware_of(heading)[0], received(world))
    got = duties(firmware_of(heading)[0], received(list(body), body=np.ones(1, bool)))
    np.testing.assert_allclose(got, expected, atol=1e-12)
    firmware, kinematics = firmware_of(heading, turn_gain=0)
    rims = kinematics.wheel_speeds(body)[None] * kinematics.radius
    expected = duties(firmware_of(heading, turn_gain=0)[0], received(world))
    np.testing.assert_allclose(duties(firmware, received([0, 0, 0], wheels=rims)), expected, atol=1e-12)


@pytest.mark.parametrize("how", [{}, {"body": np.ones(1, bool)}, {"wheels": np.full((1, 4), 0.5)}])
@pytest.mark.parametrize("timeout", [0.0, 0.05])
def test_a_robot_stops_in_the_cycle_after_its_patience(timeout: float, how: dict) -> None:
    """0.05 s are 48 cycles: the 49th is the first without the command; with 0 there is none. A new one ends it."""
    firmware, _ = firmware_of(timeout_s=timeout)
    told = [duties(firmware, received([1.0, 0.0, 0.0], **how))] + [duties(firmware, None) for _ in range(60)]
    moving = [bool(np.abs(duty).max() > 0) for duty in told]
    assert moving == [True] * (48 if timeout else 61) + [False] * (13 if timeout else 0)
    assert np.abs(duties(firmware, received([1.0, 0.0, 0.0], **how))).max() > 0


def test_packets_that_bring_nothing_new_do_not_keep_a_robot_awake() -> None:
    """As where all are lost: the radio holds the last command, and says that it is not new."""
    firmware, _ = firmware_of(timeout_s=0.05)
    heard = received([1.0, 0.0, 0.0])
    duties(firmware, heard)
    stale = Received(heard.command, heard.heading, heard.age, np.zeros(1, bool))
    told = [duties(firmware, stale if cycle % 16 == 0 else None) for cycle in range(100)]
    assert np.abs(told[40]).max() > 0
    assert np.abs(told[-1]).max() == 0

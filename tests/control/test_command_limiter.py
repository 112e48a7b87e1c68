"""Limits of commands: speed and change per frame hold for any input, and nothing else changes."""

import math

import numpy as np
from benches.control import CommandLimiter
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from omni_control import MotionLimits

FRAME_S = 1 / 60
LIMITS = MotionLimits(speed=2.0, acceleration=3.0, turn_rate=10.0, turn_acceleration=30.0)
STEP_M_S, STEP_RAD_S = 3.0 * FRAME_S, 30.0 * FRAME_S
ROUNDING = 1 + 1e-12

number = st.floats(-1e3, 1e3) | st.sampled_from([0.0, -0.0, 1e-300, 2.0, 10.0, 1e12])
sequences = st.lists(st.tuples(number, number, number), min_size=1, max_size=40)


def limit_sequence(commands: NDArray) -> NDArray:
    """Return the limited commands (frames, 3) of one robot that starts at rest."""
    limit, sent = CommandLimiter([LIMITS], FRAME_S), [np.zeros((1, 3))]
    for command in commands[:, None]:
        sent.append(limit(command, sent[-1]))
    return np.array(sent[1:])[:, 0]


def compute_speeds(sent: NDArray) -> NDArray:
    return np.hypot(sent[:, 0], sent[:, 1])


@given(sequences)
def test_limits_hold_for_any_sequence(commands: list[tuple[float, float, float]]) -> None:
    sent = limit_sequence(np.array(commands))
    steps = np.diff(sent, axis=0, prepend=np.zeros((1, 3)))
    # Rounding of the last bits, against steps from speeds of up to 2 m/s or 10 rad/s.
    assert (compute_speeds(sent) <= 2.0 * ROUNDING).all()
    assert (np.abs(sent[:, 2]) <= 10.0 * ROUNDING).all()
    assert (compute_speeds(steps) <= STEP_M_S * ROUNDING + 1e-15).all()
    assert (np.abs(steps[:, 2]) <= STEP_RAD_S * ROUNDING + 1e-14).all()


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=40))
def test_commands_within_the_limits_pass_unchanged(
    directions: list[tuple[float, float, float]],
) -> None:
    # Steps of at most 0.7 of the limit per axis are 0.99 as a vector, and 40 of them stay below
    # both speed limits.
    max_step = [0.7 * STEP_M_S, 0.7 * STEP_M_S, 0.49 * STEP_RAD_S]
    walk = np.cumsum(np.array(directions) * max_step, axis=0)
    # The difference to the last command rounds.
    np.testing.assert_allclose(limit_sequence(walk), walk, rtol=0, atol=1e-14)


def test_commands_change_along_a_straight_line_at_the_limit() -> None:
    for azimuth in np.radians([0, 45, 160, 270]):
        direction = np.array([math.cos(azimuth), math.sin(azimuth)])
        sent = limit_sequence(np.tile([*(5.0 * direction), 0.0], (60, 1)))
        # From rest in steps of a T up to the highest speed. Limits per axis would bend the path.
        expected = np.minimum(STEP_M_S * np.arange(1, 61), 2.0)[:, None] * direction
        # Sums of 40 steps.
        np.testing.assert_allclose(sent[:, :2], expected, atol=1e-12)

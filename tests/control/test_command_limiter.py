"""The limits of what may be commanded: speed and change per frame hold for any wish, and only they act."""

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


def play(commands: NDArray, *each: MotionLimits) -> NDArray:
    """What robots that want the `commands` (frames, n, 3) are sent, within the limits of each."""
    limits, sent = CommandLimiter(each, FRAME_S), [np.zeros(commands.shape[1:])]
    for command in commands:
        sent.append(limits(command, sent[-1]))
    return np.array(sent[1:])


def played(commands: NDArray) -> NDArray:
    """The same of one robot, (frames, 3)."""
    return play(commands[:, None], LIMITS)[:, 0]


def speeds(sent: NDArray) -> NDArray:
    return np.hypot(sent[:, 0], sent[:, 1])


@given(sequences)
def test_limits_hold_for_any_sequence(commands: list[tuple[float, float, float]]) -> None:
    sent = played(np.array(commands))
    steps = np.diff(sent, axis=0, prepend=np.zeros((1, 3)))  # a run starts at rest
    # Rounding of the last bits, against steps taken from speeds of up to 2 m/s or 10 rad/s.
    assert (speeds(sent) <= 2.0 * ROUNDING).all()
    assert (np.abs(sent[:, 2]) <= 10.0 * ROUNDING).all()
    assert (speeds(steps) <= STEP_M_S * ROUNDING + 1e-15).all()
    assert (np.abs(steps[:, 2]) <= STEP_RAD_S * ROUNDING + 1e-14).all()


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=40))
def test_commands_within_the_limits_pass_unchanged(
    directions: list[tuple[float, float, float]],
) -> None:
    # Steps of at most 0.7 of the limit per axis are 0.99 as a vector, and 40 of them stay below
    # both speed limits.
    walk = np.cumsum(
        np.array(directions) * [0.7 * STEP_M_S, 0.7 * STEP_M_S, 0.49 * STEP_RAD_S], axis=0
    )
    np.testing.assert_allclose(
        played(walk), walk, rtol=0, atol=1e-14
    )  # last + (wanted - last) rounds


def test_a_wish_is_approached_straight_and_as_fast_as_allowed() -> None:
    for azimuth in np.radians([0, 45, 160, 270]):
        direction = np.array([math.cos(azimuth), math.sin(azimuth)])
        sent = played(np.tile([*(5.0 * direction), 0.0], (60, 1)))
        # From rest in steps of a T up to the highest speed, along the wish: limits per axis would
        # bend the path.
        expected = np.minimum(STEP_M_S * np.arange(1, 61), 2.0)
        np.testing.assert_allclose(
            sent[:, :2], expected[:, None] * direction, atol=1e-12
        )  # sums of 40 steps

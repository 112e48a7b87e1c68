"""The radio: what is sent arrives, unchanged, exactly k_d frames later."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from omni_mj.radio import Radio


@settings(deadline=None, max_examples=60, derandomize=True)
@given(delay=st.integers(0, 20), robots=st.integers(1, 4), frames=st.integers(1, 60), seed=st.integers(0, 2**32))
def test_delivered_is_what_was_sent_k_d_frames_ago(delay: int, robots: int, frames: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    commands, headings = rng.normal(size=(frames, robots, 3)), rng.normal(size=(frames, robots))
    radio = Radio(robots, delay)
    delivered = [radio.exchange(command, heading) for command, heading in zip(commands, headings, strict=True)]
    # Before the first packet arrives the robot is told to stand, and no heading; copies, so equal to the last bit.
    expected = np.concatenate([np.zeros((delay, robots, 3)), commands])[:frames]
    np.testing.assert_array_equal([command for command, _ in delivered], expected)
    expected = np.concatenate([np.full((delay, robots), np.nan), headings])[:frames]
    np.testing.assert_array_equal([heading for _, heading in delivered], expected)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(st.integers(0, 5))
def test_a_packet_in_flight_cannot_be_changed(delay: int) -> None:
    radio = Radio(1, delay)
    command, heading = np.ones((1, 3)), np.ones(1)
    delivered = [radio.exchange(command, heading)]
    command[:], heading[:] = 7.0, 7.0  # the sender's arrays, reused
    for _ in range(delay):
        for received in delivered[-1]:
            received[:] = 9.0  # the receiver's arrays, reused
        delivered.append(radio.exchange(np.zeros((1, 3)), np.zeros(1)))
    for received in delivered[-1]:
        np.testing.assert_array_equal(received, 1.0)


def test_no_delay_is_no_queue() -> None:
    radio = Radio(1, 0)
    for value in (2.0, 3.0):
        command, heading = radio.exchange(np.full((1, 3), value), np.full(1, -value))
        np.testing.assert_array_equal(command, value)
        np.testing.assert_array_equal(heading, -value)

"""The radio: what is sent arrives, unchanged, exactly k_d frames later."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from omni_mj.radio import Radio


@settings(deadline=None, max_examples=60, derandomize=True)
@given(delay=st.integers(0, 20), robots=st.integers(1, 4), frames=st.integers(1, 60), seed=st.integers(0, 2**32))
def test_delivered_is_what_was_sent_k_d_frames_ago(delay: int, robots: int, frames: int, seed: int) -> None:
    sent = np.random.default_rng(seed).normal(size=(frames, robots, 3))
    radio = Radio(robots, delay)
    delivered = np.array([radio.exchange(command) for command in sent])
    # Zero before the first command arrives; copies, so equal to the last bit.
    expected = np.concatenate([np.zeros((delay, robots, 3)), sent])[:frames]
    np.testing.assert_array_equal(delivered, expected)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(st.integers(0, 5))
def test_a_command_in_flight_cannot_be_changed(delay: int) -> None:
    radio = Radio(1, delay)
    command = np.ones((1, 3))
    delivered = [radio.exchange(command)]
    command[:] = 7.0  # the sender's array, reused
    for _ in range(delay):
        delivered[-1][:] = 9.0  # the receiver's array, reused
        delivered.append(radio.exchange(np.zeros((1, 3))))
    np.testing.assert_array_equal(delivered[-1], 1.0)


def test_no_delay_is_no_queue() -> None:
    radio = Radio(1, 0)
    np.testing.assert_array_equal(radio.exchange(np.full((1, 3), 2.0)), 2.0)
    np.testing.assert_array_equal(radio.exchange(np.full((1, 3), 3.0)), 3.0)

"""Latency and gain by least squares, against robots whose answer is known in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omni_mj.live import answer

FRAMES, PERIOD_S = 240, 1 / 60
latencies, gains = st.floats(0.0, 12.0), st.floats(0.5, 1.2)


def swung(frame: np.ndarray, latency: float) -> np.ndarray:
    """What a swing of 1 rad/s at 1 Hz has led to, of commands that are held for a frame each, summed frame by frame."""
    turned = [sum(np.sin(2 * np.pi * j * PERIOD_S) * min(max(k - latency - j, 0), 1) for j in range(k)) for k in frame]
    return np.array(turned) * PERIOD_S


@given(latencies, gains, st.integers(0, 99))
@settings(max_examples=15, deadline=None)
def test_latency_and_gain_are_found(latency: float, gain: float, seed: int) -> None:
    """Headings with 0.01 rad of noise of which some are missing, positions with 1 mm.

    Headings swing by 0.7 rad/s times the gain (rms), 12 mrad a frame: from 216 of them noise leaves 0.06 frames of the
    latency over the gain, and of the swing's size, 0.11 rad, 0.6 % over the gain. Allowed are five of these deviations.
    Positions move over the window by 16 mm more or less a frame later, ten times as well known.
    """
    frame, rng = np.arange(FRAMES), np.random.default_rng(seed)
    sent, led = np.sin(2 * np.pi * frame * PERIOD_S), gain * swung(frame, latency)
    heading = led + 0.01 * rng.normal(size=FRAMES)
    heading[rng.random(FRAMES) < 0.1] = np.nan
    found = answer.turning(sent, (heading + 3.0 + np.pi) % (2 * np.pi) - np.pi)
    assert found.latency == pytest.approx(latency, abs=0.3 / gain)
    assert found.gain == pytest.approx(gain, rel=0.03 / gain)

    position = np.column_stack([led, -2 * led]) + 0.001 * rng.normal(size=(FRAMES, 2))
    found = answer.driving(np.column_stack([sent, -2 * sent]), position)
    assert found.latency == pytest.approx(latency, abs=0.1)
    assert found.gain == pytest.approx(gain, rel=0.02)


def test_a_robot_that_does_not_answer_is_recognised() -> None:
    rng, sent = np.random.default_rng(0), np.sin(np.arange(FRAMES) / 10)
    assert not answer.turning(sent, 0.01 * rng.normal(size=FRAMES)).any
    assert not answer.turning(sent, np.full(FRAMES, np.nan)).any
    still = answer.driving(np.column_stack([sent, sent]), np.zeros((FRAMES, 2)))
    assert np.isnan(still.latency)
    assert np.isnan(still.gain)

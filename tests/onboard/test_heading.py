"""The robot's estimate of its heading from gyro and vision, against closed forms and a Lyapunov equation."""

import numpy as np
import pytest
from driving import FRAME_S, with_settings
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from omni_mj.onboard.heading import HeadingEstimate
from scipy.linalg import solve_discrete_lyapunov

from omni_mj.link.radio import Radio


def observer(
    n: int = 1,
    heading: NDArray | float = 0.0,
    delay: int = 0,
    heading_gain: float = 2.0,
    bias_gain: float = 0.5,
    jitter: int = 0,
) -> HeadingEstimate:
    chosen = with_settings(
        firmware={"heading_gain": heading_gain, "bias_gain": bias_gain},
        radio={"delay_frames": delay, "jitter_frames": jitter},
    )
    return HeadingEstimate([chosen] * n, np.broadcast_to(heading, n).astype(float), FRAME_S)


def wrapped(angle: NDArray) -> NDArray:
    """As vision reports headings."""
    return np.angle(np.exp(1j * angle))


@settings(deadline=None, max_examples=25, derandomize=True)
@given(
    start=st.floats(-10, 10),
    rates=st.lists(st.floats(-25, 25), min_size=1, max_size=60),
    delay=st.integers(0, 12),
    heading_gain=st.floats(0, 30),
    bias_gain=st.floats(0, 30),
)
def test_vision_that_is_late_causes_no_error_while_turning(
    start: float, rates: list[float], delay: int, heading_gain: float, bias_gain: float
) -> None:
    estimate = observer(1, start, delay, heading_gain, bias_gain)
    truth = [start]
    for frame, rate in enumerate(rates):
        # What vision saw when the command that arrives now was sent; nothing before the first arrives.
        seen = truth[frame - delay] if frame >= delay else np.nan
        estimate.correct(wrapped(np.array([seen])), np.array([delay]))
        for _ in range(4):
            estimate.turn(np.array([rate]) - estimate.bias, FRAME_S / 4)
        truth.append(truth[-1] + rate * FRAME_S)
        # Rounding of the sums, and of vision's wrapped angles.
        assert estimate.heading[0] == pytest.approx(truth[-1], abs=1e-9)
        assert abs(estimate.bias[0]) < 1e-9


@settings(deadline=None, max_examples=25, derandomize=True)
@given(
    start=st.floats(-10, 10),
    rates=st.lists(st.floats(-25, 25), min_size=20, max_size=60),
    delay=st.integers(1, 12),
    seed=st.integers(0, 1000),
    data=st.data(),
)
def test_vision_that_is_more_or_less_late_causes_no_error_while_turning(
    start: float, rates: list[float], delay: int, seed: int, data: st.DataObject
) -> None:
    """With jitter too each heading is compared with the one held when it was sent, which only its age can tell."""
    jitter = data.draw(st.integers(1, delay))
    estimate, truth = observer(1, start, delay, 20.0, 20.0, jitter), start
    radio = Radio([with_settings(radio={"delay_frames": delay, "jitter_frames": jitter}).radio], [(seed,)])
    for rate in rates:
        received = radio.exchange(np.zeros((1, 3)), wrapped(np.array([truth])))
        estimate.correct(received.heading, received.age)
        estimate.turn(np.array([rate]) - estimate.bias, FRAME_S)
        truth += rate * FRAME_S
        # Rounding of the sums, and of vision's wrapped angles.
        assert estimate.heading[0] == pytest.approx(truth, abs=1e-9)
        assert abs(estimate.bias[0]) < 1e-9


def test_the_estimated_bias_converges_to_the_gyros() -> None:
    rng, n, frames = np.random.default_rng(4), 60, 60 * 60
    bias, offset, turning = rng.uniform(-0.1, 0.1, n), rng.uniform(-1, 1, n), rng.uniform(-10, 10, n)
    delay, each = rng.integers(0, 13, n), np.arange(n)
    estimate, truth = observer(n, offset, 12), np.zeros((frames + 1, n))
    for frame in range(frames):
        seen = np.where(frame >= delay, truth[frame - delay, each], np.nan)
        estimate.correct(wrapped(seen), delay)
        rate = turning * np.sin(frame / 20)
        estimate.turn(rate + bias - estimate.bias, FRAME_S)
        truth[frame + 1] = truth[frame] + rate * FRAME_S
    # s^2 + 2 s + 0.5 has its slow root at -0.293/s: within a minute exp(-17.6) of bias and offset is left.
    left = 10 * np.exp(-17.6) * (np.abs(bias) + np.abs(offset)) + 1e-9
    assert (np.abs(estimate.bias - bias) < left).all()
    assert (np.abs(estimate.heading - truth[-1]) < left).all()


def test_bias_and_heading_converge_as_the_second_order_law_says() -> None:
    heading_gain, bias_gain, bias = 2.0, 0.5, 0.05
    estimate = observer(1, 0.0, 0, heading_gain, bias_gain)
    estimates = []
    for _ in range(20 * 60):
        estimate.correct(np.zeros(1), np.zeros(1, int))  # a robot at rest, seen without noise
        estimate.turn(bias - estimate.bias, FRAME_S)
        estimates.append((estimate.heading[0], estimate.bias[0]))
    # e' = (b - b^) - g_h e, b^' = g_b e: roots of s^2 + g_h s + g_b, partial fractions of the step.
    time = (np.arange(20 * 60) + 1) * FRAME_S
    fast, slow = np.roots([1, heading_gain, bias_gain])
    heading = bias * (np.exp(slow * time) - np.exp(fast * time)) / (slow - fast)
    bias_estimate = bias * (1 - (slow * np.exp(fast * time) - fast * np.exp(slow * time)) / (slow - fast))
    got = np.array(estimates)
    # 3 % of the bias (and of the largest heading error, bias / 2.8): frames of 1/60 s instead of continuous
    # correction, g_h T / 2 = 1.7 %.
    np.testing.assert_allclose(got[:, 1], bias_estimate, atol=0.03 * bias)
    np.testing.assert_allclose(got[:, 0], heading, atol=0.03 * bias)


def test_heading_stays_with_vision_to_within_its_noise() -> None:
    n, sigma_vision, sigma_gyro, heading_gain, bias_gain = 2000, 0.01, 0.005, 2.0, 0.5
    rng = np.random.default_rng(0)
    estimate = observer(n, 0.0, 0, heading_gain, bias_gain)
    for frame in range(20 * 60):
        truth = 2.0 * np.sin(frame / 30)
        estimate.correct(wrapped(truth + sigma_vision * rng.standard_normal(n)), np.zeros(n, int))
        rate = (2.0 * np.sin((frame + 1) / 30) - truth) / FRAME_S
        estimate.turn(rate + sigma_gyro * rng.standard_normal(n) - estimate.bias, FRAME_S)
    error = estimate.heading - 2.0 * np.sin(20 * 60 / 30)
    # The state (heading error, bias error) of a frame: e' = (1 - g_h T) e + g_h T v - T b' + T w and
    # b' = b + g_b T (e - v); its covariance solves P = A P A' + Q.
    correct = np.array([[1 - heading_gain * FRAME_S, 0.0], [bias_gain * FRAME_S, 1.0]])
    vision = np.array([heading_gain * FRAME_S, -bias_gain * FRAME_S]) * sigma_vision
    turn = np.array([[1.0, -FRAME_S], [0.0, 1.0]])
    gyro = np.array([FRAME_S * sigma_gyro, 0.0])
    noise = np.outer(turn @ vision, turn @ vision) + np.outer(gyro, gyro)
    covariance = solve_discrete_lyapunov(turn @ correct, noise)
    # A deviation of 2000 samples is known to 1 / sqrt(4000); five sigmas.
    assert error.std() == pytest.approx(np.sqrt(covariance[0, 0]), rel=5 / np.sqrt(2 * n))
    assert abs(error.mean()) < 5 * error.std() / np.sqrt(n)
    assert estimate.bias.std() == pytest.approx(np.sqrt(covariance[1, 1]), rel=5 / np.sqrt(2 * n))
    # The fusion is the better sensor: far closer than a single frame of vision.
    assert error.std() < 0.2 * sigma_vision


def test_robots_with_different_delays_share_a_batch() -> None:
    delays = [0, 3, 7]
    chosen = [with_settings(radio={"delay_frames": d}) for d in delays]
    together = HeadingEstimate(chosen, np.array([0.3, -0.2, 0.1]), FRAME_S)
    alone = [HeadingEstimate([s], np.array([h]), FRAME_S) for s, h in zip(chosen, [0.3, -0.2, 0.1], strict=True)]
    rng = np.random.default_rng(1)
    for _ in range(30):
        seen, rate = rng.normal(size=3), rng.normal(size=3)
        together.correct(seen, np.array(delays))
        together.turn(rate - together.bias, FRAME_S)
        for i, one in enumerate(alone):
            one.correct(seen[i : i + 1], np.array(delays[i : i + 1]))
            one.turn(rate[i : i + 1] - one.bias, FRAME_S)
    np.testing.assert_array_equal(together.heading, np.concatenate([one.heading for one in alone]))

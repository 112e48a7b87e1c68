"""Statistics of a run against closed forms and scipy's own distributions."""

import math

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from omni_mj.measure import metrics
from omni_mj.simulate.log import Trajectory

T = 1 / 60


def moving(frames: int, rest: int) -> np.ndarray:
    """A reference (frames, 3) that moves up to frame `rest` and stands from there on."""
    poses = np.zeros((frames, 3))
    poses[:, 0] = 0.01 * np.minimum(np.arange(frames), rest)
    return poses


@settings(deadline=None, derandomize=True)
@given(
    arrays(float, array_shapes(min_dims=1, max_dims=3, min_side=2, max_side=9), elements=st.floats(-10, 10, width=32))
)
def test_confidence_is_the_interval_of_students_t(values: np.ndarray) -> None:
    """scipy.stats computes the same from its own distribution; a rounding error of 1e-9 of the values is allowed."""
    mean, half = metrics.confidence(values)
    n = values.shape[-1]
    wanted = scipy.stats.t.ppf(0.975, n - 1) * scipy.stats.sem(values, axis=-1)
    np.testing.assert_allclose(mean, values.sum(-1) / n, atol=1e-9)
    np.testing.assert_allclose(half, wanted, rtol=1e-9, atol=1e-9)


def test_confidence_covers_the_true_mean_in_95_of_100_experiments() -> None:
    """Of 20000 experiments with five normal samples; the share's own standard deviation is 0.15 %, 5 of it allowed."""
    samples = np.random.default_rng(0).normal(3.0, 2.0, (20_000, 5))
    mean, half = metrics.confidence(samples)
    assert abs((np.abs(mean - 3.0) < half).mean() - 0.95) < 5 * math.sqrt(0.95 * 0.05 / 20_000)


def test_one_sample_has_a_mean_but_no_interval() -> None:
    mean, half = metrics.confidence(np.array([[2.0], [3.0]]))
    assert mean.tolist() == [2.0, 3.0]
    assert np.isnan(half).all()


def test_position_error_is_the_distance_in_the_plane() -> None:
    """Off by 3 and -4 cm, and by any heading: 5 cm."""
    trajectory = Trajectory(("a", "b"), [0, 1, 2], 2)
    for frame in range(2):
        pose = np.zeros((6, 3))
        pose[4] = [0.03, -0.04, 1.0]  # the second seed of the second controller
        trajectory.write(frame, ref=np.ones((6, 3)), pose=pose + 1.0)
    errors = metrics.position_errors(trajectory)
    assert errors.shape == (2, 2, 3)
    np.testing.assert_allclose(errors[:, 1, 1], 0.05)
    assert errors.sum() == pytest.approx(2 * 0.05)


def test_effort_of_a_steady_acceleration_is_that_acceleration() -> None:
    """Speeding up along x and y at 3 and 4 m/s^2 from the first frame on."""
    speed = np.arange(1, 91)[:, None, None] * T
    command = np.concatenate([3.0 * speed, -4.0 * speed], axis=-1)
    assert metrics.control_effort(command) == pytest.approx([5.0])


def test_effort_of_an_oscillation_is_amplitude_times_frequency_over_the_root_of_two() -> None:
    """Over whole periods; differences over a frame shrink the derivative of a sine by sinc(w T / 2)."""
    w, frames = 2 * math.pi * 2.0, 600
    command = 0.5 * np.sin(w * T * np.arange(1, frames + 1))[:, None]
    shrink = math.sin(w * T / 2) / (w * T / 2)
    assert metrics.control_effort(command) == pytest.approx(0.5 * w * shrink / math.sqrt(2), rel=1e-9)


def test_effort_counts_the_first_command_as_a_change_from_rest() -> None:
    """A step of 0.6 m/s in the first of n frames: 0.6 / T once, so 0.6 / (T sqrt(n))."""
    command = np.full((25, 2, 2), [0.6, 0.0])
    assert metrics.control_effort(command) == pytest.approx([0.6 * 60 / 5] * 2)


@pytest.mark.parametrize(("start_m", "tau_s"), [(0.05, 0.1), (0.3, 0.25), (0.011, 1.0)])
def test_an_error_that_decays_settles_when_the_exponential_says(start_m: float, tau_s: float) -> None:
    """e(t) = start exp(-t / tau) from the end of the move on is below 1 cm after tau ln(start / 1 cm), in frames."""
    rest, frames = 30, 200
    after = np.maximum(np.arange(frames) - rest, 0) * T
    times = metrics.settling_times(moving(frames, rest), start_m * np.exp(-after / tau_s)[:, None])
    assert times == pytest.approx(math.ceil(tau_s * math.log(start_m / 0.01) / T) * T)


def test_settling_ends_with_the_last_excursion_and_is_none_for_what_is_far_at_the_end() -> None:
    """Robots: always near; far only while moving; far again later; exactly 1 cm at the end, which is not below."""
    rest, frames = 10, 50
    error = np.full((frames, 2, 2), 0.001)
    error[:rest, 0, 1] = 0.2
    error[31, 1, 0] = 0.02
    error[-1, 1, 1] = 0.01
    times = metrics.settling_times(moving(frames, rest), error)
    np.testing.assert_allclose(times, [[0, 0], [(32 - rest) * T, np.nan]])


def test_a_turn_is_a_move_and_a_reference_that_never_moves_rests_from_the_start() -> None:
    error = np.full((20, 1), 0.5)
    error[15:] = 0.0
    turning = np.zeros((20, 3))
    turning[12:, 2] = 1.0
    assert metrics.settling_times(turning, error) == pytest.approx(3 * T)
    assert metrics.settling_times(np.zeros((20, 3)), error) == pytest.approx(15 * T)

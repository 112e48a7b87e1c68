"""Measurements that arrive late: filters behind the present and their extrapolation."""

import numpy as np
import pytest
from benches.control import AdaptiveCompFlc, Array
from closed_loop import DISPLACEMENT_NOISE_RATIO, DRIFT, DRIFT_TIME_S, NOISE, T, simulate_drift
from hypothesis import given, settings
from hypothesis import strategies as st

from omni_control import Controller, MotionLimits, OmniError, Team, TeamModel, TimedReference


def estimate(measured: Array, displacement: Array, start: Array, age: Array) -> tuple[Array, Array]:
    """Return the poses and twists (frames, n, 3) that a team estimates of robots without dead time.

    The ages are (frames, n).
    """
    model = TeamModel(T, 0, lag_s=0.0, position_noise_m=NOISE[0], heading_noise_rad=NOISE[2])
    controller = Controller(model, None, len(start))  # type: ignore[arg-type]
    team, poses, twists = Team(controller, start), [], []
    for k, (pose, frame_age) in enumerate(zip(measured, age, strict=True)):
        observation = team.observe(pose, measurement_age=frame_age)
        poses.append(observation.pose)
        twists.append(observation.twist)
        team.last_command = displacement[min(k + 1, len(displacement) - 1)] / T
    return np.array(poses), np.array(twists)


def run_optimal_filter(
    measured: Array, displacement: Array, delay: int, start: float, drift_noise: float
) -> Array:
    """Return the optimal position of one axis, measured `delay` frames ago.

    Its states are position, drift, and the positions of the last `delay` frames.
    """
    count, noise = delay + 2, NOISE[0]
    f = np.zeros((count, count))
    f[0, :2], f[1, 1], f[2, 0] = (1, T), np.exp(-T / DRIFT_TIME_S), 1
    f[range(3, count), range(2, count - 1)] = 1
    x, p, positions = np.zeros(count), np.zeros((count, count)), []
    x[[0, *range(2, count)]], p[0, 0] = start, noise**2
    for z, q in zip(measured, displacement, strict=True):
        x, p = f @ x, f @ p @ f.T
        x[0] += q
        p[0, 0] += (DISPLACEMENT_NOISE_RATIO * q) ** 2
        p[1, 1] += drift_noise**2 * T
        if not np.isnan(z):
            gain = p[:, -1] / (p[-1, -1] + noise**2)
            x, p = x + gain * (z - x[-1]), p - np.outer(gain, p[-1])
        positions.append(x[0])
    return np.array(positions)


@pytest.mark.parametrize("delay", [1, 4])
def test_late_measurements_serve_nearly_as_well_as_possible(delay: int) -> None:
    """Errors are at most 3 % above those of the optimal filter, which knows the process noise."""
    true, measured, displacement = simulate_drift(3, 300, 20)
    displacement[0] = 0
    late = np.full_like(measured, np.nan)
    late[delay:] = measured[:-delay]
    poses, _ = estimate(late, displacement, true[0], np.full((300, 20), delay * T))
    optimal = [
        run_optimal_filter(late[:, i, 0], displacement[:, i, 0], delay, true[0, i, 0], DRIFT[0])
        for i in range(20)
    ]
    errors, optimal_errors = (
        (values - true[..., 0])[20:] for values in (poses[..., 0], np.array(optimal).T)
    )
    assert np.sqrt((errors**2).mean()) < 1.03 * np.sqrt((optimal_errors**2).mean())


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.floats(0, 0.2))
def test_a_perfect_robot_measured_late_is_tracked_exactly(seed: int, max_age: float) -> None:
    """Ages are up to 0.2 s, no capture precedes the last one, and robots move evenly in frames.

    The tolerance is the rounding of measurements without delay (`test_kalman_filter`).
    """
    rng, frames = np.random.default_rng(seed), np.arange(40)[:, None]
    displacement = rng.uniform(-0.05, 0.05, (40, 3, 3))
    displacement[0] = 0
    poses = np.cumsum(displacement, axis=0)
    capture = np.maximum(frames - rng.uniform(0, max_age / T, (40, 3)), 0)
    capture = np.maximum.accumulate(capture, axis=0)  # frames
    index, row = capture.astype(int), np.arange(3)
    fraction = (capture - index)[..., None]
    following = poses[np.minimum(index + 1, 39), row]
    measured = (1 - fraction) * poses[index, row] + fraction * following
    estimates, twists = estimate(measured, displacement, np.zeros((3, 3)), (frames - capture) * T)
    np.testing.assert_allclose(estimates, poses, rtol=0, atol=1e-12)
    np.testing.assert_allclose(twists, displacement / T, rtol=0, atol=1e-10)


@pytest.mark.parametrize("delay", [1 / 120, 0.05, 0.1])
def test_an_estimated_velocity_does_not_confirm_itself(delay: float) -> None:
    """Robots stop, measured to a micrometer, while the filter estimates an uncommanded 1 m/s.

    Measured to the bit, the gate would take it for a frozen image (`test_outlier_gate`). The
    velocity is forgotten a quarter of a second after the stop can be seen. A filter that uses its
    own extrapolation as a measurement would go on for good.
    """
    frames = np.arange(130)
    position = T * np.minimum(frames, 100.0)
    measured = np.zeros((130, 1, 3))
    measured[:, 0, 0] = np.interp(frames - delay / T, frames, position)
    measured[:, 0, 0] += 1e-6 * np.random.default_rng(0).standard_normal(130)
    ages = np.full((130, 1), delay)
    _, twists = estimate(measured, np.zeros((130, 1, 3)), np.zeros((1, 3)), ages)
    assert twists[100, 0, 0] == pytest.approx(1, abs=0.1)
    assert np.abs(twists[:, 0, 0]).max() < 1.2
    assert abs(twists[100 + round(delay / T) + 15, 0, 0]) < 0.05


def test_a_row_of_a_batch_equals_the_row_alone() -> None:
    """To the bit, whatever the ages of the others: each robot's filters make their own steps."""
    rng, frames = np.random.default_rng(5), 60
    ages = np.where(rng.random((frames, 3)) < 0.3, 0.0, rng.uniform(0, 0.1, (frames, 3)))
    ages *= [1, 0.3, 0]
    measured = 0.01 * np.cumsum(rng.standard_normal((frames, 3, 3)), axis=0)
    measured[rng.random((frames, 3)) < 0.1] = np.nan
    limits = MotionLimits(1.0, 1.0, 3.0, 6.0)
    model, reference = TeamModel(T, 3), TimedReference([[0, 0, 0], [0.5, 0.3, 1]], limits, T)

    def run(rows: list[int]) -> Array:
        team = Team(AdaptiveCompFlc(model, reference, len(rows)), np.zeros((len(rows), 3)))
        return np.array(
            [team.step(measured[k, rows], measurement_age=ages[k, rows]) for k in range(frames)]
        )

    batch = run([0, 1, 2])
    for row in range(3):
        np.testing.assert_array_equal(run([row])[:, 0], batch[:, row])


@pytest.mark.parametrize("age", [[-0.1], [np.nan], [np.inf], [0.1, 0.1], 0.1, "old"], ids=str)
def test_impossible_ages_are_refused(age: object) -> None:
    team = Team(Controller(TeamModel(T, 0), None, 1), np.zeros((1, 3)))  # type: ignore[arg-type]
    with pytest.raises(OmniError, match="measurement_age must be "):
        team.observe(np.zeros((1, 3)), measurement_age=age)  # type: ignore[arg-type]

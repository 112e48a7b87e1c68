"""Kalman filter of vision: textbook form, exact tracking, full turns, and independent rows."""

import numpy as np
import pytest
from benches.control import Array, FilterStep, vision_filter
from closed_loop import DISPLACEMENT_NOISE_RATIO, DRIFT, DRIFT_TIME_S, NOISE, T, simulate_drift
from hypothesis import given
from hypothesis import strategies as st

seeds = st.integers(0, 2**32 - 1)
NAMES = ("pose", "twist", "drift", "sigma", "normalized_innovation")
TRANSITION = np.array([[1, T], [0, np.exp(-T / DRIFT_TIME_S)]])


def run_filter(measured: Array, displacement: Array, start: Array) -> dict[str, Array]:
    """Return the attributes of the filter in each frame, (frames, n, 3) each."""
    kalman = vision_filter.KalmanFilter(start, T, NOISE)
    record: dict[str, list[Array]] = {name: [] for name in NAMES}
    for m, q in zip(measured, displacement, strict=True):
        kalman.update(m, q, FilterStep.to_present(len(m)))
        for name, values in record.items():
            values.append(getattr(kalman, name).copy())
    return {name: np.array(values) for name, values in record.items()}


def run_textbook_filter(
    measured: Array, displacement: Array, start: float, noise: float, drift_noise: float
) -> dict[str, Array]:
    """Return the same of one axis by matrices: predict, then correct in Joseph's form."""
    f, h = TRANSITION, np.array([[1.0, 0.0]])
    x, p = np.array([start, 0.0]), np.diag([noise**2, 0.0])
    record = []
    for z, q in zip(measured, displacement, strict=True):
        x = f @ x + [q, 0]
        p = f @ p @ f.T + np.diag([(DISPLACEMENT_NOISE_RATIO * q) ** 2, drift_noise**2 * T])
        normalized = np.nan
        if not np.isnan(z):
            s = (h @ p @ h.T + noise**2).item()
            k = p @ h.T / s
            normalized = (z - x[0]) / np.sqrt(s)
            x = x + k[:, 0] * (z - x[0])
            joseph = np.eye(2) - k @ h
            p = joseph @ p @ joseph.T + k @ k.T * noise**2
        record.append((x[0], q / T + x[1], x[1], np.sqrt(p[0, 0]), normalized))
    return dict(zip(NAMES, np.array(record).T, strict=True))


@given(seeds, st.floats(-0.1, T))
def test_a_late_measurement_corrects_as_in_the_textbook(seed: int, offset: float) -> None:
    """With h = [1, t], where t is the time from the state to the capture; covariance included.

    The drift at the capture is that of the state, and commands move the robot in between. Noise of
    their displacement counts only after the state.
    """
    rng = np.random.default_rng(seed)
    q, moved = rng.uniform(-0.03, 0.03, (2, 8)) * [[1], [offset / T]]
    f, h = TRANSITION, np.array([[1.0, offset]])
    x, p, noise = np.zeros(2), np.diag([NOISE[0] ** 2, 0.0]), NOISE[0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vision_filter, "SCALE_BOUNDS", (1.0, 1.0))
        kalman = vision_filter.KalmanFilter(np.zeros((1, 3)), T, NOISE)
        step = FilterStep(np.zeros(1), np.zeros(1, bool), np.array([offset]))
        for displacement, capture_displacement in zip(q, moved, strict=True):
            process_noise = (DISPLACEMENT_NOISE_RATIO * displacement) ** 2
            x = f @ x + [displacement, 0]
            p = f @ p @ f.T + np.diag([process_noise, DRIFT[0] ** 2 * T])
            z = (h @ x).item() + capture_displacement + rng.normal(0, 3 * noise)
            s = (h @ p @ h.T).item() + noise**2 + max(offset / T, 0) * process_noise
            k = p @ h.T / s
            innovation = z - (h @ x).item() - capture_displacement
            x, p = x + k[:, 0] * innovation, p - k @ h @ p
            measured = np.array([[z, 0.0, 0.0]])
            kalman.update(
                measured, displacement * np.eye(1, 3), step, capture_displacement * np.eye(1, 3)
            )
            results = kalman.pose, kalman.drift, kalman.sigma, kalman.normalized_innovation
            expected = x[0], x[1], np.sqrt(p[0, 0]), innovation / np.sqrt(s)
            np.testing.assert_allclose([v[0, 0] for v in results], expected, rtol=1e-8, atol=1e-12)


@given(seeds, st.floats(0, 0.9))
def test_it_is_the_textbooks_kalman_filter(seed: int, missed: float) -> None:
    """All attributes agree to 1e-9, gaps included, if the process noise is not scaled."""
    _, measured, displacement = simulate_drift(seed, 120, 2, missed=missed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vision_filter, "SCALE_BOUNDS", (1.0, 1.0))
        record = run_filter(measured, displacement, np.zeros((2, 3)))
    for axis in range(3):
        z, q = measured[:, 1, axis], displacement[:, 1, axis]
        expected = run_textbook_filter(z, q, 0.0, NOISE[axis], DRIFT[axis])
        for name, values in expected.items():
            np.testing.assert_allclose(
                record[name][:, 1, axis], values, rtol=1e-9, atol=1e-9, err_msg=name
            )


@given(seeds, st.floats(0, 0.9))
def test_a_perfect_robot_measured_perfectly_is_tracked_exactly(seed: int, missed: float) -> None:
    """A robot that follows its commands has true poses and no drift, measured or not.

    Measured headings are in (-pi, pi], true ones count full turns.
    """
    rng = np.random.default_rng(seed)
    start, displacement = rng.uniform(-4, 4, (3, 3)), rng.uniform(-0.05, 0.05, (100, 3, 3))
    displacement[..., 2] += 0.2  # full turns
    true = start + np.cumsum(displacement, axis=0)
    measured = np.where(rng.random((100, 3, 1)) < missed, np.nan, true)
    measured[..., 2] = np.angle(np.exp(1j * measured[..., 2]))
    record = run_filter(measured, displacement, start)
    # Angles of size 25 round at 4e-15, a hundred times. The drift is divided by
    # the length of a frame.
    np.testing.assert_allclose(record["pose"], true, rtol=0, atol=1e-12)
    np.testing.assert_allclose(record["twist"], displacement / T, rtol=0, atol=1e-11)

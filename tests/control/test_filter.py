"""Laws of the Kalman filter of vision: a textbook's matrices, what it tracks exactly, and what makes no difference."""

import numpy as np
import pytest
from benches.control import Array, vision_filter
from closed_loop import DRIFT, DRIFT_TIME_S, GAIN_ERROR, NOISE, T, simulate_drift
from hypothesis import given
from hypothesis import strategies as st

seeds = st.integers(0, 2**32 - 1)


def filtered(measured: Array, displacement: Array, start: Array) -> dict[str, Array]:
    """What the filter says in each frame, (frames, n, 3) each, by the names of its attributes."""
    kalman = vision_filter.KalmanFilter(start, T, NOISE)
    said: dict[str, list[Array]] = {
        name: [] for name in ("pose", "twist", "drift", "sigma", "normalized_innovation")
    }
    for m, q in zip(measured, displacement, strict=True):
        kalman.update(m, q)
        for name, values in said.items():
            values.append(getattr(kalman, name).copy())
    return {name: np.array(values) for name, values in said.items()}


def filtered_as_stated(measured: Array, displacement: Array, start: Array) -> dict[str, Array]:
    """As `filtered`, with the process noise as it is stated, not scaled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vision_filter, "SCALE_BOUNDS", (1.0, 1.0))
        return filtered(measured, displacement, start)


def textbook(
    measured: Array, displacement: Array, start: float, noise: float, wander: float
) -> dict[str, Array]:
    """The Kalman filter of one robot's axis in matrices: predict, then correct in Joseph's form."""
    f, h = np.array([[1, T], [0, np.exp(-T / DRIFT_TIME_S)]]), np.array([[1.0, 0.0]])
    x, p = np.array([start, 0.0]), np.diag([noise**2, 0.0])
    said = []
    for z, q in zip(measured, displacement, strict=True):
        x = f @ x + [q, 0]
        p = f @ p @ f.T + np.diag([(GAIN_ERROR * q) ** 2, wander**2 * T])
        normalised = np.nan
        if not np.isnan(z):
            s = (h @ p @ h.T + noise**2).item()
            k = p @ h.T / s
            normalised = (z - x[0]) / np.sqrt(s)
            x = x + k[:, 0] * (z - x[0])
            joseph = np.eye(2) - k @ h
            p = joseph @ p @ joseph.T + k @ k.T * noise**2
        said.append((x[0], q / T + x[1], x[1], np.sqrt(p[0, 0]), normalised))
    return dict(
        zip(
            ("pose", "twist", "drift", "sigma", "normalized_innovation"),
            np.array(said).T,
            strict=True,
        )
    )


@given(seeds, st.floats(0, 0.9))
def test_it_is_the_textbooks_kalman_filter(seed: int, missed: float) -> None:
    """With the process noise as it is stated: pose, twist, drift, sigma and innovations, gaps included, to 1e-9."""
    _, measured, displacement = simulate_drift(seed, 120, 2, missed=missed)
    start = np.zeros((2, 3))
    said = filtered_as_stated(measured, displacement, start)
    for axis in range(3):
        expected = textbook(
            measured[:, 1, axis], displacement[:, 1, axis], 0.0, NOISE[axis], DRIFT[axis]
        )
        for name, values in expected.items():
            np.testing.assert_allclose(
                said[name][:, 1, axis], values, rtol=1e-9, atol=1e-9, err_msg=name
            )


@given(seeds, st.floats(0, 0.9))
def test_a_perfect_robot_seen_perfectly_is_tracked_exactly(seed: int, missed: float) -> None:
    """What does as told surprises nobody: poses are the true ones, seen or not, the drift is nought."""
    rng = np.random.default_rng(seed)
    start, displacement = rng.uniform(-2, 2, (3, 3)), rng.uniform(-0.05, 0.05, (100, 3, 3))
    true = start + np.cumsum(displacement, axis=0)
    seen = np.where(rng.random((100, 3, 1)) < missed, np.nan, true)
    seen[..., 2] = np.angle(np.exp(1j * seen[..., 2]))
    said = filtered(seen, displacement, start)
    # Poses of size 3 and angles of size 7 round at 9e-16, a hundred times; a frame divides the
    # drift.
    np.testing.assert_allclose(said["pose"], true, rtol=0, atol=1e-12)
    np.testing.assert_allclose(said["twist"], displacement / T, rtol=0, atol=1e-11)


@given(st.floats(-np.pi, np.pi), st.floats(-20, 20))
def test_headings_are_followed_over_full_turns(heading: float, rate: float) -> None:
    """Vision reports angles in (-pi, pi]; the filtered heading is the one that an uncut angle would give."""
    turning = np.zeros((200, 1, 3))
    turning[:, 0, 2] = heading + rate * T * np.arange(200)
    reported = turning.copy()
    reported[..., 2] = np.angle(np.exp(1j * turning[..., 2]))
    # Commanded at 0.9 of the rate, as by a robot with alpha = 1.1: the rest is drift.
    displacement = np.broadcast_to([0, 0, 0.9 * rate * T], turning.shape)
    uncut = filtered(turning, displacement, turning[0])
    said = filtered(reported, displacement, turning[0])
    # Angles of up to 70 rad round at 1e-14, and so do the turns that are taken off them.
    np.testing.assert_allclose(said["pose"], uncut["pose"], rtol=0, atol=1e-12)
    # The 3 % that the drift forgets in a frame leave a small lag behind a robot that drifts at up
    # to 2 rad/s.
    np.testing.assert_allclose(said["pose"][-1, 0, 2], turning[-1, 0, 2], rtol=0, atol=0.03)


def test_a_row_of_a_batch_is_what_it_is_alone() -> None:
    """A robot's estimate does not depend, in its last bit, on the others, nor on whether they are seen."""
    _, measured, displacement = simulate_drift(3, 80, 9, missed=0.2)
    batch = filtered(measured, displacement, np.zeros((9, 3)))
    for i in range(9):
        alone = filtered(measured[:, i : i + 1], displacement[:, i : i + 1], np.zeros((1, 3)))
        for name, values in alone.items():
            np.testing.assert_array_equal(values[:, 0], batch[name][:, i])

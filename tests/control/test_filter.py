"""Laws of the Kalman filter of vision: a textbook's matrices, what it tracks exactly, and what makes no difference."""

import numpy as np
import pytest
from driven import DRIFT, DRIFT_TIME_S, GAIN_ERROR, NOISE, T, driven, filtered
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW

from omni_control.estimation import tracking as vision_filter
from omni_control.estimation.tracking import KalmanFilter
from omni_control.kinematics import Array

seeds = st.integers(0, 2**32 - 1)


def filtered_as_stated(measured: Array, displacement: Array, start: Array) -> dict[str, Array]:
    """As `filtered`, with the process noise as it is stated, not scaled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vision_filter, "SCALE_BOUNDS", (1.0, 1.0))
        return filtered(measured, displacement, start)


def textbook(measured: Array, displacement: Array, start: float, noise: float, wander: float) -> dict[str, Array]:
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
    return dict(zip(("pose", "twist", "drift", "sigma", "normalised"), np.array(said).T, strict=True))


@LAW
@given(seeds, st.floats(0, 0.9))
def test_it_is_the_textbooks_kalman_filter(seed: int, missed: float) -> None:
    """With the process noise as it is stated: pose, twist, drift, sigma and innovations, gaps included, to 1e-9."""
    _, measured, displacement = driven(seed, 120, 2, missed=missed)
    start = np.zeros((2, 3))
    said = filtered_as_stated(measured, displacement, start)
    for axis in range(3):
        expected = textbook(measured[:, 1, axis], displacement[:, 1, axis], 0.0, NOISE[axis], DRIFT[axis])
        for name, values in expected.items():
            np.testing.assert_allclose(said[name][:, 1, axis], values, rtol=1e-9, atol=1e-9, err_msg=name)


@LAW
@given(seeds, st.floats(0, 0.9))
def test_a_perfect_robot_seen_perfectly_is_tracked_exactly(seed: int, missed: float) -> None:
    """What does as told surprises nobody: poses are the true ones, seen or not, the drift is nought."""
    rng = np.random.default_rng(seed)
    start, displacement = rng.uniform(-2, 2, (3, 3)), rng.uniform(-0.05, 0.05, (100, 3, 3))
    true = start + np.cumsum(displacement, axis=0)
    seen = np.where(rng.random((100, 3, 1)) < missed, np.nan, true)
    seen[..., 2] = np.angle(np.exp(1j * seen[..., 2]))
    said = filtered(seen, displacement, start)
    # Poses of size 3 and angles of size 7 round at 9e-16, a hundred times; a frame divides the drift.
    np.testing.assert_allclose(said["pose"], true, rtol=0, atol=1e-12)
    np.testing.assert_allclose(said["twist"], displacement / T, rtol=0, atol=1e-11)


@LAW
@given(seeds, st.floats(0, 1))
def test_with_its_noise_fixed_the_filter_is_linear(seed: int, share: float) -> None:
    """The same mixture of two observations and starts gives that mixture of the two estimates."""
    rng = np.random.default_rng(seed)
    _, one, displacement = driven(seed, 60, 2)
    start = rng.uniform(-0.3, 0.3, (2, 2, 3))
    other = one + rng.normal(0, 0.1, one.shape)
    a, b = filtered_as_stated(one, displacement, start[0]), filtered_as_stated(other, displacement, start[1])
    mixed = filtered_as_stated(
        share * one + (1 - share) * other, displacement, share * start[0] + (1 - share) * start[1]
    )
    for name in ("pose", "drift"):
        # Headings never half a turn from what is seen, none is wrapped; numbers of size 3 in 60 steps.
        np.testing.assert_allclose(mixed[name], share * a[name] + (1 - share) * b[name], rtol=0, atol=1e-11)
    np.testing.assert_array_equal(mixed["sigma"], a["sigma"])


@LAW
@given(seeds, st.tuples(*[st.floats(-5, 5)] * 3))
def test_neither_the_origin_nor_the_sign_of_the_axes_matters(seed: int, offset: tuple[float, ...]) -> None:
    """Poses moved by a constant, or mirrored with their commands, give estimates moved or mirrored."""
    _, measured, displacement = driven(seed, 60, 2)
    start = measured[0] = np.zeros((2, 3))
    said = filtered(measured, displacement, start)
    mirrored = filtered(-measured, -displacement, -start)
    moved = measured + offset
    moved[..., 2] = np.angle(np.exp(1j * moved[..., 2]))
    moved_said = filtered(moved, displacement, start + offset)
    for name, sign in (("pose", -1), ("twist", -1), ("drift", -1), ("sigma", 1), ("normalised", -1)):
        np.testing.assert_array_equal(mirrored[name], sign * said[name])
        expected = said[name] + offset if name == "pose" else said[name]
        # Rounding of poses of size 5, over a frame for the twist, and over 1.3 mm for the normalised innovation.
        np.testing.assert_allclose(moved_said[name], expected, rtol=0, atol=1e-10, err_msg=name)


@LAW
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
    # The 3 % that the drift forgets in a frame leave a small lag behind a robot that drifts at up to 2 rad/s.
    np.testing.assert_allclose(said["pose"][-1, 0, 2], turning[-1, 0, 2], rtol=0, atol=0.03)


def test_a_robot_that_faces_backwards_does_not_spin() -> None:
    """Vision that flickers between +179 and -179 deg says 180 deg, not 0."""
    headings = np.radians([179.0, -179.0] * 200)
    measured = np.stack([0 * headings, 0 * headings, headings], axis=1)[:, None]
    said = filtered(measured, np.zeros_like(measured), np.array([[0, 0, np.pi]]))
    # One degree of flicker at half the frame rate is passed on at most as it is.
    assert np.abs(np.degrees(said["pose"][..., 2]) - 180).max() < 1
    assert abs(said["twist"][-100:, 0, 2].mean()) < np.radians(0.1)


def test_each_robots_each_axis_may_be_missed_by_itself() -> None:
    """What is seen of one axis says nothing of another: that alone is filtered, the others are carried on."""
    _, measured, displacement = driven(0, 80, 2, missed=0.0)
    partly = measured.copy()
    partly[40:, 0, 1] = np.nan
    whole, said = (filtered(m, displacement, measured[0]) for m in (measured, partly))
    seen = ~np.isnan(partly)
    for name in ("pose", "drift", "sigma", "normalised"):
        np.testing.assert_array_equal(said[name][:, 1], whole[name][:, 1])
        np.testing.assert_array_equal(said[name][:, 0, ::2], whole[name][:, 0, ::2])
    assert np.array_equal(np.isnan(said["normalised"]), ~seen)
    # Carried on: the commanded displacement, and the drift, which is forgotten.
    drift = said["drift"][39, 0, 1] * np.exp(-T / DRIFT_TIME_S * np.arange(40))
    path = said["pose"][39, 0, 1] + np.cumsum(displacement[40:, 0, 1] + T * drift)
    np.testing.assert_allclose(said["pose"][40:, 0, 1], path, rtol=0, atol=1e-13)


def test_a_row_of_a_batch_is_what_it_is_alone() -> None:
    """A robot's estimate does not depend, in its last bit, on the others, nor on whether they are seen."""
    _, measured, displacement = driven(3, 80, 9, missed=0.2)
    batch = filtered(measured, displacement, np.zeros((9, 3)))
    for i in range(9):
        alone = filtered(measured[:, i : i + 1], displacement[:, i : i + 1], np.zeros((1, 3)))
        for name, values in alone.items():
            np.testing.assert_array_equal(values[:, 0], batch[name][:, i])


def test_filter_and_caller_do_not_share_arrays() -> None:
    """The arrays given are not changed, and the caller may reuse that of the poses at the start."""
    start, measured, displacement = np.zeros((2, 3)), np.full((2, 3), 0.5), np.full((2, 3), 0.25)
    kalman = KalmanFilter(start, T, NOISE)
    start[:] = 9
    measured[1] = np.nan
    pose = kalman.update(measured, displacement)
    np.testing.assert_array_equal(pose[1], 0.25)
    assert (pose[0] < 0.5).all()
    np.testing.assert_array_equal(measured, [[0.5] * 3, [np.nan] * 3])
    np.testing.assert_array_equal(displacement, 0.25)

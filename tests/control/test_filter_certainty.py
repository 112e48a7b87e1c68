"""How sure the Kalman filter says it is of a pose, against how sure it can be."""

import numpy as np
import pytest
from driven import GAIN_ERROR, NOISE, T, driven, filtered
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW
from scipy.linalg import solve_discrete_are

from omni_control.estimation.tracking import KalmanFilter
from omni_control.kinematics import Array

ROBOTS, FRAMES, SETTLED = 200, 300, 100
GAP = slice(200, 210)  # ten frames: what hides a robot behind another's arm


@pytest.fixture(scope="module", params=[0.25, 1.0, 9.0])
def certainty(request: pytest.FixtureRequest) -> tuple[Array, Array]:
    """Innovations, and errors of the pose, over their standard deviations; of robots surer or less sure than stated."""
    true, measured, displacement = driven(1, FRAMES, ROBOTS, scale=request.param)
    said = filtered(measured, displacement, true[0] - displacement[0])
    return said["normalised"][SETTLED:], (said["pose"] - true)[SETTLED:] / said["sigma"][SETTLED:]


def test_innovations_and_errors_are_as_large_as_the_filter_says(certainty: tuple[Array, Array]) -> None:
    """Both average 1 when squared and divided by the variance stated, whatever the process noise of the plant is.

    40 000 innovations would be 1 to within 5 sqrt(2 / 40000) = 4 % if the filter knew the process noise. It estimates
    it from some 30 innovations of the robot, whose mean square is uncertain by sqrt(2 / 30) = 26 %; that costs some
    per cent, most where the process noise is far from what is stated.
    """
    for normalised in certainty:
        np.testing.assert_allclose(np.nanmean(normalised**2, (0, 1)), 1.0, atol=0.15)


def test_innovations_are_white(certainty: tuple[Array, Array]) -> None:
    """What is still to be learned from one innovation about the next is little: the filter has used it.

    40 000 products of white noise average to within 5 / sqrt(40000) = 0.025 of nought; a filter whose process noise is
    off by a fifth, as above, leaves a few hundredths more.
    """
    innovations, _ = certainty
    for lag in (1, 2, 5, 10):
        correlation = np.nanmean(innovations[lag:] * innovations[:-lag], (0, 1))
        np.testing.assert_allclose(correlation, 0.0, atol=0.1, err_msg=f"lag {lag}")


def test_in_a_gap_sigma_grows_as_the_error_does_and_then_returns() -> None:
    """Not seen for ten frames: sigma grows in each, covers the error in each, and is what it was soon after."""
    true, measured, displacement = driven(1, 300, 400, missed=0)
    measured[GAP] = np.nan
    said = filtered(measured, displacement, true[0] - displacement[0])
    sigma, error = said["sigma"], said["pose"] - true
    assert (np.diff(sigma[GAP.start - 1 : GAP.stop], axis=0) > 0).all()
    assert (sigma[GAP.stop - 1] > 2 * sigma[GAP.start - 1]).all()
    ratio = (error / sigma)[GAP] ** 2
    # The mean of 400 squares is uncertain by 5 sqrt(2 / 400) = 0.35; the ten frames are strongly related.
    np.testing.assert_allclose(ratio.mean((0, 1)), 1.0, atol=0.35)
    # The next pose seen leaves sigma no larger than vision's own; half a second later nothing is left of the gap.
    assert (sigma[GAP.stop] < np.array(NOISE)).all()
    before, after = sigma[GAP.start - 30 : GAP.start].mean((0, 1)), sigma[GAP.stop + 30 : GAP.stop + 60].mean((0, 1))
    np.testing.assert_allclose(after, before, rtol=0.05)  # as between any two half seconds, whose speeds differ


def test_the_steady_sigma_of_a_robot_at_rest_solves_riccatis_equation() -> None:
    """Without motion the error wanders with the drift alone; scipy's solution for the scale that the filter found."""
    kalman = KalmanFilter(np.zeros((1, 3)), T, NOISE)
    rng = np.random.default_rng(0)
    for _ in range(3000):
        kalman.update(np.array(NOISE) * rng.standard_normal((1, 3)), np.zeros((1, 3)))
    # At rest nothing wanders: the process noise is scaled down to its bound, 0.1.
    for axis, (noise, drift) in enumerate(zip(NOISE, (0.1, 0.1, 0.5), strict=True)):
        f, h = np.array([[1, T], [0, np.exp(-T / 0.5)]]), np.array([[1.0], [0.0]])
        prior = solve_discrete_are(f.T, h, np.diag([0.0, 0.1 * drift**2 * T]), [[noise**2]])
        expected = np.sqrt(prior[0, 0] * noise**2 / (prior[0, 0] + noise**2))
        assert kalman.sigma[0, axis] == pytest.approx(expected, rel=0.1)


@LAW
@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e3), st.floats(1e-6, 1.0))
def test_certainty_stays_within_what_is_possible(seed: int, size: float, speed: float) -> None:
    """Whatever vision reports: never less sure than the noise of vision, nor of one that moved at will.

    What is seen is known to the noise of vision at least. What is not seen for ten frames has wandered by no more than
    ten frames' process noise at the largest scale, 100, all of it adding up.
    """
    rng = np.random.default_rng(seed)
    displacement = rng.uniform(-speed * T, speed * T, (200, 3, 3))
    measured = rng.normal(0, size, (200, 3, 3))
    measured[150:160] = np.nan
    said = filtered(measured, displacement, np.zeros((3, 3)))
    assert all(np.isfinite(said[name]).all() for name in ("pose", "twist", "drift", "sigma"))
    assert (said["sigma"][:150] <= np.array(NOISE)).all()
    assert (said["sigma"] > 0).all()
    drift = np.sqrt(100 * 0.5 / 2) * np.array([0.1, 0.1, 0.5])  # standard deviation of the drift unobserved
    highest = np.array(NOISE) + 10 * 10 * GAIN_ERROR * speed * T + 10 * T * drift
    assert (said["sigma"] <= highest).all()

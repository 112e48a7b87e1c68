"""Laws of the vision filter: the steady state of a critically damped alpha-beta filter, in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_lyapunov

from omni_control.filter import PoseFilter
from omni_control.kinematics import Array

LAW = settings(deadline=None, max_examples=60, derandomize=True)

T = 1 / 60
SEEN = np.array([True])
# Up to 0.9 the transient k s^k has gone below 1e-13 after 350 frames.
STEADY = 350

smoothings = st.floats(0.05, 0.9)
triples = st.tuples(*[st.floats(-3, 3)] * 3)


def filtered(measured: Array, smoothing: float, start: Array | None = None) -> tuple[Array, Array]:
    """Poses and twists (frames, n, 3) after each of the measured poses (frames, n, 3), all valid."""
    vision = PoseFilter(measured[0] if start is None else start, T, smoothing)
    valid, poses, twists = np.ones(measured.shape[1], bool), [], []
    for pose in measured:
        poses.append(vision.update(pose, valid))
        twists.append(vision.twist)
    return np.array(poses), np.array(twists)


@LAW
@given(triples, triples, smoothings)
def test_constant_velocity_is_followed_without_lag(
    start: tuple[float, ...], twist: tuple[float, ...], smoothing: float
) -> None:
    """A filter of two integrators has no error for a ramp: pose and twist are those of the robot."""
    seconds = np.arange(STEADY)[:, None, None] * T
    truth = np.array([start]) + seconds * np.array([twist])
    poses, twists = filtered(truth, smoothing)
    # The rest of the transient: a start of 3 m/s times T times 350 * 0.9^350 is 2e-15; poses of 20 m round at 4e-15.
    np.testing.assert_allclose(poses[-1], truth[-1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(twists[-1, 0], twist, rtol=0, atol=1e-13 / T)


@LAW
@given(triples, smoothings)
def test_constant_acceleration_is_followed_with_the_known_lag(acceleration: tuple[float, ...], s: float) -> None:
    """The pose lags by a T^2 s^2 / (1 - s)^2 and the twist by a T ((1 + s) / (1 - s) - 1/2).

    In the steady state the twist gains a T a frame, which takes a surprise r = a T^2 / beta; of it the pose keeps
    (1 - alpha) r. The true pose moves (v + a T / 2) T a frame and the filtered one v_hat T + alpha r, the same while
    the lag is steady: v - v_hat = alpha r / T - a T / 2. Here alpha = 1 - s^2 and beta = (1 - s)^2.
    """
    a = np.array([acceleration])
    seconds = np.arange(STEADY)[:, None, None] * T
    poses, twists = filtered(a * seconds**2 / 2, s)
    pose_lag = a * seconds[-1] ** 2 / 2 - poses[-1]
    twist_lag = a * seconds[-1] - twists[-1]
    # Poses of up to 51 m round at 7e-15, accumulated over a memory of 20 frames; the transient is gone as above.
    np.testing.assert_allclose(pose_lag, a * T**2 * s**2 / (1 - s) ** 2, rtol=0, atol=5e-13)
    np.testing.assert_allclose(twist_lag, a * T * ((1 + s) / (1 - s) - 0.5), rtol=0, atol=5e-13 / T)


@LAW
@given(smoothings)
def test_a_jump_is_forgotten_with_a_double_pole_at_the_smoothing(s: float) -> None:
    """Critically damped: after a jump of 1 the error in frame k is s^(k+1) (s - k (1 - s)).

    It is (A + B k) s^k with A = s^2 left after the first frame and, as the twist overshoots, s^2 (2 s - 1) after the
    second.
    """
    poses, _ = filtered(np.ones((100, 1, 3)), s, start=np.zeros((1, 3)))
    k = np.arange(100)
    expected = s ** (k + 1) * (s - k * (1 - s))
    # Numbers of size 1, with roundings that die out as fast as the jump.
    np.testing.assert_allclose(1 - poses[:, 0], np.repeat(expected[:, None], 3, axis=1), rtol=0, atol=1e-14)


@LAW
@given(smoothings)
def test_white_noise_is_reduced_by_the_known_factors(s: float) -> None:
    """Variances per variance of vision: (1-s)(1+4s+5s^2)/(1+s)^3 for the pose, 2(1-s)^3/(1+s)^3/T^2 for the twist.

    These are those of the fading-memory filter of first degree (Morrison, 1969). The variance of a linear filter fed
    with white noise is the sum of the squares of its impulse response.
    """
    impulse = np.zeros((STEADY, 1, 3))
    impulse[0] = 1.0
    poses, twists = filtered(impulse, s, start=np.zeros((1, 3)))
    # What is cut off the sums is below 1e-20.
    pose_variance = (1 - s) * (1 + 4 * s + 5 * s**2) / (1 + s) ** 3
    twist_variance = 2 * (1 - s) ** 3 / (1 + s) ** 3 / T**2
    np.testing.assert_allclose((poses**2).sum((0, 1)), pose_variance, rtol=1e-12)
    np.testing.assert_allclose((twists**2).sum((0, 1)), twist_variance, rtol=1e-12)


def test_noise_of_many_robots_has_the_covariance_of_the_lyapunov_equation() -> None:
    """The ensemble's covariance P of pose and twist solves P = A P A' + K R K', with A = (I - K H) F."""
    # Noise small enough that no heading is ever surprised by half a turn.
    s, robots, sigma = 0.6, 20_000, 0.01
    noise = np.random.default_rng(0).normal(0, sigma, (60, robots, 3))
    poses, twists = filtered(noise, s, start=np.zeros((robots, 3)))
    gain = np.array([[1 - s**2], [(1 - s) ** 2 / T]])
    transition = (np.eye(2) - gain @ [[1, 0]]) @ [[1, T], [0, 1]]
    expected = solve_discrete_lyapunov(transition, sigma**2 * gain @ gain.T)
    covariance = np.cov(poses[-1].ravel(), twists[-1].ravel())
    # A variance from 60 000 samples is uncertain by sqrt(2 / 60000) = 0.6 %: five standard deviations.
    np.testing.assert_allclose(covariance, expected, rtol=0.03)


@LAW
@given(st.floats(-np.pi, np.pi), st.floats(-20, 20), smoothings)
def test_headings_are_followed_over_full_turns(heading: float, rate: float, smoothing: float) -> None:
    """Vision reports angles in (-pi, pi]; the filtered heading is the one that an uncut angle would give."""
    turning = np.zeros((STEADY, 1, 3))
    turning[:, 0, 2] = heading + rate * T * np.arange(STEADY)
    reported = turning.copy()
    reported[..., 2] = np.angle(np.exp(1j * turning[..., 2]))
    # 20 rad/s surprises a filter at rest by 1/3 rad in the first frames, never by half a turn, so none is lost.
    uncut, _ = filtered(turning, smoothing)
    poses, _ = filtered(reported, smoothing, start=turning[0])
    # Angles of up to 120 rad round at 1e-14, and so do the turns that are taken off them.
    np.testing.assert_allclose(poses, uncut, rtol=0, atol=1e-12)
    assert poses[-1, 0, 2] == pytest.approx(heading + rate * T * (STEADY - 1), abs=1e-12)


def test_a_robot_that_faces_backwards_does_not_spin() -> None:
    """Vision that flickers between +179 and -179 deg says 180 deg, not 0."""
    headings = np.radians([179.0, -179.0] * 200)
    measured = np.stack([0 * headings, 0 * headings, headings], axis=1)[:, None]
    poses, twists = filtered(measured, 0.8)
    # One degree of flicker at half the frame rate is passed on at most as it is.
    assert np.abs(np.degrees(poses[-100:, 0, 2]) - 180).max() < 1
    assert abs(twists[-100:, 0, 2].mean()) < np.radians(0.1)


@LAW
@given(triples, triples, smoothings, st.integers(1, 60))
def test_a_robot_not_seen_is_carried_on_at_its_twist(
    start: tuple[float, ...], twist: tuple[float, ...], smoothing: float, missed: int
) -> None:
    """While it is out of sight its pose moves by the last twist, whatever vision fills in, even not-a-number."""
    vision = PoseFilter(np.array([start]), T, smoothing)
    for k in range(40):
        vision.update(np.array([start]) + k * T * np.array([twist]), SEEN)
    pose, last = vision.pose.copy(), vision.twist.copy()
    for _ in range(missed):
        carried = vision.update(np.full((1, 3), np.nan), ~SEEN)
    # Sixty additions to poses of size 10.
    np.testing.assert_allclose(carried, pose + missed * T * last, rtol=0, atol=1e-12)
    assert np.array_equal(vision.twist, last)


def test_a_gap_at_constant_velocity_leaves_no_trace() -> None:
    """Carried on at the right twist, a robot is where vision sees it again: the steady state is not disturbed."""
    vision, twist = PoseFilter(np.zeros((1, 3)), T, 0.7), np.array([[2.0, -1.0, 3.0]])
    for k in range(STEADY):
        vision.update(k * T * twist, SEEN)
    for k in range(STEADY, STEADY + 30):
        pose = vision.update(k * T * twist, np.array([k >= STEADY + 20]))
        # Poses of 19 rad round at 4e-15; the transient of 0.7^350 is gone.
        np.testing.assert_allclose(pose, k * T * twist, rtol=0, atol=1e-12)


def test_a_row_of_a_batch_is_what_it_is_alone() -> None:
    """A robot's estimate does not depend, in its last bit, on the others, nor on whether they are seen."""
    rng = np.random.default_rng(0)
    measured, valid = rng.normal(size=(50, 9, 3)), rng.random((50, 9)) < 0.8

    def run(rows: slice) -> Array:
        vision = PoseFilter(measured[0, rows], T, 0.6)
        return np.array([vision.update(m[rows], v[rows]) for m, v in zip(measured, valid, strict=True)])

    batch = run(slice(None))
    assert all(np.array_equal(run(slice(i, i + 1))[:, 0], batch[:, i]) for i in range(9))


def test_filter_and_caller_do_not_share_arrays() -> None:
    """The measured poses are not changed, and the caller may reuse the array of the poses at the start."""
    start, measured = np.zeros((2, 3)), np.ones((2, 3))
    vision = PoseFilter(start, T, 0.5)
    start[:] = 9
    # s^2 = 1/4 of the jump is left; the second robot, not seen, stays where it started. Exact in binary.
    assert vision.update(measured, np.array([True, False])).tolist() == [[0.75] * 3, [0.0] * 3]
    assert (measured == 1).all()

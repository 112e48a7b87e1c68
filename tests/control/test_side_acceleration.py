"""Laws of references of robots that manage another acceleration aside than ahead: an ellipse about the body's axes."""

import math

import numpy as np
from benches.control import Array
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW
from routes import SNAP_M, T, paths, poses

from omni_control import CURVES, CurveReference, IteratedReference, MotionLimits, TimedReference

positive = st.floats(0.3, 6)
limits = st.builds(MotionLimits, st.floats(0.3, 4), positive, st.floats(1, 10), st.floats(3, 40), positive)
curves = st.builds(lambda name, *size: CURVES[name](*size), st.sampled_from(list(CURVES)), *[st.floats(0.5, 6)] * 2)


def share(change: Array, heading: Array, limit: MotionLimits) -> Array:
    """How much of what the body manages the accelerations (n, 2 or 3) ask at headings (n,): 1 is on the ellipse."""
    body = (change[:, 0] + 1j * change[:, 1]) * np.exp(-1j * heading)
    return np.hypot(body.real / limit.acceleration, body.imag / limit.side_acceleration)


def along(bearing: Array | float, limit: MotionLimits) -> Array:
    """Where a ray at `bearing` (rad, from the body's x axis) leaves the ellipse, by its equation, m/s^2."""
    x, y = np.cos(bearing) / limit.acceleration, np.sin(bearing) / limit.side_acceleration
    return 1 / np.sqrt(x**2 + y**2)


def fastest_time(distance: float, speed: float, acceleration: float) -> float:
    """Duration of the triangular or trapezoidal velocity profile from rest to rest, s."""
    if distance <= speed**2 / acceleration:
        return 2 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration


def assert_keeps(poses: Array, limit: MotionLimits, slack: float) -> None:
    """Speed and acceleration, by the differences of poses (frames, 3) and the heading of each, the ends included."""
    velocity = np.pad(np.diff(poses, axis=0) / T, ((1, 1), (0, 0)))
    acceleration = np.diff(velocity, axis=0) / T
    assert np.hypot(velocity[:, 0], velocity[:, 1]).max() <= limit.speed * (1 + slack) + 2 * SNAP_M / T
    assert np.abs(velocity[:, 2]).max() <= limit.turn_rate * (1 + slack) + 2 * SNAP_M / T
    assert np.abs(acceleration[:, 2]).max() <= limit.turn_acceleration * (1 + slack) + 4 * SNAP_M / T**2
    lowest = min(limit.acceleration, limit.side_acceleration or limit.acceleration)
    assert share(acceleration, poses[:, 2], limit).max() <= 1 + slack + 4 * SNAP_M / T**2 / lowest


# --- way-points ---


@LAW
@given(paths, limits, st.integers(0, 3))
def test_a_timed_reference_keeps_the_ellipse(path: list[tuple[float, ...]], limit: MotionLimits, dwell: int) -> None:
    """In every frame, in the body's axes of that frame, turning or not; but for the snap, a matter of rounding."""
    assert_keeps(TimedReference(path, limit, T, dwell).poses, limit, 1e-12)


@LAW
@given(poses, poses, limits)
def test_a_leg_without_a_turn_takes_the_closed_form_time_of_its_bearing(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits
) -> None:
    """The limit is that of the ellipse along the leg, no less."""
    distance = math.dist(start[:2], end[:2])
    bearing = math.atan2(end[1] - start[1], end[0] - start[0]) - start[2]
    frames = TimedReference([start, (*end[:2], start[2])], limit, T).frames - 1
    # As for one limit: one frame where the profile's speed lies between two units, one at rest.
    assert abs(frames - fastest_time(distance, limit.speed, float(along(bearing, limit))) / T) <= 2


@LAW
@given(paths, limits, st.integers(0, 2**32 - 1))
def test_an_iterated_reference_keeps_the_ellipse_for_a_disturbed_robot(
    path: list[tuple[float, ...]], limit: MotionLimits, seed: int
) -> None:
    """Wherever the robots turn out to be, and whichever way they turn out to face there."""
    rng = np.random.default_rng(seed)
    reference = IteratedReference(path, limit, T, n=3)
    pose, last = np.repeat([path[0]], 3, axis=0), np.zeros((3, 3))
    for frame in range(100):
        _, twist = reference.at(frame, pose)
        # Roundings of numbers of size 10, against steps of at least 0.3 T.
        assert share((twist - last) / T, pose[:, 2], limit).max() <= 1 + 1e-10
        assert np.hypot(twist[:, 0], twist[:, 1]).max() <= limit.speed + 1e-13
        last, pose = twist, pose + twist * T + rng.normal(0, 0.02, (3, 3))


# --- curves ---


@LAW
@given(curves, limits, st.integers(1, 2), st.booleans())
def test_a_curve_is_driven_within_the_ellipse(curve: object, limit: MotionLimits, laps: int, tangent: bool) -> None:
    """Facing ahead or along the path; second differences of poses of size 10 round at 1e-15 / T^2."""
    assert_keeps(CurveReference(curve, limit, T, laps, tangent).poses, limit, 1e-8)  # type: ignore[arg-type]


# --- the same in all directions ---

"""Way-points, curves and limits at random, and what all drives within limits have in common."""

import math

import numpy as np
from hypothesis import strategies as st

from omni_control import CURVES, MotionLimits
from omni_control.kinematics import Array

T = 1 / 60
SNAP_M = 1e-9  # a leg's last frame is put on the way-point from at most so far away, a change of velocity of 1e-9 / T


def micro(limit: float) -> st.SearchStrategy[float]:
    """Numbers on a grid of 1e-6, so that way-points coincide or are farther apart than a reference's snap."""
    return st.integers(-int(limit * 1e6), int(limit * 1e6)).map(lambda i: i / 1e6)


poses = st.tuples(micro(3), micro(3), micro(7))
paths = st.lists(poses, min_size=2, max_size=4)
positive = st.floats(0.3, 6)
highest = (st.floats(0.3, 4), positive, st.floats(1, 10), st.floats(3, 40), st.none() | positive)
limits = st.builds(MotionLimits, *highest)
smooth_limits = st.builds(MotionLimits, *highest, st.floats(2, 200), st.none() | st.floats(20, 2000))
curves = st.builds(lambda name, *size: CURVES[name](*size), st.sampled_from(list(CURVES)), *[st.floats(0.5, 6)] * 2)


def ellipse_share(change: Array, heading: Array, limit: MotionLimits) -> Array:
    """Return accelerations (n, 2 or 3) at headings (n,) over what the ellipse in the body's axes allows."""
    body = (change[:, 0] + 1j * change[:, 1]) * np.exp(-1j * heading)
    return np.hypot(body.real / limit.acceleration, body.imag / (limit.side_acceleration or limit.acceleration))


def assert_keeps(poses: Array, limit: MotionLimits, snap: float = 0.0) -> None:
    """Differences of poses (frames, 3), with rest before and after them, are within the limits."""
    velocity = np.pad(np.diff(poses, axis=0) / T, ((2, 2), (0, 0)))
    acceleration = np.diff(velocity, axis=0) / T
    jerk = np.diff(acceleration, axis=0) / T
    # Third differences of poses of size 10 round at 1e-15 / T^3 = 2e-10, against 2 m/s^3.
    close, steps = 1 + 1e-8, snap / T ** np.arange(1, 3)
    assert np.hypot(velocity[:, 0], velocity[:, 1]).max() <= limit.speed * close + 2 * steps[0]
    assert np.abs(velocity[:, 2]).max() <= limit.turn_rate * close + 2 * steps[0]
    lowest = min(limit.acceleration, limit.side_acceleration or limit.acceleration)
    share = ellipse_share(acceleration, np.pad(poses[:, 2], 1, mode="edge"), limit)
    assert share.max() <= close + 4 * steps[1] / lowest
    assert np.abs(acceleration[:, 2]).max() <= limit.turn_acceleration * close + 4 * steps[1]
    assert np.hypot(jerk[:, 0], jerk[:, 1]).max() <= (limit.jerk or np.inf) * close
    assert np.abs(jerk[:, 2]).max() <= (limit.turn_jerk or np.inf) * close


def fastest_time(distance: float, speed: float, acceleration: float) -> float:
    """Return the duration of the triangular or trapezoidal velocity profile from rest to rest, s."""
    if distance <= speed**2 / acceleration:
        return 2 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration

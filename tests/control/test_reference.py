"""Laws of the reference: limits kept, way-points met at rest, no slower than the closed-form fastest motion."""

import math
from itertools import pairwise

import numpy as np
import pytest
from benches.control import Array, OmniError
from hypothesis import given
from hypothesis import strategies as st
from laws import FEW, LAW
from routes import SNAP_M, T, is_led_past_every_way_point, paths, poses

from omni_control import IteratedReference, MotionLimits, TimedReference

LIMITS = MotionLimits()


limits = st.builds(MotionLimits, st.floats(0.3, 4), st.floats(0.3, 6), st.floats(1, 10), st.floats(3, 40))

SPEED_SLACK = 2 * SNAP_M / T
ACCELERATION_SLACK = 4 * SNAP_M / T**2


def lengths(rows: Array) -> Array:
    """Size of the translation and of the rotation of each row [x, y, heading], (frames, 2)."""
    return np.stack([np.hypot(rows[:, 0], rows[:, 1]), np.abs(rows[:, 2])], axis=1)


def velocities(positions: Array) -> Array:
    """Mean velocities of the frames, with rest before the first and after the last."""
    return np.pad(np.diff(positions, axis=0) / T, ((1, 1), (0, 0)))


def fastest_time(distance: float, speed: float, acceleration: float) -> float:
    """Duration of the triangular or trapezoidal velocity profile from rest to rest, s."""
    if distance <= speed**2 / acceleration:
        return 2 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration


@LAW
@given(paths, limits, st.integers(0, 5))
def test_a_timed_reference_keeps_its_limits(path: list[tuple[float, ...]], limit: MotionLimits, dwell: int) -> None:
    """Speed and acceleration, from the differences of the poses, never exceed the limits, at corners and ends too."""
    velocity = velocities(TimedReference(path, limit, T, dwell).poses)
    acceleration = np.diff(velocity, axis=0) / T
    assert (lengths(velocity) <= np.array([limit.speed, limit.turn_rate]) + SPEED_SLACK).all()
    top = np.array([limit.acceleration, limit.turn_acceleration])
    assert (lengths(acceleration) <= top + ACCELERATION_SLACK).all()


@LAW
@given(paths, limits, st.integers(0, 5), st.integers(0, 5))
def test_a_timed_reference_rests_on_every_way_point(
    path: list[tuple[float, ...]], limit: MotionLimits, dwell: int, settle: int
) -> None:
    """Every way-point is met exactly, in order, with one frame of rest and the dwell; the last also with settling."""
    reference = TimedReference(path, limit, T, dwell, settle)
    assert (reference.poses[0] == path[0]).all()
    frame = 0
    for previous, waypoint in pairwise(path):
        off = np.abs(reference.poses - waypoint).max(1)
        while off[frame] > SNAP_M:
            frame += 1
        # Arriving is one pose and the frame at rest another; who is there already does not arrive.
        arrival = int(np.abs(np.subtract(waypoint, previous)).max() > SNAP_M)
        assert off[frame : frame + arrival].max(initial=0) <= SNAP_M
        frame += arrival
        assert (off[frame : frame + dwell + 1] == 0).all()
        frame += dwell
    assert frame + settle + 1 == reference.frames
    assert (reference.poses[frame:] == path[-1]).all()


@LAW
@given(poses, poses, limits)
def test_a_leg_takes_the_closed_form_time(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits
) -> None:
    """From rest to rest, the slower of translation and heading needs its triangle or trapezoid, in whole frames."""
    distance, turn = math.dist(start[:2], end[:2]), abs(end[2] - start[2])
    fastest = max(
        fastest_time(distance, limit.speed, limit.acceleration),
        fastest_time(turn, limit.turn_rate, limit.turn_acceleration),
    )
    frames = TimedReference([start, end], limit, T).frames - 1
    # Whole frames: one may be lost where the profile's speed lies between two units, one is the frame at rest.
    assert abs(frames - fastest / T) <= 2


@LAW
@given(paths, limits, st.integers(0, 5))
def test_the_twist_of_a_timed_reference_integrates_to_its_poses(
    path: list[tuple[float, ...]], limit: MotionLimits, dwell: int
) -> None:
    """Starting on the first pose and obeying each frame's twist, one is on the reference in every frame."""
    reference = TimedReference(path, limit, T, dwell)
    anywhere = np.zeros((2, 3))
    targets, twists = zip(*[reference.at(k, anywhere) for k in range(reference.frames)], strict=True)
    travelled = np.array(path[0]) + np.cumsum(np.array(twists), axis=0) * T
    # A sum of up to 6000 twists, each rounded at 1e-15 T.
    np.testing.assert_allclose(travelled[:-1], np.array(targets)[1:], rtol=0, atol=1e-11)
    assert all(target.shape == twist.shape == (2, 3) for target, twist in zip(targets, twists, strict=True))


def test_no_way_points_are_refused() -> None:
    """A reference that is nowhere is the user's mistake."""
    with pytest.raises(OmniError, match="at least one way-point"):
        TimedReference([], LIMITS, T)


@FEW
@given(paths, limits)
def test_a_perfect_robot_is_led_past_every_way_point_to_rest_on_the_last(
    path: list[tuple[float, ...]], limit: MotionLimits
) -> None:
    """It passes within the arrival radius of each, in order, and ends on the last with nothing left to cover."""
    is_led_past_every_way_point(path, limit)


@LAW
@given(paths, limits, st.integers(0, 2**32 - 1))
def test_an_iterated_reference_keeps_its_limits_for_a_disturbed_robot(
    path: list[tuple[float, ...]], limit: MotionLimits, seed: int
) -> None:
    """Wherever the robots turn out to be, the twists of successive frames stay within speed and acceleration."""
    rng = np.random.default_rng(seed)
    reference = IteratedReference(path, limit, T, n=3)
    pose, last = np.repeat([path[0]], 3, axis=0), np.zeros((3, 3))
    top = np.array([limit.speed, limit.turn_rate])
    step = np.array([limit.acceleration, limit.turn_acceleration]) * T
    for frame in range(100):
        _, twist = reference.at(frame, pose)
        # Roundings of numbers of size 10.
        assert (lengths(twist) <= top + 1e-13).all()
        assert (lengths(twist - last) <= step + 1e-13).all()
        last, pose = twist, pose + twist * T + rng.normal(0, 0.02, (3, 3))


def test_limits_and_waypoints_that_cannot_be_are_refused() -> None:
    """A limit of zero would never arrive; a way-point that is not a number would be passed over."""
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(OmniError, match="positive"):
            MotionLimits(speed=bad)
    for points in ([], [[0, 0]], [[0, 0, np.nan]]):
        with pytest.raises(OmniError, match="way-point"):
            TimedReference(points, MotionLimits(), 1 / 60)
        with pytest.raises(OmniError, match="way-point"):
            IteratedReference(points, MotionLimits(), 1 / 60, 1)

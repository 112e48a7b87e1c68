"""Laws of the reference: limits kept, way-points met at rest, no slower than the closed-form fastest motion."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from laws import FEW, LAW
from routes import SNAP_M, T, is_led_past_every_way_point, paths, poses

from omni_control import IteratedReference, MotionLimits, TimedReference
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference import drives

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


@FEW
@given(paths, limits, st.integers(0, 5))
def test_every_lap_of_a_closed_way_is_the_same(path: list[tuple[float, ...]], limit: MotionLimits, dwell: int) -> None:
    """At rest on a way-point nothing of the way there is left: further laps repeat the first bit for bit."""
    once = TimedReference([*path, path[0]], limit, T, dwell).poses
    laps = TimedReference([*path * 3, path[0]], limit, T, dwell).poses
    assert len(laps) == 3 * (len(once) - 1) + 1
    assert np.array_equal(laps[1:].reshape(3, -1, 3), np.broadcast_to(once[1:], (3, len(once) - 1, 3)))


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
@given(poses, poses, limits)
def test_a_leg_is_straight_and_never_turns_back(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits
) -> None:
    """The point stays on the segment between the way-points and its way along it only grows: no overshoot."""
    reference = TimedReference([start, end], limit, T)
    z = reference.poses[:, 0] + 1j * reference.poses[:, 1]
    leg = complex(*end[:2]) - complex(*start[:2])
    if abs(leg) > 1e-6:
        along = (z - z[0]) * np.conj(leg) / abs(leg)
        # Up to 1500 frames each round at 4e-16; the snap is 1e-9.
        assert np.abs(along.imag).max() < 2 * SNAP_M
        assert np.diff(along.real).min() > -2 * SNAP_M
        assert along.real.max() < abs(leg) + 2 * SNAP_M
    assert (np.diff(reference.poses[:, 2]) * np.sign(end[2] - start[2]) > -2 * SNAP_M).all()


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


def test_after_its_end_a_timed_reference_stands_still() -> None:
    """Asked for a frame after the last, as a controller that looks k_d frames ahead does, it rests on the end."""
    reference = TimedReference([[0, 0, 0], [0.3, -0.2, 1]], LIMITS, T)
    for frame in (reference.frames - 1, reference.frames, reference.frames + 100):
        target, twist = reference.at(frame, np.zeros((1, 3)))
        assert target.tolist() == [[0.3, -0.2, 1]]
        assert twist.tolist() == [[0, 0, 0]]


def test_a_timed_reference_ignores_where_the_robot_is() -> None:
    """Known in advance: the same frame gives the same answer to robots at different poses."""
    reference = TimedReference([[0, 0, 0], [1, 1, 1]], LIMITS, T)
    target, twist = reference.at(17, np.random.default_rng(0).normal(size=(3, 3)))
    assert (target == target[0]).all()
    assert (twist == twist[0]).all()


def test_one_way_point_is_a_reference_at_rest() -> None:
    """There is nowhere to go: one frame and the settling, all on the way-point."""
    assert TimedReference([[1, 2, 3]], LIMITS, T, settle_frames=4).poses.tolist() == [[1, 2, 3]] * 5


def test_no_way_points_are_refused() -> None:
    """A reference that is nowhere is the user's mistake."""
    with pytest.raises(OmniError, match="at least one way-point"):
        TimedReference([], LIMITS, T)


@LAW
@given(poses, poses, limits)
def test_a_perfect_robot_is_led_along_the_timed_path(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits
) -> None:
    """Planned anew each frame from a robot that is where it was expected, the plan of one leg does not change."""
    timed = TimedReference([start, end], limit, T)
    iterated = IteratedReference([start, end], limit, T, n=1)
    pose = np.array([start])
    for frame in range(timed.frames):
        here, twist = iterated.at(frame, pose)
        # The last frame of the timed path is put on the way-point from within the snap.
        assert np.abs(here - timed.poses[frame]).max() <= SNAP_M
        pose = pose + twist * T


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


def test_a_disturbed_robot_is_compared_with_where_it_was_led() -> None:
    """The reference of a frame is the last pose moved on by the last twist: what disturbed the robot is the error."""
    reference = IteratedReference([[0, 0, 0], [1, -1, 2]], LIMITS, T, n=2)
    rng = np.random.default_rng(0)
    pose = np.zeros((2, 3))
    expected = pose
    for frame in range(50):
        here, twist = reference.at(frame, pose)
        # One product and one sum of numbers of size 1.
        np.testing.assert_allclose(here, expected, rtol=0, atol=1e-15)
        expected = pose + twist * T
        pose = expected + rng.normal(0, 0.01, (2, 3))


def test_robots_of_an_iterated_reference_do_not_know_each_other() -> None:
    """Each has its own progress: a row in a batch is bit for bit the row alone."""
    path = [[0.0, 0.0, 0.0], [1.0, 0.5, 1.0], [0.2, 1.0, -1.0], [0.0, 0.0, 0.0]]
    noise = np.random.default_rng(0).normal(0, 0.01, (300, 5, 3))

    def run(rows: slice) -> Array:
        reference = IteratedReference(path, LIMITS, T, n=noise[:, rows].shape[1])
        pose, out = noise[0, rows], []
        for frame, kick in enumerate(noise[:, rows]):
            here, twist = reference.at(frame, pose)
            out.append(np.concatenate([here, twist], axis=1))
            pose = pose + twist * T + kick
        return np.array(out)

    batch = run(slice(None))
    assert all(np.array_equal(run(slice(i, i + 1))[:, 0], batch[:, i]) for i in range(5))


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


@LAW
@given(st.lists(st.tuples(paths, limits), min_size=2, max_size=4), st.floats(0.5, 2))
def test_planned_together_each_is_as_alone(ways: list[tuple[list[tuple[float, ...]], MotionLimits]], f: float) -> None:
    """To the bit; the first way also at another speed, which is planned beside it."""
    (path, limit), *_ = ways
    tasks = [(path, limit, 0, 1) for path, limit in [*ways, (path, replace(limit, speed=f * limit.speed))]]
    for task, found in zip(tasks, drives(tasks, T), strict=True):
        np.testing.assert_array_equal(found, TimedReference(*task[:2], T, *task[2:]).poses)

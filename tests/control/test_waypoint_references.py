"""References through way-points: limits kept, way-points met at rest, as fast as possible."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from benches.control import ARRIVAL_RADIUS_M, OmniError
from hypothesis import given, settings
from hypothesis import strategies as st
from random_motion import (
    SNAP_M,
    TIGERS,
    T,
    assert_keeps,
    compute_ellipse_utilization,
    compute_fastest_time,
    compute_peak_turn_jerk,
    limits,
    paths,
    poses,
    smooth_limits,
)
from ruckig import InputParameter, Ruckig, Trajectory

from omni_control import IteratedReference, MotionLimits, TimedReference

Path = list[tuple[float, ...]]


# --- known in advance ---


@given(paths, limits | smooth_limits, st.integers(0, 5))
def test_a_timed_reference_keeps_its_limits(path: Path, limit: MotionLimits, dwell: int) -> None:
    """Differences of poses keep them, at corners and ends too, in the body's axes of each frame."""
    assert_keeps(TimedReference(path, limit, T, dwell).poses, limit, 0.0 if limit.jerk else SNAP_M)


@given(paths, limits, st.integers(0, 5), st.integers(0, 5))
def test_a_timed_reference_rests_on_every_way_point(
    path: Path, limit: MotionLimits, dwell: int, settle: int
) -> None:
    """Every way-point is met exactly, with a frame of rest and the dwell; the last also settles.

    A robot that starts on the first pose and follows the twists is on the reference in every frame.
    """
    reference = TimedReference(path, limit, T, dwell).with_rest(0, settle)
    assert (reference.poses[0] == path[0]).all()
    frame = 0
    for previous, waypoint in pairwise(path):
        off = np.abs(reference.poses - waypoint).max(1)
        while off[frame] > SNAP_M:
            frame += 1
        # Arrival is one pose, and the frame of rest another. A repeated way-point has no arrival.
        arrival = int(np.abs(np.subtract(waypoint, previous)).max() > SNAP_M)
        assert off[frame : frame + arrival].max(initial=0) <= SNAP_M
        frame += arrival
        assert (off[frame : frame + dwell + 1] == 0).all()
        frame += dwell
    assert frame + settle + 1 == reference.frames
    assert (reference.poses[frame:] == path[-1]).all()
    twists = [reference.at(k, np.zeros((1, 3)))[1][0] for k in range(reference.frames)]
    followed = np.array(path[0]) + np.cumsum(twists, axis=0) * T
    # A sum of up to 6000 twists, each rounded at 1e-15 T.
    np.testing.assert_allclose(followed[:-1], reference.poses[1:], rtol=0, atol=1e-11)


@given(poses, poses, limits)
def test_a_segment_takes_the_closed_form_time(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits
) -> None:
    """The slower of translation and heading takes its triangle or trapezoid, in whole frames.

    If the limits are an ellipse and the robot does not turn, the acceleration is that of the
    ellipse along the segment.
    """
    end = end if limit.side_acceleration is None else (*end[:2], start[2])
    bearing = math.atan2(end[1] - start[1], end[0] - start[0])
    direction = np.array([[math.cos(bearing), math.sin(bearing)]])
    acceleration = 1 / float(compute_ellipse_utilization(direction, np.array(start[2:]), limit)[0])
    fastest = max(
        compute_fastest_time(math.dist(start[:2], end[:2]), limit.speed, acceleration),
        compute_fastest_time(abs(end[2] - start[2]), limit.turn_rate, limit.turn_acceleration),
    )
    frames = TimedReference([start, end], limit, T).frames - 1
    # One frame may be lost if the profile's speed lies between two units. Another is the frame of
    # rest.
    assert abs(frames - fastest / T) <= 2


@given(poses, poses, smooth_limits, st.floats(20, 2000))
def test_a_segment_with_limited_jerk_takes_ruckigs_time(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits, turn_jerk: float
) -> None:
    """A straight segment is one axis of ruckig, and its heading another that arrives with it."""
    limit = replace(limit, turn_jerk=turn_jerk, side_acceleration=None)
    axes, trajectory = InputParameter(2), Trajectory(2)
    axes.target_position = [math.dist(start[:2], end[:2]), abs(end[2] - start[2])]
    axes.max_velocity = [limit.speed, limit.turn_rate]
    axes.max_acceleration = [limit.acceleration, limit.turn_acceleration]
    axes.max_jerk = [limit.jerk or 0, turn_jerk]
    Ruckig(2).calculate(axes, trajectory)
    frames = TimedReference([start, end], limit, T).frames - 1
    # Never less, but for the snap. Three durations are rounded up to whole frames: by up to 2.2
    # frames in 300 segments.
    assert trajectory.duration / T - 1e-3 <= frames <= trajectory.duration / T + 3


@given(st.floats(0.1, 3), st.floats(10, 500), st.booleans())
def test_a_turn_whose_jerk_alone_is_limited_keeps_it(
    turn: float, turn_jerk: float, has_wheels: bool
) -> None:
    """Speeding up, braking and at the ends, with and without wheels that slow it down.

    The fastest turn takes the time (32 angle / jerk)^(1/3), if nothing else limits it.
    """
    wheels = replace(TIGERS, max_rim_speed=0.2) if has_wheels else None
    limit = MotionLimits(1.0, 100.0, 5.0, 1000.0, turn_jerk=turn_jerk, wheels=wheels)
    reference = TimedReference([(0, 0, 0), (0.05, 0, turn)], limit, T)
    assert compute_peak_turn_jerk(reference.poses) <= turn_jerk * (1 + 1e-6)
    assert (reference.frames - 1) * T >= math.cbrt(32 * turn / turn_jerk) - 1e-3


# --- iterated ---


@settings(max_examples=12)
@given(paths, limits)
def test_a_perfect_robot_passes_every_way_point_and_rests_on_the_last(
    path: Path, limit: MotionLimits
) -> None:
    """It passes within the arrival radius of each, in order, and ends exactly on the last."""
    timed, iterated = TimedReference(path, limit, T), IteratedReference(path, limit, T, n=1)
    pose, reached, twist = np.array([path[0]]), 0, np.zeros((1, 3))
    weakest = min(limit.acceleration, limit.side_acceleration or limit.acceleration)
    # It may overrun a way-point at full speed, which takes once more the time to stop.
    overrun = limit.speed / weakest + limit.turn_rate / limit.turn_acceleration
    for frame in range(timed.frames + len(path) * math.ceil(overrun / T)):
        _, twist = iterated.at(frame, pose)
        if reached < len(path) and np.hypot(*(pose[0] - path[reached])[:2]) < ARRIVAL_RADIUS_M:
            reached += 1
        pose = pose + twist * T
    assert reached == len(path)
    # The last step covers the remaining distance exactly, to the rounding of poses of size 7.
    np.testing.assert_allclose(pose[0], path[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(twist, 0, atol=1e-12 / T)


@given(paths, limits, st.integers(0, 2**32 - 1))
def test_an_iterated_reference_keeps_its_limits_for_a_disturbed_robot(
    path: Path, limit: MotionLimits, seed: int
) -> None:
    """At any position and heading."""
    rng = np.random.default_rng(seed)
    reference = IteratedReference(path, limit, T, n=3)
    pose, last_twist = np.repeat([path[0]], 3, axis=0), np.zeros((3, 3))
    for frame in range(60):
        _, twist = reference.at(frame, pose)
        # Roundings of numbers of size 10, against steps of at least 0.3 T.
        assert np.hypot(twist[:, 0], twist[:, 1]).max() <= limit.speed + 1e-13
        assert np.abs(twist[:, 2]).max() <= limit.turn_rate + 1e-13
        assert (
            compute_ellipse_utilization((twist - last_twist) / T, pose[:, 2], limit).max()
            <= 1 + 1e-10
        )
        assert np.abs(twist - last_twist)[:, 2].max() <= limit.turn_acceleration * T + 1e-13
        last_twist, pose = twist, pose + twist * T + rng.normal(0, 0.02, (3, 3))


# --- invalid input ---


@pytest.mark.parametrize("points", [[], [[0, 0]], [[0, 0, np.nan]]])
@pytest.mark.parametrize("make", [TimedReference, lambda *args: IteratedReference(*args, n=1)])
def test_invalid_way_points_are_refused(
    make: Callable[..., object], points: list[list[float]]
) -> None:
    with pytest.raises(OmniError, match="way-point"):
        make(points, MotionLimits(), T)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_invalid_limits_are_refused(bad: float) -> None:
    with pytest.raises(OmniError, match="positive"):
        MotionLimits(speed=bad)


@pytest.mark.parametrize("limit", [MotionLimits(jerk=5.0), MotionLimits(turn_jerk=5.0)])
def test_an_iterated_reference_refuses_a_limit_of_jerk(limit: MotionLimits) -> None:
    with pytest.raises(OmniError, match="cannot limit jerk"):
        IteratedReference([[0, 0, 0], [1, 0, 0]], limit, T, n=1)

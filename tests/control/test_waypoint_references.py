"""Laws of references through way-points: limits kept, way-points met at rest, as fast as can be."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from benches.control import OmniError
from hypothesis import given, settings
from hypothesis import strategies as st
from random_motion import (
    SNAP_M,
    T,
    assert_keeps,
    compute_ellipse_utilization,
    compute_fastest_time,
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
    """By the differences of the poses, at corners and ends too, in the body's axes of each frame."""
    assert_keeps(TimedReference(path, limit, T, dwell).poses, limit, 0.0 if limit.jerk else SNAP_M)


@given(paths, limits, st.integers(0, 5), st.integers(0, 5))
def test_a_timed_reference_rests_on_every_way_point(
    path: Path, limit: MotionLimits, dwell: int, settle: int
) -> None:
    """Every way-point is met exactly, in order, with one frame of rest and the dwell; the last also with settling.

    Who starts on the first pose and obeys each frame's twist is on the reference in every frame.
    """
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
    twists = [reference.at(k, np.zeros((1, 3)))[1][0] for k in range(reference.frames)]
    travelled = np.array(path[0]) + np.cumsum(twists, axis=0) * T
    # A sum of up to 6000 twists, each rounded at 1e-15 T.
    np.testing.assert_allclose(travelled[:-1], reference.poses[1:], rtol=0, atol=1e-11)


@given(poses, poses, limits)
def test_a_leg_takes_the_closed_form_time(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits
) -> None:
    """From rest to rest, the slower of translation and heading needs its triangle or trapezoid, in whole frames.

    Where the limits are an ellipse and the robot does not turn, the acceleration is that of the
    ellipse along the leg.
    """
    end = end if limit.side_acceleration is None else (*end[:2], start[2])
    bearing = math.atan2(end[1] - start[1], end[0] - start[0])
    ahead = np.array([[math.cos(bearing), math.sin(bearing)]])
    acceleration = 1 / float(compute_ellipse_utilization(ahead, np.array(start[2:]), limit)[0])
    fastest = max(
        compute_fastest_time(math.dist(start[:2], end[:2]), limit.speed, acceleration),
        compute_fastest_time(abs(end[2] - start[2]), limit.turn_rate, limit.turn_acceleration),
    )
    frames = TimedReference([start, end], limit, T).frames - 1
    # Whole frames: one may be lost where the profile's speed lies between two units, one is the
    # frame at rest.
    assert abs(frames - fastest / T) <= 2


@given(poses, poses, smooth_limits, st.floats(20, 2000))
def test_a_leg_with_limited_jerk_takes_ruckigs_time(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits, turn_jerk: float
) -> None:
    """Along a straight line vectors are numbers, and so a leg is one axis, its heading another that has to be there."""
    limit = replace(limit, turn_jerk=turn_jerk, side_acceleration=None)
    axes, trajectory = InputParameter(2), Trajectory(2)
    axes.target_position = [math.dist(start[:2], end[:2]), abs(end[2] - start[2])]
    axes.max_velocity = [limit.speed, limit.turn_rate]
    axes.max_acceleration = [limit.acceleration, limit.turn_acceleration]
    axes.max_jerk = [limit.jerk or 0, turn_jerk]
    Ruckig(2).calculate(axes, trajectory)
    frames = TimedReference([start, end], limit, T).frames - 1
    # Never less, but for the snap. Three lengths are rounded up to whole frames, each by less than
    # one, and not all three are as unlucky: up to 2.2 were found in 300 legs. Without a way to go,
    # no frame is spent.
    assert trajectory.duration / T - 1e-3 <= frames <= trajectory.duration / T + 3


# --- planned anew in every frame ---


@settings(max_examples=12)
@given(paths, limits)
def test_a_perfect_robot_is_led_past_every_way_point_to_rest_on_the_last(
    path: Path, limit: MotionLimits
) -> None:
    """It passes within the arrival radius of each, in order, and ends on the last with nothing left to cover."""
    timed, iterated = TimedReference(path, limit, T), IteratedReference(path, limit, T, n=1)
    pose, reached, twist = np.array([path[0]]), 0, np.zeros((1, 3))
    weakest = min(limit.acceleration, limit.side_acceleration or limit.acceleration)
    # It need not stop at a way-point, but may overrun one at speed: per way-point, once more the
    # time to stop.
    overrun = limit.speed / weakest + limit.turn_rate / limit.turn_acceleration
    for frame in range(timed.frames + len(path) * math.ceil(overrun / T)):
        _, twist = iterated.at(frame, pose)
        if (
            reached < len(path)
            and np.hypot(*(pose[0] - path[reached])[:2]) < iterated.arrival_radius
        ):
            reached += 1
        pose = pose + twist * T
    assert reached == len(path)
    # The last step before rest covers what is left exactly, to the rounding of poses of size 7.
    np.testing.assert_allclose(pose[0], path[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(twist, 0, atol=1e-12 / T)


@given(paths, limits, st.integers(0, 2**32 - 1))
def test_an_iterated_reference_keeps_its_limits_for_a_disturbed_robot(
    path: Path, limit: MotionLimits, seed: int
) -> None:
    """Wherever the robots turn out to be, and whichever direction they turn out to face there."""
    rng = np.random.default_rng(seed)
    reference = IteratedReference(path, limit, T, n=3)
    pose, last = np.repeat([path[0]], 3, axis=0), np.zeros((3, 3))
    for frame in range(60):
        _, twist = reference.at(frame, pose)
        # Roundings of numbers of size 10, against steps of at least 0.3 T.
        assert np.hypot(twist[:, 0], twist[:, 1]).max() <= limit.speed + 1e-13
        assert np.abs(twist[:, 2]).max() <= limit.turn_rate + 1e-13
        assert compute_ellipse_utilization((twist - last) / T, pose[:, 2], limit).max() <= 1 + 1e-10
        assert np.abs(twist - last)[:, 2].max() <= limit.turn_acceleration * T + 1e-13
        last, pose = twist, pose + twist * T + rng.normal(0, 0.02, (3, 3))


# --- what cannot be ---


@pytest.mark.parametrize("points", [[], [[0, 0]], [[0, 0, np.nan]]])
@pytest.mark.parametrize("kind", [TimedReference, lambda *known: IteratedReference(*known, n=1)])
def test_way_points_that_cannot_be_are_refused(
    kind: Callable[..., object], points: list[list[float]]
) -> None:
    with pytest.raises(OmniError, match="way-point"):
        kind(points, MotionLimits(), T)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_limits_that_cannot_be_are_refused(bad: float) -> None:
    with pytest.raises(OmniError, match="positive"):
        MotionLimits(speed=bad)


@pytest.mark.parametrize("limit", [MotionLimits(jerk=5.0), MotionLimits(turn_jerk=5.0)])
def test_a_reference_planned_anew_refuses_a_limit_of_jerk(limit: MotionLimits) -> None:
    with pytest.raises(OmniError, match="cannot limit jerk"):
        IteratedReference([[0, 0, 0], [1, 0, 0]], limit, T, n=1)

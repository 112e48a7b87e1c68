"""Laws of references of robots that manage another acceleration aside than ahead: an ellipse about the body's axes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from laws import FEW, LAW
from routes import SNAP_M, T, is_led_past_every_way_point, paths, poses

from omni_control import CURVES, CurveReference, IteratedReference, MotionLimits, TimedReference
from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_control.reference.limits import approach_pose, stopping_speed

positive = st.floats(0.3, 6)
limits = st.builds(MotionLimits, st.floats(0.3, 4), positive, st.floats(1, 10), st.floats(3, 40), positive)
velocities = st.tuples(*[st.floats(-3, 3)] * 2, st.floats(-6, 6))
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
@given(poses, poses, limits)
def test_a_turning_leg_takes_no_longer_than_at_its_weakest_heading(
    start: tuple[float, ...], end: tuple[float, ...], limit: MotionLimits
) -> None:
    """And no less than if the robot were as strong all the way as in its best direction."""
    distance, turn = math.dist(start[:2], end[:2]), abs(end[2] - start[2])
    bearings = math.atan2(end[1] - start[1], end[0] - start[0]) - np.linspace(start[2], end[2], 2000)
    turning = fastest_time(turn, limit.turn_rate, limit.turn_acceleration)
    slowest, quickest = (
        max(turning, fastest_time(distance, limit.speed, acceleration)) / T
        for acceleration in (float(along(bearings, limit).min()), max(limit.acceleration, limit.side_acceleration))
    )
    # Two frames as above.
    assert quickest - 2 <= TimedReference([start, end], limit, T).frames - 1 <= slowest + 2


@LAW
@given(poses, poses, st.floats(0.5, 4), st.floats(0.5, 1), st.floats(0.3, 4))
def test_a_turning_leg_is_hardly_slower_than_can_be(
    start: tuple[float, ...], end: tuple[float, ...], ahead: float, ratio: float, speed: float
) -> None:
    """Straight there, turning as it does: speeds are up to what all frames before add, and all after can brake.

    Braking is planned with the lowest limit of the headings to come. Of 750 legs with limits from 1 : 2 to 1 : 1 that
    cost 0.1 % of the time in the mean and 4.8 % at most.
    """
    limit = MotionLimits(speed, ahead, side_acceleration=ratio * ahead)
    reference = TimedReference([start, end], limit, T)
    turning = TimedReference([(0, 0, start[2]), (0, 0, end[2])], limit, T).frames
    frames = math.floor((reference.frames - 1) * 0.95) - 2
    bearing = math.atan2(end[1] - start[1], end[0] - start[0])
    gained = along(bearing - reference.poses[: max(frames, 0), 2], limit) * T
    speeds = np.minimum(np.cumsum(gained)[:-1], np.cumsum(gained[::-1])[-2::-1])
    assert frames < turning or np.minimum(speed, speeds).sum() * T < math.dist(start[:2], end[:2])


@LAW
@given(poses, st.floats(-14, 14), limits)
def test_the_limit_on_the_way_is_the_lowest_of_all_headings_to_come(
    offset: tuple[float, ...], turn: float, limit: MotionLimits
) -> None:
    heading, later = np.array([offset[2]]), np.array([offset[2] + turn])
    bearings = math.atan2(offset[1], offset[0]) - np.linspace(heading, later, 20001)
    found = limit.on_the_way(np.array([offset[:2]]), heading, later)
    # Headings are 7e-4 rad apart, axes at most 20 to 1: half the step, squared, times 20^2 / 2.
    assert found == pytest.approx(along(bearings, limit).min(), rel=1e-4)


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


@FEW
@given(paths, limits)
def test_a_perfect_robot_is_led_past_every_way_point_to_rest_on_the_last(
    path: list[tuple[float, ...]], limit: MotionLimits
) -> None:
    """Planned anew in each frame as well, with what is left of a corner to brake in another direction."""
    is_led_past_every_way_point(path, limit)


@LAW
@given(st.floats(0, 2 * np.pi), st.floats(-7, 7), st.floats(0, 3), st.floats(-1, 1), limits)
def test_what_leads_past_the_set_point_gets_its_share_of_the_ellipse(
    bearing: float, heading: float, sideways: float, ahead: float, limit: MotionLimits
) -> None:
    """Speeding up asks for H of it at most, braking what leads past for G: at least 1 / (H + G) of that goes.

    Whatever the axes: of a sum of two vectors, no more of the ellipse is asked than of both together. H is how much
    farther onwards than along the ray itself the ellipse reaches, 1 on its axes and, by the inequality of Kantorovich,
    at most half the sum of its axes' ratio and the inverse of that.
    """
    onward, across = np.array([math.cos(bearing), math.sin(bearing)]), np.array([-math.sin(bearing), math.cos(bearing)])
    twist = np.array([[*(ahead * onward + sideways * across), 0.0]])
    free = MotionLimits(100.0, limit.acceleration, side_acceleration=limit.side_acceleration)
    pose = np.array([[0.0, 0.0, heading]])
    after = approach_pose(pose, twist, np.array([[*(1e3 * onward), heading]]), free, T)[0, :2]
    asked = sideways / (T * float(along(bearing + math.pi / 2 - heading, limit)))
    ratio = limit.acceleration / limit.side_acceleration
    farther = (ratio + 1 / ratio) / 2
    # Velocities of size 3 round at 4e-16, and directions of that size too.
    assert -1e-12 <= after @ across <= sideways * (1 - 1 / (farther + asked)) + 1e-12
    assert after @ onward > ahead


@LAW
@given(poses, velocities, poses, limits, st.floats(-7, 7))
def test_nothing_but_the_body_gives_directions(
    pose: tuple[float, ...],
    twist: tuple[float, ...],
    target: tuple[float, ...],
    limit: MotionLimits,
    angle: float,
) -> None:
    """In a world turned by an angle, robot and goal with it, the same is done in the turned direction."""
    c, s = math.cos(angle), math.sin(angle)
    turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    there = np.array([0, 0, angle])
    one = approach_pose(np.array([pose]), np.array([twist]), np.array([target]), limit, T)
    other = approach_pose(
        (turned @ pose + there)[None], (turned @ twist)[None], (turned @ target + there)[None], limit, T
    )
    # A stopping speed near a goal is distance / T, whose rounding is 60 times that of poses of size 5.
    np.testing.assert_allclose(other, one @ turned.T, rtol=0, atol=1e-11)


@LAW
@given(poses, st.tuples(*[st.floats(-1, 1)] * 2), st.floats(0, 2 * np.pi), st.floats(0, 1e-15), limits)
def test_who_can_stop_here_does(
    pose: tuple[float, ...], velocity: tuple[float, float], bearing: float, off: float, limit: MotionLimits
) -> None:
    """Within the ellipse of a frame of rest, at the goal but for a rounding error in any direction, it is at rest."""
    twist = np.array([[*velocity, 0.0]])
    twist *= T / max(1.0, float(share(twist, np.array([pose[2]]), limit)[0]))
    offset = off * np.array([math.cos(bearing), math.sin(bearing)])
    here, goal = np.array([[0.0, 0.0, pose[2]]]), np.array([[*offset, pose[2]]])
    after = approach_pose(here, twist, goal, limit, T)
    # What is left leads over the offset in a frame, for which the change is shortened by as much, in shares of a limit
    # of which the axes are at most 20 to 1; and rounding of velocities of up to 6 T.
    assert np.hypot(*after[0, :2]) <= 21 * off / T + 1e-15


# --- curves ---


@LAW
@given(curves, limits, st.integers(1, 2), st.booleans())
def test_a_curve_is_driven_within_the_ellipse(curve: object, limit: MotionLimits, laps: int, tangent: bool) -> None:
    """Facing ahead or along the path; second differences of poses of size 10 round at 1e-15 / T^2."""
    assert_keeps(CurveReference(curve, limit, T, laps, tangent).poses, limit, 1e-8)  # type: ignore[arg-type]


# --- the same in all directions ---


def one_limit(offset: Array, velocity: Array, speed: float, acceleration: float) -> Array:
    """The rule for one limit of acceleration, as it was before there were two: (n, d) m/s."""
    step = acceleration * T
    distance = np.sqrt((offset**2).sum(-1, keepdims=True))
    direction = np.divide(offset, distance, out=np.zeros_like(offset), where=distance > 0)
    onward = (velocity * direction).sum(-1, keepdims=True)
    wanted = np.minimum(speed, stopping_speed(distance, acceleration, T))
    change = np.minimum(wanted - onward, step) * direction - (velocity - onward * direction)
    return velocity + change * (step / np.maximum(np.sqrt((change**2).sum(-1, keepdims=True)), step))


@LAW
@given(poses, velocities, poses, limits)
def test_without_a_side_limit_the_rule_is_that_of_one_limit(
    pose: tuple[float, ...], twist: tuple[float, ...], target: tuple[float, ...], limit: MotionLimits
) -> None:
    """Bit for bit, whether there is none or it is the same."""
    limit = MotionLimits(limit.speed, limit.acceleration, limit.turn_rate, limit.turn_acceleration)
    now, was, goal = (np.array([each]) for each in (pose, twist, target))
    xy = one_limit((goal - now)[:, :2], was[:, :2], limit.speed, limit.acceleration)
    turn = one_limit((goal - now)[:, 2:], was[:, 2:], limit.turn_rate, limit.turn_acceleration)
    for side in (None, limit.acceleration):
        each = MotionLimits(limit.speed, limit.acceleration, limit.turn_rate, limit.turn_acceleration, side)
        np.testing.assert_array_equal(approach_pose(now, was, goal, each, T), np.concatenate([xy, turn], axis=1))


@FEW
@given(curves, limits, st.booleans())
def test_a_side_limit_that_is_the_same_changes_no_bit_of_a_curve(
    curve: object, limit: MotionLimits, tangent: bool
) -> None:
    numbers = limit.speed, limit.acceleration, limit.turn_rate, limit.turn_acceleration
    one, same = (
        CurveReference(curve, each, T, 1, tangent).poses  # type: ignore[arg-type]
        for each in (MotionLimits(*numbers), MotionLimits(*numbers, limit.acceleration))
    )
    np.testing.assert_array_equal(one, same)


def test_a_side_limit_that_cannot_be_is_refused() -> None:
    for bad in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(OmniError, match="limit of side acceleration must be a positive number"):
            MotionLimits(side_acceleration=bad)

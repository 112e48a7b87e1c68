"""References to targets that move: limits kept, no jumps, targets met exactly and in time."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from closed_loop import LaggedPlant, T, to_measured_pose
from commands import run_python
from hypothesis import given, settings
from hypothesis import strategies as st
from random_motion import compute_ellipse_utilization, compute_fastest_time, limits
from team_setup import TIMED, Follower

from omni_control import MotionLimits, OmniError, TargetReference, Team, TeamModel
from omni_control.controllers.registry import make_controller
from omni_control.kinematics import Array, compute_pose_error, wrap_angle

EXAMPLE = Path(__file__).parents[2] / "examples" / "follow_ball.py"
ROUNDING = 1e-9
seeds = st.integers(0, 2**32 - 1)
isotropic = st.builds(
    MotionLimits, st.floats(0.3, 4), st.floats(0.3, 6), st.floats(1, 10), st.floats(3, 40)
)


def draw_targets(rng: np.random.Generator, reference: TargetReference, frame: int, n: int) -> None:
    """Set random targets of one of four kinds for n robots."""
    robots, pose = np.arange(n), rng.uniform(-3, 3, (n, 3))
    twist = rng.uniform(-4, 4, (n, 3))
    kind = rng.integers(4)
    if kind == 0:
        reference.set_target(frame, robots, pose)
    elif kind == 1:
        reference.set_target(frame, robots, pose, twist)
    else:
        reference.set_velocity(frame, robots, twist, pose[:, 2] if kind == 2 else None)


def follow(reference: TargetReference, frame: float, pose: Array) -> tuple[Array, Array, Array]:
    """Return the pose, the twist and the next pose of robots that follow."""
    desired, twist = reference.at(frame, pose)
    return desired, twist, desired + twist * T


def is_at(desired: Array, twist: Array, pose: Array, target_twist: Array) -> bool:
    off = compute_pose_error(desired, pose)
    return max(np.abs(off).max(), np.abs(twist - target_twist).max()) < ROUNDING


@settings(max_examples=12)
@given(limits, seeds, st.integers(1, 5))
def test_random_targets_cause_no_jump_and_keep_the_limits(
    limit: MotionLimits, seed: int, interval: int
) -> None:
    """The pose is continuous, and the twist changes by at most acceleration times period."""
    rng, n = np.random.default_rng(seed), 7
    reference, pose = TargetReference(limit, T, n), rng.uniform(-3, 3, (n, 3))
    last_twist = np.zeros((n, 3))
    for frame in range(90):
        if frame % interval == 0:
            draw_targets(rng, reference, frame, n)
        desired, twist, next_pose = follow(reference, frame + 5.3, pose)
        np.testing.assert_allclose(desired, pose, rtol=0, atol=1e-11)
        assert np.hypot(twist[:, 0], twist[:, 1]).max() <= limit.speed + ROUNDING
        assert np.abs(twist[:, 2]).max() <= limit.turn_rate + ROUNDING
        change = (twist - last_twist) / T
        utilization = compute_ellipse_utilization(change, desired[:, 2], limit)
        assert utilization.max() <= 1 + ROUNDING
        assert np.abs(change[:, 2]).max() <= limit.turn_acceleration * (1 + ROUNDING)
        last_twist, pose = twist, next_pose


@settings(max_examples=12)
@given(isotropic, seeds)
def test_a_resting_target_is_met_exactly_in_the_time_of_a_trapezoid(
    limit: MotionLimits, seed: int
) -> None:
    """Without overshoot, by the shorter turn, and then the reference rests to the bit."""
    rng = np.random.default_rng(seed)
    start, target = rng.uniform(-2, 2, (2, 1, 3))
    target[:, 2] += 2 * np.pi * rng.integers(-2, 3)
    reference, pose, frame = TargetReference(limit, T, 1), start, 0
    distance, turn = math.dist(start[0, :2], target[0, :2]), abs(wrap_angle(target - start)[0, 2])
    remaining = [math.inf]
    while True:
        reference.set_target(frame, 0, target[0])  # unchanged, as a skill would set it
        desired, twist, pose = follow(reference, frame, pose)
        if is_at(desired, twist, target, np.zeros(3)):
            break
        remaining.append(math.dist(desired[0, :2], target[0, :2]))
        along, off = target[0, :2] - start[0, :2], desired[0, :2] - start[0, :2]
        assert abs(along[0] * off[1] - along[1] * off[0]) < ROUNDING, "on a straight line"
        frame += 1
    assert (np.diff(remaining) <= ROUNDING).all(), "never away from the target"
    fastest = max(
        compute_fastest_time(distance, limit.speed, limit.acceleration),
        compute_fastest_time(turn, limit.turn_rate, limit.turn_acceleration),
    )
    assert abs(frame - fastest / T) <= 2
    desired, twist, _ = follow(reference, frame + 1, pose)
    assert (desired[0, :2] == target[0, :2]).all()
    assert (twist == 0).all()


@settings(max_examples=12)
@given(isotropic, seeds)
def test_a_target_is_met_from_any_motion_within_the_time_to_stop_and_return(
    limit: MotionLimits, seed: int
) -> None:
    """Also a target that moves, after other targets in every frame; then the reference stays on it.

    The bound is that of a robot which takes over the target's velocity, and then closes the
    distance with the speed that the target leaves.
    """
    rng = np.random.default_rng(seed)
    reference, pose = TargetReference(limit, T, 1), rng.uniform(-1, 1, (1, 3))
    n_changes = int(rng.integers(1, 40))
    for frame in range(n_changes):
        draw_targets(rng, reference, frame, 1)
        _, twist, pose = follow(reference, frame, pose)
    target_twist = rng.uniform(-0.35, 0.35, 3) * [limit.speed, limit.speed, limit.turn_rate]
    target = rng.uniform(-3, 3, 3)
    reference.set_target(n_changes, 0, target, target_twist)
    relative = twist[0] - target_twist
    speed = math.hypot(*relative[:2])
    distance = math.dist(target[:2], pose[0, :2]) + speed**2 / 2 / limit.acceleration
    angle = np.pi + relative[2] ** 2 / 2 / limit.turn_acceleration
    bound = max(
        speed / limit.acceleration * 2
        + compute_fastest_time(
            distance, limit.speed - math.hypot(*target_twist[:2]), limit.acceleration
        ),
        abs(relative[2]) / limit.turn_acceleration * 2
        + compute_fastest_time(
            angle, limit.turn_rate - abs(target_twist[2]), limit.turn_acceleration
        ),
    )
    has_arrived = False
    for step in range(math.ceil(bound / T) + 15 + 10):
        desired, twist, pose = follow(reference, n_changes + step, pose)
        arrived = is_at(desired, twist, target + step * T * target_twist, target_twist)
        assert arrived or not has_arrived
        has_arrived = arrived
    assert has_arrived


@given(seeds)
@settings(max_examples=5)
def test_a_row_of_a_batch_equals_the_row_alone(seed: int) -> None:
    """To the bit, with any order of the robots, and in previews, which have no side effects."""
    rng, n, limit = np.random.default_rng(seed), 7, MotionLimits(side_acceleration=0.5)
    batch, single = TargetReference(limit, T, n), [TargetReference(limit, T, 1) for _ in range(n)]
    poses = rng.uniform(-1, 1, (40, n, 3))
    for frame in range(40):
        target, twist = rng.uniform(-2, 2, (2, n, 3)) * rng.integers(0, 2, (2, n, 1))
        order = rng.permutation(n)[:5]
        batch.set_target(frame, order, target[order], twist[order])
        lookahead = frame + rng.uniform(0, 6, n)
        preview = batch.preview(lookahead, poses[frame], 3)
        result = batch.at(lookahead, poses[frame])
        np.testing.assert_array_equal(np.array(preview)[:, 0], result)
        np.testing.assert_array_equal(preview, batch.preview(lookahead, poses[frame], 3))
        for i in range(n):
            if i in order:
                single[i].set_target(frame, 0, target[i], twist[i])
            answer = single[i].at(lookahead[i : i + 1], poses[frame, i : i + 1])
            np.testing.assert_array_equal(np.array(answer)[:, 0], np.array(result)[:, i])


def test_a_team_follows_a_moving_target_without_delay() -> None:
    """An ideal robot is where the target is, in every frame, although commands are six frames late.

    Robots of two controllers in any order have their own targets. Commands change by at most the
    acceleration times the period, also when targets jump.
    """
    model, limit = TeamModel(T, 6, 0.0, 0.0, 0.0), MotionLimits(2.0, 3.0, 6.0, 12.0)
    references = [TargetReference(limit, T, n) for n in (1, 2)]
    controllers = [
        make_controller("comp-flc", model, reference, n)
        for reference, n in zip(references, (1, 2), strict=True)
    ]
    start = np.random.default_rng(0).uniform(-1, 1, (3, 3))
    team, plant = Team(controllers, start, [[1], [2, 0]]), LaggedPlant(start, 6)
    target, twist = start + 0.5, np.array([[1.0, 0.3, 0.5], [-0.5, 1, -1], [0, 0, 0]])
    commands = []
    for frame in range(400):
        if frame == 200:
            target += [-0.4, 0.3, 2.0]
        observe_before_target = frame % 2
        if observe_before_target:
            team.observe(to_measured_pose(plant.pose))
        for robot in range(3):
            team.set_target(robot, target[robot], twist[robot])
        if not observe_before_target:
            team.observe(to_measured_pose(plant.pose))
        if frame in (199, 399):
            off = compute_pose_error(plant.pose, target)
            assert np.hypot(off[:, 0], off[:, 1]).max() < 1e-6
            assert np.abs(off[:, 2]).max() < 1e-6
        commands.append(team.command())
        plant.advance(commands[-1])
        target += twist * T
    change = np.diff(commands, axis=0)
    assert np.hypot(change[..., 0], change[..., 1]).max() <= 3.0 * T * (1 + 1e-6)
    assert np.abs(change[..., 2]).max() <= 12.0 * T * (1 + 1e-6)


def test_noise_of_a_target_moves_the_reference_little() -> None:
    """Noise of a millimeter in every frame: no full acceleration, and no more motion than noise."""
    rng, limit = np.random.default_rng(0), MotionLimits(2.0, 2.0)
    reference, pose, accelerations, last_twist = (
        TargetReference(limit, T, 1),
        np.zeros((1, 3)),
        [],
        0,
    )
    for frame in range(300):
        reference.set_target(frame, 0, rng.normal(0, [0.001, 0.001, 0.005]))
        _, twist, pose = follow(reference, frame + 6, pose)
        accelerations.append(np.hypot(*(twist - last_twist)[0, :2]) / T)
        last_twist = twist
        assert np.hypot(*pose[0, :2]) < 0.003
    assert np.mean(accelerations[20:]) < 0.5


def test_a_reference_waits_for_a_robot_that_is_held() -> None:
    """It stays within 0.3 m and 1 rad; after a pause of a second it starts again at the robot."""
    reference, held = TargetReference(MotionLimits(), T, 1), np.array([[0.2, 0.1, 3.0]])
    reference.set_target(0, 0, [3, 0, 1.0])
    for frame in range(120):
        desired, _ = reference.at(frame, held)
    assert math.dist(desired[0, :2], held[0, :2]) == pytest.approx(0.3)
    assert desired[0, 2] == pytest.approx(2.0)
    moved = held + 1.0
    desired, twist = reference.at(180, moved)
    assert (desired == moved).all()
    assert np.hypot(*twist[0, :2]) <= MotionLimits().acceleration * T + ROUNDING


def test_limits_can_be_lowered_while_driving() -> None:
    """A robot slows down to the new speed within the new acceleration."""
    reference, pose, speeds = TargetReference(MotionLimits(3.0, 3.0), T, 1), np.zeros((1, 3)), []
    reference.set_velocity(0, 0, [9, 0, 0])
    for frame in range(200):
        if frame == 100:
            reference.limits = MotionLimits(1.5, 2.0)
        _, twist, pose = follow(reference, frame, pose)
        speeds.append(twist[0, 0])
    assert speeds[99] == pytest.approx(3.0)
    assert speeds[-1] == pytest.approx(1.5)
    assert np.diff(speeds)[99:].min() == pytest.approx(-2.0 * T)


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("pose", "twist", "reason"),
    [
        ([0, NAN, 0], [0, 0, 0], "target poses must be finite"),
        ([0, 0], [0, 0, 0], "target poses must be finite"),
        (["a", 0, 0], [0, 0, 0], "target poses must be finite"),
        (None, [0, 0, 0], "target poses must be finite"),
        ([0, 0, 0], [INF, 0, 0], "target twists must be finite"),
        ([0, 1e200, 0], [0, 0, 0], "target poses must be .* at most 1e"),
        ([0, 0, 0], [0, 0, 0, 0], "target twists must be finite"),
    ],
)
def test_invalid_targets_are_refused_and_change_nothing(pose: Any, twist: Any, reason: str) -> None:
    reference = TargetReference(MotionLimits(), T, 1)
    team = Team(make_controller("p", TeamModel(T, 2), reference, 1), [[0, 0, 0]])
    team.set_target(0, [1, 0, 0])
    with pytest.raises(OmniError, match=reason):
        team.set_target(0, pose, twist)
    assert team.step([[0, 0, 0]])[0, 0] > 0


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (lambda team: team.set_target(2, [0, 0, 0]), r"robots must be .* from 0 to 1, got 2"),
        (lambda team: team.set_target(-1, [0, 0, 0]), "got -1"),
        (lambda team: team.set_target(0.0, [0, 0, 0]), "got 0.0"),
        (lambda team: team.set_target(1, [0, 0, 0]), "robot 1 follows a TimedReference"),
        (lambda team: team.set_velocity(0, [0, 0, NAN]), "target twists"),
        (lambda team: team.set_velocity(0, [0, 0, 0], NAN), "target headings"),
        (lambda team: team.set_velocity(0, [0, 0, 0], "north"), "target headings"),
    ],
)
def test_wrong_calls_are_refused(call: Callable[[Team], None], reason: str) -> None:
    model = TeamModel(T, 2)
    controllers = [
        Follower(model, TargetReference(MotionLimits(), T, 1), 1),
        Follower(model, TIMED, 1),
    ]
    with pytest.raises(OmniError, match=reason):
        call(Team(controllers, np.zeros((2, 3))))


def test_unsuitable_references_are_refused() -> None:
    with pytest.raises(OmniError, match="cannot limit jerk"):
        TargetReference(MotionLimits(jerk=9.0), T, 1)
    for period in (0.0, -T, NAN, INF):
        with pytest.raises(OmniError, match="period must be a positive number"):
            TargetReference(MotionLimits(), period, 1)
    with pytest.raises(OmniError, match="reference is that of 2 robots, got 1"):
        TargetReference(MotionLimits(), T, 2).at(0, np.zeros((1, 3)))


def test_the_example_follows_a_ball() -> None:
    done = run_python(EXAMPLE)
    assert (done.returncode, done.stderr) == (0, "")
    match = re.match(r"mean error: (\d+) mm behind the rolling ball, (\d+) mm at rest", done.stdout)
    assert match, done.stdout
    assert int(match[1]) <= 20
    assert int(match[2]) <= 4

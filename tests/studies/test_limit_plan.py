"""Plans for the next attempt: maps against their definitions, plans against a linear program of scipy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from omni_control.kinematics import Array
from omni_control.limits import CommandLimits
from omni_control.reference import MotionLimits
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.limit.deviations import Deviations
from omni_mj.studies.limit.plan import AIMS, Aim, Planner, flatten, soften

STOPPED = 0.01  # share of the errors that the method may leave, which stops after so many steps
WIDE = MotionLimits(1e3, 1e6, 1e3, 1e6)
vectors = st.lists(st.tuples(*[st.floats(-3, 3)] * 2), min_size=1, max_size=20).map(np.array)


def lengths(values: Array) -> Array:
    return np.hypot(values[..., 0], values[..., 1])


@settings(deadline=None, max_examples=50, derandomize=True)
@given(vectors, st.floats(0.01, 10))
def test_the_longest_are_cut_to_one_level(given_: Array, by: float) -> None:
    """Moreau: what is cut off is the projection on vectors whose lengths add up to `by`, so that all of it is used.

    Optimal is a level of which the slope of by * max + |cut|^2 / 2 is zero: where the cuts add up to `by`.
    """
    left = flatten(given_[:, :, None], by)[:, :, 0]
    cut = lengths(given_) - lengths(left)
    assert (cut > -1e-12).all()
    level = lengths(left).max()
    if level > 1e-9:
        assert cut.sum() == pytest.approx(by)
        np.testing.assert_allclose(lengths(left)[cut > 1e-9], level)
    else:
        assert lengths(given_).sum() <= by * (1 + 1e-9)
    cross = left[:, 0] * given_[:, 1] - left[:, 1] * given_[:, 0]
    np.testing.assert_allclose(cross, 0, atol=1e-9)  # directions stay


@settings(deadline=None, max_examples=50, derandomize=True)
@given(vectors, st.floats(0.01, 10))
def test_each_is_made_shorter(given_: Array, by: float) -> None:
    left = soften(given_[:, :, None], by)[:, :, 0]
    np.testing.assert_allclose(lengths(left), np.maximum(lengths(given_) - by, 0), atol=1e-12)


def late(frames: int, delay: int, keep: float) -> Deviations:
    """A robot whose speed follows its command with a lag, in each direction."""
    push = np.array([1 - keep, 0.0])[:, None, None, None] * np.eye(3)
    return Deviations(np.tile(keep * np.eye(3), (frames, 1, 1)), np.tile(push, (1, frames, 1, 1)), delay)


def driven(deviations: Deviations, commands: Array) -> Array:
    """Poses (F, 3) of such a robot from rest, step by step."""
    poses, speed, frames = np.zeros_like(commands), np.zeros(3), len(commands)
    for k in range(frames - 1):
        speed = deviations.keep[k] @ speed
        for j in range(2):
            if k - deviations.delay - j >= 0:
                speed = speed + deviations.push[j, k] @ commands[k - deviations.delay - j]
        poses[k + 1] = poses[k] + PERIOD_S * speed
    return poses


def test_operators_are_the_recursion() -> None:
    deviations = late(12, 3, 0.7)
    commands = np.random.default_rng(0).standard_normal((12, 3))
    poses, by = deviations.operators()
    found = np.linalg.solve(poses.toarray(), by @ commands.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(found, driven(deviations, commands), atol=1e-12)


@pytest.mark.parametrize("aim", AIMS)
def test_without_limits_nothing_is_left(aim: Aim) -> None:
    """Of errors that begin once commands can act; and what is expected is what the commands lead to."""
    frames, delay = 60, 6
    errors = 0.01 * np.sin(np.maximum(np.arange(frames) - delay, 0) / 9)[:, None, None] ** 2 * np.ones((1, 2, 3))
    commands, expected = Planner(late(frames, delay, 0.8), WIDE).improve(errors, np.zeros((frames, 2, 3)), aim)
    assert np.abs(expected).max() < STOPPED * np.abs(errors).max()
    moved = driven(late(frames, delay, 0.8), commands[:, 0])
    np.testing.assert_allclose(errors[:, 0] + moved, expected[:, 0], atol=1e-12)


def program(errors: Array, deviations: Deviations, step: float, aim: Aim) -> float:
    """The least maximum or mean of |errors + G u| along one axis, changes of u in a frame at most `step`: exactly."""
    frames = len(errors)
    unit = np.eye(3 * frames)[:, ::3]
    gain = np.stack([driven(deviations, column.reshape(-1, 3))[:, 0] for column in unit.T], axis=1)
    change = np.eye(frames) - np.eye(frames, k=-1)
    slack = np.ones((frames, 1)) if aim == "max" else np.eye(frames)
    none = np.zeros((frames, slack.shape[1]))
    above = np.block([[gain, -slack], [-gain, -slack], [change, none], [-change, none]])
    most = np.concatenate([-errors, errors, np.full(2 * frames, step)])
    cost = np.concatenate([np.zeros(frames), np.full(slack.shape[1], 1 / slack.shape[1])])
    return float(linprog(cost, above, most, bounds=[(None, None)] * len(cost)).fun)


@pytest.mark.parametrize("aim", AIMS)
def test_within_limits_it_is_the_best_there_is(aim: Aim) -> None:
    """And what is planned passes the team's limits as it is."""
    frames, delay = 50, 3
    deviations, limits = late(frames, delay, 0.8), MotionLimits(5.0, 4.7, 26.0, 50.8)
    errors = np.zeros((frames, 1, 3))
    errors[10:, 0, 0] = 0.01 * np.minimum(np.arange(frames - 10) / 10, 1)  # a speed that begins and ends at once
    measure = {"max": np.max, "mean": np.mean}[aim]
    commands, expected = Planner(deviations, limits).improve(errors, np.zeros((frames, 1, 3)), aim)
    best = program(errors[:, 0, 0], deviations, limits.acceleration * PERIOD_S, aim)
    assert best > 1e-5, "limits that do not bind"
    assert best < measure(np.abs(expected[..., 0])) < best + STOPPED * measure(np.abs(errors[:, 0, 0]))
    passed, last = CommandLimits([limits], PERIOD_S), np.zeros((1, 3))
    for command in commands:
        last = passed(command, last)
        np.testing.assert_allclose(command, last, atol=1e-12)

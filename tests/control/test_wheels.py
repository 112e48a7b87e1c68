"""Laws of what wheels can do at once: closed forms, forces found wheel by wheel, and drives that stay within it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benches.control import Array, traction, traction_limits
from hypothesis import given, settings
from hypothesis import strategies as st
from routes import AZIMUTHS, RADIUS, TIGERS, G, T, limits, most, paths, smooth_limits, vectors, wheels

from omni_control import CURVES, CurveReference, Kinematics, MotionLimits, OmniError, TimedReference, WheelLimits

# --- one acceleration without turning ---

ARM = 0.08
ROBOT = Kinematics(np.radians(AZIMUTHS), ARM, RADIUS)
frictions, heights = st.floats(0.05, 1.2), st.floats(0, 0.05)


@given(frictions, heights)
def test_of_the_default_wheels_the_limits_are_closed_forms(friction: float, height: float) -> None:
    """The wheels' distances ahead and behind are 1/2 and 1/sqrt 2 of the arm, and share the weight the other way round.

    Forward, all four slide: by sin 60 and sin 45 of what they bear, of which a h / (arm (1/2 + 1/sqrt 2)) shifts
    to the wheels behind, which point forward less. Sideways no moment may be left: those in front push no harder than
    those behind, which bear 1 / (2 + 2 sqrt 2) of the weight each, by cos 60 and cos 45. That is half of it.
    """
    forward, sideways = traction_limits(ROBOT, friction, height)
    level = friction * G * (math.sqrt(6) + math.sqrt(2)) / (2 + 2 * math.sqrt(2))
    shifts = friction * (math.sqrt(3) - math.sqrt(2)) * height / ARM / (1 + math.sqrt(2))
    topples = G * ARM / 2 / max(height, 1e-3)  # braking over the wheels in front
    # The solver is exact to 1e-7 of its bounds.
    assert forward == pytest.approx(min(level / (1 + shifts), topples), rel=1e-6)
    assert sideways == pytest.approx(friction * G / 2, rel=1e-6)
    assert traction(ROBOT, friction, math.pi, height) == pytest.approx(min(level / (1 - shifts), topples), rel=1e-6)


@pytest.mark.parametrize("count", [3, 5, 6])
def test_any_number_of_wheels_will_do(count: int) -> None:
    """Evenly spaced, each bears its share, and forward and sideways no more than the sum of |sin| or |cos| of it."""
    azimuths = 2 * np.pi * np.arange(count) / count + np.pi / count
    found = traction_limits(Kinematics(azimuths, ARM, RADIUS), 0.5)
    most = 0.5 * G * np.array([np.abs(np.sin(azimuths)).mean(), np.abs(np.cos(azimuths)).mean()])
    assert (np.array(found) <= most * (1 + 1e-6)).all()
    if count == 6:  # opposite wheels push alike, and leave no moment
        assert found == pytest.approx(most, rel=1e-6)


def test_wheels_that_a_robot_does_not_stand_on_are_refused() -> None:
    with pytest.raises(OmniError, match="topple"):
        traction_limits(Kinematics(np.radians([30.0, 60.0, 80.0]), ARM, RADIUS), 0.8)


# --- all at once ---


@given(wheels, vectors, vectors)
def test_no_forces_give_more(robot: WheelLimits, asked: tuple[float, ...], travel: tuple[float, ...]) -> None:
    """At so many times the acceleration as forces of single wheels can give at best, the whole friction is needed."""
    times = most(robot, np.array(asked), np.array(travel))
    share = robot.friction_share(times * np.array([asked]), np.array([travel]))
    assert share[0] == pytest.approx(1, rel=1e-6)  # of the solver


def test_pushing_needs_what_traction_says_and_turning_all_wheels_alike() -> None:
    """Without drag: 1 at the traction ahead; and a moment of mu g m arm, of wheels that all slide one way."""
    robot = replace(TIGERS, pile=0.0, roller_friction=0.0)
    still = np.zeros((1, 3))
    ahead = traction(robot.kinematics, 0.45, 0.0, 0.045)
    assert robot.friction_share(np.array([[ahead, 0, 0]]), still)[0] == pytest.approx(1)
    spun = 0.45 * G * 0.083 / 0.0695**2
    assert robot.friction_share(np.array([[0, 0, spun]]), still)[0] == pytest.approx(1)


@given(wheels, st.floats(0.3, 6), st.floats(0.3, 6), st.floats(1, 100))
def test_what_is_spared_for_all_at_once_is_enough_for_each(
    robot: WheelLimits, ahead: float, aside: float, turning: float
) -> None:
    """Of any acceleration on the ellipse with turning either way, at any travel, whatever it drags."""
    spare = robot.spare(ahead, aside, turning)
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    for sign in (1, -1):
        asked = spare * np.stack([ahead * np.cos(angles), aside * np.sin(angles), np.full(48, sign * turning)], axis=1)
        for way in (
            np.stack([np.cos(angles + lag), np.sin(angles + lag), 10 * np.cos(lag + 0 * angles)], 1) for lag in range(6)
        ):
            assert robot.friction_share(asked, way).max() <= 1 + 1e-9


def test_wheels_that_cannot_pull_what_drags_them_are_refused() -> None:
    with pytest.raises(OmniError, match=r"friction 0.2 wheels cannot pull what drags them, 1\.\d+ times"):
        replace(TIGERS, friction=0.2)


# --- drives within it ---


def differences(poses: Array) -> tuple[Array, Array, Array]:
    """Rims' speeds (frames, wheels) per rim, and body accelerations and mean travel (frames, 3), of sampled poses."""
    velocity = np.pad(np.diff(poses, axis=0) / T, ((1, 1), (0, 0)))
    turned = np.exp(-1j * poses[:, 2])

    def body(rows: Array, by: Array) -> Array:
        z = (rows[:, 0] + 1j * rows[:, 1]) * by
        return np.stack([z.real, z.imag, rows[:, 2]], axis=1)

    halfway = np.exp(-0.5j * (poses[1:, 2] + poses[:-1, 2]))
    rolling = body(velocity[1:-1], halfway)
    return rolling, body(np.diff(velocity, axis=0) / T, turned), body((velocity[1:] + velocity[:-1]) / 2, turned)


def assert_within(robot: WheelLimits, poses: Array) -> None:
    rolling, asked, travel = differences(poses)
    # A snap of a nm at a way-point is 4e-6 m/s^2, of 3 at least that friction gives.
    assert robot.friction_share(asked, travel).max() <= 1 + 1e-5
    rims = rolling @ [-np.sin(robot.kinematics.azimuths), np.cos(robot.kinematics.azimuths), [robot.kinematics.arm] * 4]
    assert np.abs(rims).max(initial=0) <= robot.rim_speed * (1 + 1e-6)


@settings(max_examples=12)
@given(paths, limits | smooth_limits, wheels, st.integers(0, 2))
def test_a_way_stays_within_what_wheels_can(
    path: list[tuple[float, ...]], limit: MotionLimits, robot: WheelLimits, dwell: int
) -> None:
    """And within all other limits, of which none is given up for it."""
    reference = TimedReference(path, replace(limit, wheels=robot), T, dwell)
    assert_within(robot, reference.poses)
    assert limit.excess(reference.poses, T) <= 1 + 1e-5


@settings(max_examples=12)
@given(st.sampled_from(list(CURVES)), st.floats(0.7, 1), limits | smooth_limits, wheels, st.booleans())
def test_a_curve_stays_within_what_wheels_can(
    shape: str, length: float, limit: MotionLimits, robot: WheelLimits, tangent: bool
) -> None:
    reference = CurveReference(CURVES[shape](length, 1.0), replace(limit, wheels=robot), T, 1, tangent)
    assert_within(robot, reference.poses)
    assert limit.excess(reference.poses, T) <= 1 + 1e-8

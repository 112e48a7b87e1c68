"""How robots with dry friction are taken to answer to commands, and what to ask of them for a wanted answer."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from laws import LAW

from omni_control.estimation.identify import ALPHA_BOUNDS, ARM_M, SLOW_M_S, PlantIdentifier, direction
from omni_control.kinematics import Array

T = 1 / 60
DRAG_HIGHEST = 0.08  # m/s: twice what is believed of it by default

twists = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-20, 20)).map(np.array)
headings = st.floats(-10, 10)


def wheel_speed(twist: Array) -> Array:
    """Size of twists (..., 3), turning counted at the wheels, m/s."""
    return np.linalg.norm(twist * [1.0, 1.0, ARM_M], axis=-1)


def turned(twist: Array, angle: float) -> Array:
    """Twists (..., 3) rotated counter-clockwise."""
    xy = (twist[..., 0] + 1j * twist[..., 1]) * np.exp(1j * angle)
    return np.stack([xy.real, xy.imag, twist[..., 2]], axis=-1)


def robots(alpha: Array | float, drag: Array | float, n: int = 1) -> PlantIdentifier:
    """Robots that have been identified as such."""
    plant = PlantIdentifier(n, T, 6.0, (0.0013, 0.0013, 0.01))
    plant.alpha, plant.drag = np.broadcast_to(alpha, (n, 3)), np.broadcast_to(drag, (n, 3))
    return plant


def test_friction_opposes_driving_and_turning() -> None:
    """Written out: ahead, aside, turning on the spot one wheel speed, and half of what is half as fast as slow."""
    given_twists = np.array([[2.0, 0, 0], [0, -1, 0], [0, 0, 5.0], [SLOW_M_S / 2, 0, 0], [0, 0, 0]])
    expected = [[1, 0, 0], [0, -1, 0], [0, 0, 1 / ARM_M], [0.5, 0, 0], [0, 0, 0]]
    np.testing.assert_allclose(direction(given_twists), expected, rtol=1e-15, atol=0)


@LAW
@given(twists, st.floats(-3, 3), st.floats(1, 10))
def test_friction_depends_on_the_direction_alone_but_for_slow_robots(twist: Array, angle: float, times: float) -> None:
    """Odd, turned with the twist, of size one beyond 0.05 m/s and proportional below; it never turns the twist."""
    rubbed, size = direction(twist), wheel_speed(twist)
    np.testing.assert_array_equal(direction(-twist), -rubbed)
    np.testing.assert_allclose(direction(turned(twist, angle)), turned(rubbed, angle), rtol=0, atol=1e-14)
    assert wheel_speed(rubbed) == pytest.approx(min(1.0, size / SLOW_M_S), abs=1e-14)
    np.testing.assert_allclose(np.cross(rubbed, twist), 0, atol=1e-12)
    faster = direction(times * twist)
    if size >= SLOW_M_S:
        np.testing.assert_allclose(faster, rubbed, rtol=1e-13, atol=0)


@LAW
@given(twists, headings, st.floats(0.4, 1.2), st.floats(0, DRAG_HIGHEST))
def test_a_robot_the_same_in_all_directions_loses_speed_alone(
    twist: Array, heading: float, alpha: float, drag: float
) -> None:
    """alpha v - drag, in the direction of the command; commands are in world, answers in body coordinates."""
    size = wheel_speed(twist)
    lost = drag * min(1.0, size / SLOW_M_S)
    assume(alpha * size >= lost)
    body = robots(alpha, drag).respond(turned(twist, heading)[None], np.array([heading]))[0]
    np.testing.assert_allclose(np.cross(body, twist), 0, atol=1e-12)
    assert body @ twist >= 0
    assert wheel_speed(body) == pytest.approx(alpha * size - lost, abs=1e-13)


@LAW
@given(twists, headings, st.floats(0.4, 1.2), st.floats(0, DRAG_HIGHEST))
def test_what_is_asked_of_a_robot_the_same_in_all_directions_is_answered(
    twist: Array, heading: float, alpha: float, drag: float
) -> None:
    """`ask` is the inverse of `respond` exactly: at speeds beyond 0.05 m/s, wanted and asked."""
    size = wheel_speed(twist)
    assume(size > 0.07)  # at most 1.2 times what is asked
    plant, h, wanted = robots(alpha, drag), np.array([heading]), turned(twist, heading)[None]
    answer = turned(plant.respond(plant.ask(wanted, h), h), heading)
    np.testing.assert_allclose(answer, wanted, rtol=0, atol=1e-13)


@LAW
@given(st.integers(0, 2**32 - 1))
def test_what_is_asked_of_any_robot_is_answered_but_for_the_bend_of_its_friction(seed: int) -> None:
    """Axes that differ bend the command away from the answer, and friction with it: by no more than the bend.

    The command is the twist stretched along the axes by (1 + drag / |v|) / alpha. A stretch by r in one axis against
    another turns a vector by asin((r - 1) / (r + 1)) at most, and friction of size `drag` moves by that chord.
    """
    rng, n = np.random.default_rng(seed), 50
    alpha, drag = rng.uniform(*ALPHA_BOUNDS, (n, 3)), rng.uniform(0, DRAG_HIGHEST, (n, 3))
    heading, wanted = rng.uniform(-3, 3, n), rng.normal(size=(n, 3)) / [1.0, 1.0, ARM_M]
    size = rng.uniform(0.07, 3, n)
    wanted *= (size / wheel_speed(wanted))[:, None]
    plant = robots(alpha, drag, n)
    asked = plant.ask(np.array([turned(w, h) for w, h in zip(wanted, heading, strict=True)]), heading)
    off = wheel_speed(plant.respond(asked, heading) - wanted)
    stretch = (1 + drag / size[:, None]) / alpha
    ratio = stretch.max(1) / stretch.min(1)
    chord = 2 * np.sin(np.arcsin((ratio - 1) / (ratio + 1)) / 2)
    assert (off <= drag.max(1) * chord + 1e-13).all()


@LAW
@given(twists, headings, st.integers(0, 2**32 - 1))
def test_on_an_axis_what_is_asked_is_answered_exactly(twist: Array, heading: float, seed: int) -> None:
    """Forward, to the left or turning alone, nothing bends, whatever the three axes are like."""
    rng = np.random.default_rng(seed)
    plant = robots(rng.uniform(*ALPHA_BOUNDS, 3), rng.uniform(0, DRAG_HIGHEST, 3))
    for axis in range(3):
        wanted = np.zeros(3)
        wanted[axis] = np.copysign(0.07 + abs(twist[axis]), twist[axis]) / (ARM_M if axis == 2 else 1.0)
        world, h = turned(wanted, heading)[None], np.array([heading])
        answer = plant.respond(plant.ask(world, h), h)[0]
        # Turning at up to 250 rad/s.
        np.testing.assert_allclose(answer, wanted, rtol=1e-13, atol=1e-13)


@LAW
@given(twists, headings, st.floats(0.4, 1.2), st.floats(0, DRAG_HIGHEST))
def test_friction_stops_a_robot_but_does_not_push_it_back(
    twist: Array, heading: float, alpha: float, drag: float
) -> None:
    """Along each axis a robot answers in the direction of its command or not at all, also when it creeps."""
    for size in (1.0, 0.02, 1e-3):
        command = turned(size * twist, heading)
        answer = robots(alpha, drag).respond(command[None], np.array([heading]))[0]
        # Turning there and back rounds twists of up to 20.
        assert (answer * turned(command, -heading) >= -1e-12).all()

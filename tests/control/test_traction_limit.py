"""What wheels can push on a carpet: closed forms of statics, and the corners of what four forces can add up to."""

import math
from itertools import combinations

import numpy as np
import pytest
from benches.control import traction, traction_limits
from hypothesis import given
from hypothesis import strategies as st
from laws import LAW

from omni_control import Kinematics, OmniError

ARM, RADIUS, G = 0.08, 0.0285, 9.81
AZIMUTHS = (60.0, 135.0, 225.0, 300.0)
ROBOT = Kinematics(np.radians(AZIMUTHS), ARM, RADIUS)
frictions, heights, bearings = st.floats(0.05, 1.2), st.floats(0, 0.05), st.floats(-math.pi, math.pi)
# Wheels at most 15 deg from these azimuths: they stand around the centre.
robots = st.builds(
    lambda shift, arm: Kinematics(np.radians(np.add(AZIMUTHS, shift)), arm, RADIUS),
    st.tuples(*[st.floats(-15, 15)] * 4),
    st.floats(0.06, 0.1),
)


@LAW
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


def by_corners(robot: Kinematics, friction: float, bearing: float, height: float) -> float:
    """The same of four wheels, found in the plane.

    Forces that give an acceleration a towards the bearing and no moment are a p + s n, n being those that give nothing.
    What is allowed in the plane (a, s) is cut out by eight lines, and the largest a is where two of them meet.
    """
    spoke = np.exp(1j * robot.azimuths)
    given = np.array([(1j * spoke).real, (1j * spoke).imag, np.ones(4)])
    p = np.linalg.lstsq(given, np.array([math.cos(bearing), math.sin(bearing), 0.0]), rcond=None)[0]
    n = np.linalg.svd(given)[2][3]
    # Loads n0 + a n1: least squares of the balance of weight and of both moments, by its normal equations.
    balance = np.array([np.ones(4), robot.arm * spoke.real, robot.arm * spoke.imag])
    n0, n1 = (
        balance.T
        @ np.linalg.solve(
            balance @ balance.T, [weight, -a * height * math.cos(bearing), -a * height * math.sin(bearing)]
        )
        for weight, a in ((G, 0.0), (0.0, 1.0))
    )
    lines = np.array([[sign * p - friction * n1, sign * n] for sign in (1, -1)]).transpose(0, 2, 1).reshape(8, 2)
    most = np.tile(friction * n0, 2)
    corners = [
        np.linalg.solve(lines[[i, j]], most[[i, j]])
        for i, j in combinations(range(8), 2)
        if abs(np.linalg.det(lines[[i, j]])) > 1e-9
    ]
    return max(a for a, s in corners if (lines @ [a, s] <= most + 1e-9).all())


@LAW
@given(robots, frictions, bearings, heights)
def test_no_forces_of_four_wheels_give_more(robot: Kinematics, friction: float, bearing: float, height: float) -> None:
    """Whatever the wheels' azimuths, in any direction, with and without load that shifts."""
    found = traction(robot, friction, bearing, height)
    # As above, and corners of lines that cross at small angles.
    assert found == pytest.approx(by_corners(robot, friction, bearing, height), rel=1e-5)
    assert 0 < found < friction * G


@pytest.mark.parametrize("wheels", [3, 5, 6])
def test_any_number_of_wheels_will_do(wheels: int) -> None:
    """Evenly spaced, each bears its share, and forward and sideways no more than the sum of |sin| or |cos| of it."""
    azimuths = 2 * np.pi * np.arange(wheels) / wheels + np.pi / wheels
    limits = traction_limits(Kinematics(azimuths, ARM, RADIUS), 0.5)
    most = 0.5 * G * np.array([np.abs(np.sin(azimuths)).mean(), np.abs(np.cos(azimuths)).mean()])
    assert (np.array(limits) <= most * (1 + 1e-6)).all()
    if wheels == 6:  # opposite wheels push alike, and leave no moment
        assert limits == pytest.approx(most, rel=1e-6)


def test_wheels_that_a_robot_does_not_stand_on_are_refused() -> None:
    with pytest.raises(OmniError, match="topple"):
        traction_limits(Kinematics(np.radians([30.0, 60.0, 80.0]), ARM, RADIUS), 0.8)

"""Traction limits of wheels: closed forms of statics."""

import math

import numpy as np
import pytest
from benches.control import compute_traction_limits
from hypothesis import given
from hypothesis import strategies as st

from omni_control import Kinematics, OmniError, WheelLimits

ARM, RADIUS, G = 0.08, 0.0285, 9.81
AZIMUTHS = (60.0, 135.0, 225.0, 300.0)
ROBOT = Kinematics(np.radians(AZIMUTHS), ARM, RADIUS)
frictions, heights = st.floats(0.05, 1.2), st.floats(0, 0.05)


@given(frictions, heights)
def test_limits_of_the_default_wheels_have_closed_forms(friction: float, height: float) -> None:
    """The front wheels are 1/2 of the arm before the center, the rear ones 1/sqrt 2 behind it.

    They share the weight the other way round. Forward, all four slide, with sin 60 and sin 45 of
    their loads. The load a h / (arm (1/2 + 1/sqrt 2)) shifts to the rear wheels, which point
    forward less. Sideways, no moment may remain: the front wheels push no harder than the rear
    ones, which bear 1 / (2 + 2 sqrt 2) of the weight each, with cos 60 and cos 45. That is half of
    it.
    """
    forward, sideways = compute_traction_limits(ROBOT, friction, height)
    level = friction * G * (math.sqrt(6) + math.sqrt(2)) / (2 + 2 * math.sqrt(2))
    shift = friction * (math.sqrt(3) - math.sqrt(2)) * height / ARM / (1 + math.sqrt(2))
    tipping = G * ARM / 2 / max(height, 1e-3)  # braking over the front wheels
    backward = WheelLimits(ROBOT, friction, 1.0, height).compute_max_acceleration(math.pi)
    assert forward == pytest.approx(min(level / (1 + shift), tipping), rel=1e-6)
    assert sideways == pytest.approx(friction * G / 2, rel=1e-6)
    assert backward == pytest.approx(min(level / (1 - shift), tipping), rel=1e-6)


@pytest.mark.parametrize("wheels", [3, 5, 6])
def test_any_number_of_wheels_is_allowed(wheels: int) -> None:
    """Evenly spaced wheels give at most the sum of |sin| or |cos| of their equal shares."""
    azimuths = 2 * np.pi * np.arange(wheels) / wheels + np.pi / wheels
    limits = compute_traction_limits(Kinematics(azimuths, ARM, RADIUS), 0.5)
    bound = 0.5 * G * np.array([np.abs(np.sin(azimuths)).mean(), np.abs(np.cos(azimuths)).mean()])
    assert (np.array(limits) <= bound * (1 + 1e-6)).all()
    if wheels == 6:  # opposite wheels push alike and leave no moment
        assert limits == pytest.approx(bound, rel=1e-6)


def test_wheels_on_which_a_robot_does_not_stand_are_refused() -> None:
    with pytest.raises(OmniError, match="topple"):
        compute_traction_limits(Kinematics(np.radians([30.0, 60.0, 80.0]), ARM, RADIUS), 0.8)

"""What wheels can push on a carpet: closed forms of statics."""

import math

import numpy as np
import pytest
from benches.control import compute_max_acceleration, compute_traction_limits
from hypothesis import given
from hypothesis import strategies as st

from omni_control import Kinematics, OmniError

ARM, RADIUS, G = 0.08, 0.0285, 9.81
AZIMUTHS = (60.0, 135.0, 225.0, 300.0)
ROBOT = Kinematics(np.radians(AZIMUTHS), ARM, RADIUS)
frictions, heights = st.floats(0.05, 1.2), st.floats(0, 0.05)


@given(frictions, heights)
def test_of_the_default_wheels_the_limits_are_closed_forms(friction: float, height: float) -> None:
    """The wheels' distances ahead and behind are 1/2 and 1/sqrt 2 of the arm, and share the weight the other way round.

    Forward, all four slide: by sin 60 and sin 45 of what they bear, of which a h / (arm (1/2 +
    1/sqrt 2)) shifts to the wheels behind, which point forward less. Sideways no moment may be
    left: those in front push no harder than those behind, which bear 1 / (2 + 2 sqrt 2) of the
    weight each, by cos 60 and cos 45. That is half of it.
    """
    forward, sideways = compute_traction_limits(ROBOT, friction, height)
    level = friction * G * (math.sqrt(6) + math.sqrt(2)) / (2 + 2 * math.sqrt(2))
    shifts = friction * (math.sqrt(3) - math.sqrt(2)) * height / ARM / (1 + math.sqrt(2))
    topples = G * ARM / 2 / max(height, 1e-3)  # braking over the wheels in front
    # The solver is exact to 1e-7 of its bounds.
    assert forward == pytest.approx(min(level / (1 + shifts), topples), rel=1e-6)
    assert sideways == pytest.approx(friction * G / 2, rel=1e-6)
    assert compute_max_acceleration(ROBOT, friction, math.pi, height) == pytest.approx(
        min(level / (1 - shifts), topples), rel=1e-6
    )


@pytest.mark.parametrize("wheels", [3, 5, 6])
def test_any_number_of_wheels_will_do(wheels: int) -> None:
    """Evenly spaced, each bears its share, and forward and sideways no more than the sum of |sin| or |cos| of it."""
    azimuths = 2 * np.pi * np.arange(wheels) / wheels + np.pi / wheels
    limits = compute_traction_limits(Kinematics(azimuths, ARM, RADIUS), 0.5)
    most = 0.5 * G * np.array([np.abs(np.sin(azimuths)).mean(), np.abs(np.cos(azimuths)).mean()])
    assert (np.array(limits) <= most * (1 + 1e-6)).all()
    if wheels == 6:  # opposite wheels push alike, and leave no moment
        assert limits == pytest.approx(most, rel=1e-6)


def test_wheels_that_a_robot_does_not_stand_on_are_refused() -> None:
    with pytest.raises(OmniError, match="topple"):
        compute_traction_limits(Kinematics(np.radians([30.0, 60.0, 80.0]), ARM, RADIUS), 0.8)

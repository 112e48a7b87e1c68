"""Laws of what wheels can do at once, against forces found wheel by wheel."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benches.control import compute_max_acceleration
from hypothesis import given
from hypothesis import strategies as st
from random_motion import TIGERS, G, solve_max_scale, vectors, wheels

from omni_control import OmniError, WheelLimits


@given(wheels, vectors, vectors)
def test_no_forces_give_more(
    robot: WheelLimits, asked: tuple[float, ...], travel: tuple[float, ...]
) -> None:
    """At so many times the acceleration as forces of single wheels can give at best, the whole friction is needed."""
    times = solve_max_scale(robot, np.array(asked), np.array(travel))
    share = robot.compute_friction_utilization(times * np.array([asked]), np.array([travel]))
    assert share[0] == pytest.approx(1, rel=1e-6)  # of the solver


def test_pushing_needs_what_traction_says_and_turning_all_wheels_alike() -> None:
    """Without drag: 1 at the traction ahead; and a moment of mu g m arm, of wheels that all slide one way."""
    robot = replace(TIGERS, carpet_drag=0.0, roller_friction=0.0)
    still = np.zeros((1, 3))
    ahead = compute_max_acceleration(robot.kinematics, 0.45, 0.0, 0.045)
    assert robot.compute_friction_utilization(np.array([[ahead, 0, 0]]), still)[0] == pytest.approx(
        1
    )
    spun = 0.45 * G * 0.083 / 0.0695**2
    assert robot.compute_friction_utilization(np.array([[0, 0, spun]]), still)[0] == pytest.approx(
        1
    )


@given(wheels, st.floats(0.3, 6), st.floats(0.3, 6), st.floats(1, 100))
def test_what_is_spared_for_all_at_once_is_enough_for_each(
    robot: WheelLimits, ahead: float, aside: float, turning: float
) -> None:
    """Of any acceleration on the ellipse with turning either way, at any travel, whatever it drags."""
    spare = robot.compute_acceleration_margin(ahead, aside, turning)
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    for sign in (1, -1):
        asked = spare * np.stack(
            [ahead * np.cos(angles), aside * np.sin(angles), np.full(48, sign * turning)], axis=1
        )
        for way in (
            np.stack([np.cos(angles + lag), np.sin(angles + lag), 10 * np.cos(lag + 0 * angles)], 1)
            for lag in range(6)
        ):
            assert robot.compute_friction_utilization(asked, way).max() <= 1 + 1e-9


def test_numbers_that_cannot_be_are_refused() -> None:
    for name, bad in (
        ("friction", 0.0),
        ("gyration_radius", -1.0),
        ("max_rim_speed", math.nan),
        ("carpet_drag", -0.1),
    ):
        with pytest.raises(OmniError, match=f"the {name.replace('_', ' ')} of wheels must"):
            replace(TIGERS, **{name: bad})


def test_wheels_that_cannot_pull_what_drags_them_are_refused() -> None:
    with pytest.raises(
        OmniError, match=r"friction 0.2 the wheels cannot overcome drag, which is 1\.\d+ times"
    ):
        replace(TIGERS, friction=0.2)

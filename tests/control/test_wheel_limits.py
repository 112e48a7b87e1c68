"""Combined limits of wheels, against forces that are found wheel by wheel."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from random_motion import TIGERS, G, get_axles, solve_max_scale, vectors, wheels

from omni_control import OmniError, WheelLimits


@given(wheels, vectors, vectors)
def test_the_largest_feasible_acceleration_needs_all_friction(
    robot: WheelLimits, acceleration: tuple[float, ...], twist: tuple[float, ...]
) -> None:
    assume(np.abs(get_axles(robot) @ twist[:2]).min() > 1e-9)  # bearings need a direction
    scale = solve_max_scale(robot, np.array(acceleration), np.array(twist))
    utilization = robot.compute_friction_utilization(
        scale * np.array([acceleration]), np.array([twist])
    )
    assert utilization[0] == pytest.approx(1, rel=1e-6)  # of the solver


def test_the_limits_of_driving_forward_and_of_turning_have_closed_forms() -> None:
    """Without drag, and with a moment of mu m g arm where all wheels slide in one direction."""
    robot = replace(TIGERS, rolling_resistance=0.0, roller_friction=0.0)
    forward = WheelLimits(robot.kinematics, 0.45, 1.0, 0.045).compute_max_acceleration(0.0)
    turning = 0.45 * G * 0.083 / 0.0695**2
    for acceleration in ([forward, 0, 0], [0, 0, turning]):
        utilization = robot.compute_friction_utilization(np.array([acceleration]), np.zeros((1, 3)))
        assert utilization[0] == pytest.approx(1)


@given(wheels, st.floats(-4, 4))
def test_the_highest_acceleration_overcomes_the_drag_of_its_direction(
    robot: WheelLimits, direction: float
) -> None:
    travel = np.array([math.cos(direction), math.sin(direction), 0.0])
    assume(np.abs(get_axles(robot) @ travel[:2]).min() > 1e-9)
    limit = solve_max_scale(robot, travel, travel)
    assert robot.compute_max_acceleration(direction) == pytest.approx(limit, rel=1e-6)


@given(wheels, st.floats(0.3, 6), st.floats(0.3, 6), st.floats(1, 100))
def test_the_acceleration_margin_holds_in_all_directions(
    robot: WheelLimits, forward: float, sideways: float, turning: float
) -> None:
    """For all accelerations on the ellipse, turning to either side, and all directions of drag."""
    margin = robot.compute_acceleration_margin(forward, sideways, turning)
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    x, y = forward * np.cos(angles), sideways * np.sin(angles)
    for sign in (1, -1):
        acceleration = margin * np.stack([x, y, np.full(48, sign * turning)], axis=1)
        for phase in range(6):
            turn_rate = 10 * np.cos(phase + 0 * angles)
            twist = np.stack([np.cos(angles + phase), np.sin(angles + phase), turn_rate], 1)
            assert robot.compute_friction_utilization(acceleration, twist).max() <= 1 + 1e-9


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("friction", 0.0),
        ("gyration_radius", -1.0),
        ("max_rim_speed", math.nan),
        ("rolling_resistance", -0.1),
    ],
)
def test_numbers_out_of_range_are_refused(name: str, bad: float) -> None:
    with pytest.raises(OmniError, match=f"WheelLimits.{name} must be"):
        replace(TIGERS, **{name: bad})


def test_wheels_that_cannot_overcome_drag_are_refused() -> None:
    message = r"friction 0.2 the wheels cannot overcome drag, which is 1\.\d+ times"
    with pytest.raises(OmniError, match=message):
        replace(TIGERS, friction=0.2)

"""Drag of carpet and bearings, the friction circle, creep, patches and missing rollers."""

from typing import Any

import numpy as np
import pytest
from benches.plant import RADIUS_M, ROLLERS
from benches.robot import compute_drag
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from omni_mj.config.resolve import resolve_settings

ANGLE = st.floats(-4, 4)
FREE: dict[str, Any] = {"drivetrain": {"roller_friction": 0.0}}


@examples(max_examples=40)
@given(ANGLE, ANGLE, st.floats(0.02, 3), st.floats(0, 1), st.floats(-360, 360))
def test_drag_of_the_pile_depends_on_the_angle_to_its_fibers(
    direction: float, heading: float, speed: float, nap: float, fibers: float
) -> None:
    """Against the travel, p N (1 + nap cos), for any heading."""
    carpets: list[dict[str, Any]] = [
        {"rolling_resistance": 0.1, "nap": nap, "nap_direction_deg": fibers},
        {"rolling_resistance": 0.2},
    ]
    load = np.array([[7.0], [5.0], [6.0], [8.0]])
    forces = compute_drag(
        [resolve_settings({"carpet": carpet, **FREE}) for carpet in carpets],
        speed * unit_vector(direction),
        heading,
        load=load,
    )
    expected = -26 * np.array([0.1 * (1 + nap * np.cos(direction - np.radians(fibers))), 0.2])
    np.testing.assert_allclose(forces.force[0], expected * np.cos(direction - heading), atol=1e-12)
    np.testing.assert_allclose(forces.force[1], expected * np.sin(direction - heading), atol=1e-12)


def unit_vector(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def test_bearings_brake_along_axles_and_reduce_the_friction_circle() -> None:
    mu, b = 0.5, 0.2
    chosen = resolve_settings(
        {
            "carpet": {"rolling_resistance": 0.0, "friction": mu},
            "drivetrain": {"roller_friction": b},
        }
    )
    azimuths = np.radians(resolve_settings().wheels.azimuths_deg)
    forces = compute_drag([chosen], [1.0, 0.0])
    assert forces.force[0][0] == pytest.approx(-b * np.abs(np.cos(azimuths)).sum())
    np.testing.assert_allclose(forces.torque_per_load, RADIUS_M * np.sqrt(mu**2 - b**2))
    at_rest = compute_drag([chosen], [0.0, 0.0])
    np.testing.assert_allclose(at_rest.torque_per_load, RADIUS_M * mu, rtol=1e-9)


def test_slip_compliance_grows_with_the_speed_of_travel() -> None:
    """s R = |v| t / (R N C): compliance is slip speed over torque, times normal force."""
    stiffness = 2.5
    chosen = resolve_settings({"drivetrain": {"creep_stiffness": stiffness}})
    for speed in (0.0, 0.5, 2.0):
        forces = compute_drag([chosen], [0.6 * speed, 0.8 * speed])
        np.testing.assert_allclose(
            forces.slip_compliance, speed / (RADIUS_M**2 * stiffness), atol=1e-9
        )


def test_friction_under_a_wheel_is_that_of_the_last_patch() -> None:
    """Robots with none, one, and several patches, which front wheels reach before rear wheels."""
    patches = [(), ((1.0, 0.0, 0.5, 0.3),), ((1.0, 0.0, 0.5, 0.3), (1.0, 0.0, 0.45, 0.6))]
    chosen = [
        resolve_settings({"carpet": {"friction": 0.8, "patches": robot_patches}, **FREE})
        for robot_patches in patches
    ]
    is_front = np.cos(np.radians(resolve_settings().wheels.azimuths_deg)) > 0
    for x, expected in ((0.0, [0.8, 0.8, 0.8]), (0.5, [0.8, 0.3, 0.3]), (1.0, [0.8, 0.3, 0.6])):
        drag = compute_drag(chosen, [0.0, 0.0], position=[x, 0.0])
        friction = drag.torque_per_load / RADIUS_M
        np.testing.assert_allclose(friction[is_front].mean(0), expected, rtol=1e-9)
        np.testing.assert_allclose(
            friction[~is_front].mean(0), [0.8, 0.3, 0.6] if x == 1 else 0.8, rtol=1e-9
        )


def test_a_wheel_has_no_friction_where_its_rollers_are_missing() -> None:
    missing_angle = np.array([[0.0], [1.0], [3.0], [16.0]]) * 2 * np.pi / ROLLERS
    has_friction = []
    for angle in np.linspace(-6 * np.pi, 6 * np.pi, 48 * ROLLERS, endpoint=False) + 0.01:
        drag = compute_drag(
            [resolve_settings()], [1.0, 0.0], missing_angle=missing_angle, angle=angle
        )
        has_friction.append(drag.torque_per_load[:, 0] > 1e-9)
    np.testing.assert_allclose(
        1 - np.mean(has_friction, axis=0), missing_angle[:, 0] / (2 * np.pi), atol=1e-12
    )

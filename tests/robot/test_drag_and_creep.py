"""Drag of carpet and bearings, the friction circle, creep, patches and missing rollers."""

from typing import Any

import numpy as np
import pytest
from benches.plant import RADIUS_M, ROLLERS
from benches.robot import drag
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from omni_mj.config.settings import Settings

ANGLE = st.floats(-4, 4)
FREE: dict[str, Any] = {"drivetrain": {"roller_friction": 0.0}}


@examples(max_examples=40)
@given(ANGLE, ANGLE, st.floats(0.02, 3), st.floats(0, 1), st.floats(-360, 360))
def test_the_pile_drags_by_the_angle_to_its_fibres(
    way: float, heading: float, speed: float, nap: float, fibres: float
) -> None:
    """Against the travel, p N (1 + nap cos) in all, whatever the heading."""
    carpets: list[dict[str, Any]] = [
        {"rolling_resistance": 0.1, "nap": nap, "nap_direction_deg": fibres},
        {"rolling_resistance": 0.2},
    ]
    load = np.array([[7.0], [5.0], [6.0], [8.0]])
    found = drag(
        [Settings(carpet=each, **FREE) for each in carpets],
        speed * direction(way),
        heading,
        load=load,
    )
    expected = -26 * np.array([0.1 * (1 + nap * np.cos(way - np.radians(fibres))), 0.2])
    np.testing.assert_allclose(found.forward_force, expected * np.cos(way - heading), atol=1e-12)
    np.testing.assert_allclose(found.sideways_force, expected * np.sin(way - heading), atol=1e-12)


def direction(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def test_bearings_brake_along_the_axles_and_take_their_part_of_the_friction_circle() -> None:
    mu, b = 0.5, 0.2
    chosen = Settings(
        carpet={"rolling_resistance": 0.0, "friction": mu}, drivetrain={"roller_friction": b}
    )
    azimuths = np.radians(Settings().wheels.azimuths_deg)
    found = drag([chosen], [1.0, 0.0])
    assert found.forward_force[0] == pytest.approx(-b * np.abs(np.cos(azimuths)).sum())
    np.testing.assert_allclose(found.torque_per_load, RADIUS_M * np.sqrt(mu**2 - b**2))
    along = drag([chosen], [0.0, 0.0])
    np.testing.assert_allclose(along.torque_per_load, RADIUS_M * mu, rtol=1e-9)


def test_rubber_is_softer_the_faster_a_wheel_travels() -> None:
    """s R = |v| t / (R N C): softness is slip speed over torque, times load."""
    stiffness = 2.5
    chosen = Settings(drivetrain={"creep_stiffness": stiffness})
    for speed in (0.0, 0.5, 2.0):
        found = drag([chosen], [0.6 * speed, 0.8 * speed])
        np.testing.assert_allclose(
            found.slip_compliance, speed / (RADIUS_M**2 * stiffness), atol=1e-9
        )


def test_friction_is_that_of_the_last_patch_under_a_wheel() -> None:
    """Robots with none, one, and several patches; wheels ahead are in them, those behind are not."""
    patches = [(), ((1.0, 0.0, 0.5, 0.3),), ((1.0, 0.0, 0.5, 0.3), (1.0, 0.0, 0.45, 0.6))]
    chosen = [Settings(carpet={"friction": 0.8, "patches": each}, **FREE) for each in patches]
    ahead = np.cos(np.radians(Settings().wheels.azimuths_deg)) > 0
    for place, expected in ((0.0, [0.8, 0.8, 0.8]), (0.5, [0.8, 0.3, 0.3]), (1.0, [0.8, 0.3, 0.6])):
        found = drag(chosen, [0.0, 0.0], place=[place, 0.0]).torque_per_load / RADIUS_M
        np.testing.assert_allclose(found[ahead].mean(0), expected, rtol=1e-9)
        np.testing.assert_allclose(
            found[~ahead].mean(0), [0.8, 0.3, 0.6] if place == 1 else 0.8, rtol=1e-9
        )


def test_a_wheel_grips_nothing_where_its_rollers_are_missing() -> None:
    gap = np.array([[0.0], [1.0], [3.0], [16.0]]) * 2 * np.pi / ROLLERS
    grips = []
    for angle in np.linspace(-6 * np.pi, 6 * np.pi, 48 * ROLLERS, endpoint=False) + 0.01:
        grips.append(
            drag([Settings()], [1.0, 0.0], missing_angle=gap, angle=angle).torque_per_load[:, 0]
            > 1e-9
        )
    np.testing.assert_allclose(1 - np.mean(grips, axis=0), gap[:, 0] / (2 * np.pi), atol=1e-12)

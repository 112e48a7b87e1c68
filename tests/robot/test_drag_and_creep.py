"""Drag of carpet and bearings, the friction circle, creep, patches and missing rollers."""

from typing import Any

import numpy as np
import pytest
from benches.creep import CONTACT_RATIO, contact_speed, slip_of_traction, traction_per_load
from benches.plant import OUTWARD, RADIUS_M, ROLLERS, TANGENTS
from benches.robot import compute_drag
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.settings import Settings
from omni_mj.robot.wheel_carpet_forces import AT_REST_M_S

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


def without_bearing_friction(friction: float, creep_stiffness: float) -> Settings:
    """Return a robot whose rims use the whole friction circle."""
    drivetrain = {"creep_stiffness": creep_stiffness, "roller_friction": 0.0}
    return resolve_settings({"carpet": {"friction": friction}, "drivetrain": drivetrain})


@given(
    slip=st.floats(-2, 2),
    velocity=st.tuples(st.floats(-4, 4), st.floats(-4, 4)),
    friction=st.floats(0.1, 1.2),
    stiffness=st.floats(1, 20),
    load=st.floats(0.1, 20),
)
def test_traction_over_slip_is_pacejkas_cubic(
    slip: float, velocity: tuple[float, float], friction: float, stiffness: float, load: float
) -> None:
    """The traction is the slip over its compliance, up to Coulomb's limit."""
    robot = without_bearing_friction(friction, stiffness)
    drag = compute_drag([robot], velocity, load=load, slip_speed=slip / RADIUS_M)
    center = np.stack([TANGENTS @ velocity, OUTWARD @ velocity], axis=-1)
    is_moving = contact_speed(center) > AT_REST_M_S
    compliance = np.maximum(drag.slip_compliance[:, 0], 1e-9) / load  # rad/s per N m
    torque = np.clip(slip / RADIUS_M / compliance, *drag.torque_per_load[:, 0] * [[-load], [load]])
    expected = traction_per_load(slip, center, stiffness, friction) * load * RADIUS_M
    np.testing.assert_allclose(torque[is_moving], expected[is_moving], rtol=1e-6, atol=1e-9)


@examples(max_examples=40)
@given(st.floats(0.01, 1.3), st.floats(-4, 4), st.floats(0.05, 3))
def test_the_cubic_sums_up_bristles_that_cross_an_elliptic_contact(
    sliding_fraction: float, angle: float, speed: float
) -> None:
    """Rubber enters unstrained, is strained at the slip speed, and holds mu times the pressure."""
    friction, stiffness, length = 0.7, 5.0, 1e-3
    velocity = speed * unit_vector(angle)
    # Path through the middle of the ellipse x^2 + (rho y)^2 = (length / 2)^2
    path = length / np.sqrt(np.cos(angle) ** 2 + (CONTACT_RATIO * np.sin(angle)) ** 2)
    slip = sliding_fraction * 3 * friction / stiffness * contact_speed(velocity)
    place = (np.arange(4000) + 0.5) / 4000  # along the path
    pressure = 6 * place * (1 - place)
    # Rubber that sticks all along the path has the traction C N slip / (speed in path lengths).
    strain = slip * place * path / speed
    stress = np.minimum(2 * stiffness / length * strain, friction * pressure)
    expected = traction_per_load(slip, velocity, stiffness, friction)
    assert stress.mean() == pytest.approx(expected, rel=1e-4)


@examples(max_examples=40)
@given(st.floats(0, 0.98), st.floats(0, 0.98))
def test_slip_under_a_constant_traction_converges_to_the_law(start: float, load: float) -> None:
    """Each update finds the slip of the stiffness at the slip before it."""
    friction, stiffness, velocity = 0.8, 4.0, [0.6, 0.8]
    robot = without_bearing_friction(friction, stiffness)
    center = np.stack([TANGENTS @ velocity, OUTWARD @ velocity], axis=-1)
    expected = slip_of_traction(load * friction, center, stiffness, friction)
    slip = slip_of_traction(start * friction, center, stiffness, friction)
    errors = [slip - expected]
    for _ in range(100):
        drag = compute_drag([robot], velocity, slip_speed=slip[:, None] / RADIUS_M)
        slip = drag.slip_compliance[:, 0] * load * friction * RADIUS_M * RADIUS_M
        errors.append(slip - expected)
    sizes = np.abs(errors)
    assert (sizes[1:] <= sizes[:-1] + 1e-12).all()
    # The factor is x (1 - 2 x / 3) / (1 - x + x^2 / 3), 0.9 at the largest traction.
    assert sizes[-1].max() < 1e-3 * sizes[0].max() + 1e-9


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


def test_a_worn_wheel_is_worn_on_a_patch_too() -> None:
    wear = np.array([[1.0], [0.5], [0.9], [1.1]])
    for patches in ((), ((0.0, 0.0, 1.0, 0.3),)):
        chosen = resolve_settings({"carpet": {"friction": 0.8, "patches": patches}, **FREE})
        drag = compute_drag([chosen], [0.0, 0.0], friction_factor=wear)
        friction = 0.3 if patches else 0.8
        np.testing.assert_allclose(drag.torque_per_load, RADIUS_M * friction * wear)


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

"""Payloads: mass, center of mass, inertia, and normal forces of the wheels."""

import mujoco
import numpy as np
import pytest
from benches.plant import (
    COM_HEIGHT_M,
    CONTACTS,
    FRAME_S,
    GRAVITY,
    ICE,
    MASS_KG,
    ROLLING_KG,
    SETTLE_FRAMES,
    TWO_ROLLERS,
    mass_matrices,
    noiseless,
    on_all_wheels,
    planar,
    stand_still,
    wheel_loads,
    with_faults,
)
from benches.plant import mujoco as plant_of
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omni_mj.plants.mujoco_plant import MujocoPlant


def get_chassis(plant: MujocoPlant, row: int) -> tuple[float, NDArray, NDArray]:
    """Return mass, center of mass, and inertia about it in body axes, from the batch."""
    body = plant._world.robots[0].chassis
    mass, center, moments, quaternion = (
        plant._batch.expand(name)[row, body]
        for name in ("body_mass", "body_ipos", "body_inertia", "body_iquat")
    )
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, quaternion)
    axes = axes.reshape(3, 3)
    return float(mass), center.copy(), axes @ np.diag(moments) @ axes.T


def inertia_about(origin: NDArray, body: tuple[float, NDArray, NDArray]) -> NDArray:
    mass, center, inertia = body
    r = center - origin
    return inertia + mass * (r @ r * np.eye(3) - np.outer(r, r))


@hypothesis_settings(max_examples=6)
@given(st.lists(st.tuples(st.floats(0, 20), st.floats(0.001, 0.5)), min_size=1, max_size=3))
def test_a_payload_is_a_point_mass_on_the_chassis(loads: list[tuple[float, float]]) -> None:
    """Mass, first and second moments about the origin, in any axes, are sums over the bodies."""
    payloads = [{"kind": "payload", "start_s": 0.0, "mass_kg": m, "height_m": h} for m, h in loads]
    plant = plant_of([with_faults(*payloads), noiseless()])
    empty = get_chassis(plant, 0)
    stand_still(plant, 1)
    loaded, other_robot = get_chassis(plant, 0), get_chassis(plant, 1)
    points = [(m, np.array([*empty[1][:2], h])) for m, h in loads]
    assert loaded[0] == pytest.approx(empty[0] + sum(m for m, _ in points))
    np.testing.assert_allclose(
        loaded[0] * loaded[1], empty[0] * empty[1] + sum(m * r for m, r in points), atol=1e-12
    )
    zero = np.zeros(3)
    expected = inertia_about(zero, empty) + sum(
        inertia_about(zero, (m, r, np.zeros((3, 3)))) for m, r in points
    )
    np.testing.assert_allclose(
        inertia_about(zero, loaded), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )
    np.testing.assert_array_equal(other_robot[2], empty[2])
    subtree = plant._batch.expand("body_subtreemass")[0, plant._world.robots[0].chassis]
    assert subtree == pytest.approx(MASS_KG + sum(m for m, _ in points))


def test_wheels_carry_the_weight_and_inertia_of_a_payload() -> None:
    """Sum of the normal forces, their center below the center of mass, and a push on ice."""
    mass, height = 1.2, 0.12
    high_load, load = (
        {"kind": "payload", "mass_kg": mass, "height_m": height},
        {"kind": "payload", "mass_kg": mass},
    )
    tilt = {"kind": "tilt", "angle_deg": 5.0}
    faults_by_row = (high_load,), (load,), (high_load, tilt), (tilt,)
    # Otherwise gears would hold the robot on the slope up to 3 degrees only.
    blocked = on_all_wheels("motor-blocked")
    settings = [with_faults(*faults, *blocked, **TWO_ROLLERS) for faults in faults_by_row]
    plant = plant_of([*settings, noiseless(**TWO_ROLLERS)])
    stand_still(plant, SETTLE_FRAMES + 60)
    forces = wheel_loads(plant)
    np.testing.assert_allclose(forces[:2].sum(1), (MASS_KG + mass) * GRAVITY, rtol=2e-3)
    center_x = forces @ CONTACTS[:, 0] / GRAVITY
    chassis = plant._world.model.body_ipos[plant._world.robots[0].chassis]
    # The payload is above the chassis' center of mass. Springs still oscillate: by 2 % of the shift
    # by the slope, and by 0.03 mm of the center.
    assert center_x[0] - center_x[4] == pytest.approx(mass * chassis[0], abs=1e-4)
    angle = np.radians(5.0)
    shift = (center_x[2] - np.cos(angle) * center_x[0]) - (
        center_x[3] - np.cos(angle) * center_x[4]
    )
    assert shift == pytest.approx(mass * height * np.sin(angle), rel=0.02)

    force = {
        "kind": "push",
        "start_s": 2 * SETTLE_FRAMES * FRAME_S,
        "force_n": 12.0,
        "direction_deg": 90.0,
    }
    plant = plant_of([with_faults(load, force, **ICE), with_faults(force, **ICE)])
    stand_still(plant, 2 * SETTLE_FRAMES + 8)
    heavy, light = plant.twist()[:, 1]
    ratio = (MASS_KG + ROLLING_KG[1]) / (MASS_KG + mass + ROLLING_KG[1])
    # Friction of ice is 2.5 % of this push, and in proportion to mass. Rollers that come down take
    # 1 %.
    drag = 0.01 * GRAVITY / 12.0
    assert heavy / light == pytest.approx(
        ratio * (1 - (MASS_KG + mass) * drag) / (1 - MASS_KG * drag), rel=0.01
    )


def test_a_payload_on_the_plant_planar_is_a_point_mass_at_its_height() -> None:
    """Mass matrix about the wheels' center, and normal forces on a slope, by Newton's laws.

    The payload is above the center of mass of the chassis, which is the robot without its wheels of
    68 g each.
    """
    mass, height, com_x, angle = 8.0, 0.11, -0.03, np.radians(4.0)
    x = (MASS_KG * com_x - 0.068 * CONTACTS[:, 0].sum()) / (MASS_KG - 4 * 0.068)
    body = {"com_x_m": com_x}
    load = {"kind": "payload", "start_s": 0.0, "mass_kg": mass, "height_m": height}
    tilt = {"kind": "tilt", "angle_deg": 4.0}
    blocked = on_all_wheels("motor-blocked")
    matrices = []
    for faults in ((), (load,)):
        plant = planar([with_faults(*faults, body=body)])
        stand_still(plant, 1)
        r_x, r_y = -plant.parameters.body.center[:, 0]
        twist_of_center = np.array([[1.0, 0, -r_y], [0, 1, r_x], [0, 0, 1]])
        matrices.append(twist_of_center.T @ mass_matrices(plant)[0] @ twist_of_center)
    expected = mass * np.array([[1.0, 0, 0], [0, 1, x], [0, x, x**2]])
    # Loaded wheels roll on a smaller radius, which changes the share of the rims a little.
    added = matrices[1] - matrices[0]
    np.testing.assert_allclose(added[:2, :2], expected[:2, :2], atol=2e-3)
    np.testing.assert_allclose(added[2, :2], expected[2, :2], atol=3e-5)
    assert added[2, 2] == pytest.approx(expected[2, 2], abs=5e-6)

    plant = planar([with_faults(load, tilt, *blocked, body=body)])
    stand_still(plant, SETTLE_FRAMES + 60)
    forces, weight = wheel_loads(plant)[0], (MASS_KG + mass) * GRAVITY
    assert plant.twist()[0, 0] == pytest.approx(0, abs=1e-3)
    assert forces.sum() == pytest.approx(weight * np.cos(angle), rel=1e-3)
    moments = (
        (MASS_KG * com_x + mass * x) * np.cos(angle)
        + (MASS_KG * COM_HEIGHT_M + mass * height) * np.sin(angle)
    ) * GRAVITY
    assert forces @ CONTACTS[:, 0] == pytest.approx(moments, abs=0.02 * abs(moments))

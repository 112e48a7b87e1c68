"""What motors that are dead or stuck, and wheels that have lost rubber or rollers, do to robots on both plants."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benches.plant import (
    FRAME_S,
    RADIUS_M,
    ROLLERS,
    TANGENTS,
    WHEELED_PLANTS,
    constant,
    drive,
    ramp,
    with_faults,
)

from omni_mj.config.settings import Settings

PlantOf = Callable[[list[Settings]], Any]
AHEAD = np.array([1.0, 0.0, 0.0])


def all_wheels(kind: str, **values: Any) -> list[dict[str, Any]]:
    return [{"kind": kind, "wheel": wheel, "start_s": 0.0, **values} for wheel in (1, 2, 3, 4)]


@WHEELED_PLANTS
def test_a_dead_motor_has_no_current_and_is_dragged_along(plant_of: PlantOf) -> None:
    """At its terminals there is its back-EMF; its wheel turns as the robot goes. After that it pulls again."""
    smooth: dict[str, Any] = {
        "motor": {"no_load_current_a": 0.0},
        "drivetrain": {"gear_friction_nm": 0.0},
    }
    plant = plant_of(
        [
            with_faults({"kind": "motor-dead", "wheel": 2, "duration_s": 20 * FRAME_S}, **smooth),
            with_faults(**smooth),
        ]
    )
    drive(plant, ramp([AHEAD] * 2, 2.0, 32))
    told, motor = plant.telemetry(), Settings().motor
    assert abs(told.current_mean[0, 1]) < 1e-9
    assert abs(told.current_mean[1, 1]) > 1e-3
    back_emf = motor.torque_constant_nm_a * motor.gear_ratio * told.wheel_speed[0, 1]
    assert told.voltage[0, 1] == pytest.approx(
        back_emf, rel=0.02
    )  # of a cycle before, and magnets that warm up
    x, y, turn = plant.twist()[0]
    heading = plant.pose()[0, 2]
    body = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]]) @ (
        x,
        y,
    )
    rolls = (TANGENTS[1] @ body + Settings().wheels.arm_m * turn) / RADIUS_M
    # Nothing brakes it but what its own inertia and its rollers take: 3 % of its speed.
    assert told.wheel_speed[0, 1] == pytest.approx(rolls, rel=0.03)
    drive(plant, constant(AHEAD, 3, 2))
    assert abs(plant.telemetry().current_mean[0, 1]) > 0.01


@WHEELED_PLANTS
def test_a_blocked_wheel_does_not_turn_and_its_motor_stalls(plant_of: PlantOf) -> None:
    """I = V / R; it slides as fast as the carpet passes. After that it turns as before."""
    plant = plant_of(
        [
            with_faults(
                {"kind": "motor-blocked", "wheel": 3, "start_s": 0.0, "duration_s": 20 * FRAME_S}
            ),
            with_faults(),
        ]
    )
    drive(plant, ramp([AHEAD] * 2, 2.0, 20))
    told, motor = plant.telemetry(), Settings().motor
    assert abs(told.wheel_speed[0, 2]) < 0.02
    resistance = motor.resistance_ohm * (
        1 + motor.winding_resistance_per_k * (told.winding[0, 2] - 25)
    )
    np.testing.assert_allclose(told.current[0, 2], told.voltage[0, 2] / resistance, rtol=2e-3)
    assert np.abs(told.current[0, 2]) > 1
    x, y, turn = plant.twist()[0]
    heading = plant.pose()[0, 2]
    body = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]]) @ (
        x,
        y,
    )
    passes = abs(TANGENTS[2] @ body + Settings().wheels.arm_m * turn)
    assert told.slip[0, 2] == pytest.approx(passes, rel=0.03, abs=0.01)
    drive(plant, constant(AHEAD, 40, 2))
    assert abs(plant.telemetry().wheel_speed[0, 2]) > 0.5 * abs(plant.telemetry().wheel_speed[1, 2])


@WHEELED_PLANTS
def test_wheels_that_are_worn_alike_are_a_carpet_of_as_much_less_friction(
    plant_of: PlantOf,
) -> None:
    """To the bit; friction is a factor of both."""
    friction, worn = 0.8, 0.5
    one = with_faults(*all_wheels("wheel-worn", factor=worn), carpet={"friction": friction})
    other = with_faults(
        {"kind": "friction", "start_s": 0.0, "friction": friction * worn},
        carpet={"friction": friction},
    )
    poses = drive(plant_of([one, other, with_faults()]), constant([3.0, 0.5, 2.0], 15, 3))
    np.testing.assert_array_equal(poses[:, 0], poses[:, 1])
    assert poses[-1, 0, 0] < 0.9 * poses[-1, 2, 0]


@WHEELED_PLANTS
def test_wheels_without_half_of_their_rollers_pull_half_as_much(plant_of: PlantOf) -> None:
    """While all slide; their rims turn many times meanwhile."""
    slick: dict[str, Any] = {
        "carpet": {"friction": 0.2, "rolling_resistance": 0.0},
        "drivetrain": {"roller_friction": 0.0, "roller_damping_nm_s": 0.0},
        "firmware": {"turn_rate_gain": 0.0},
    }
    plant = plant_of(
        [
            with_faults(*all_wheels("wheel-missing-rollers", rollers=ROLLERS // 2), **slick),
            with_faults(**slick),
        ]
    )
    drive(plant, constant([5.0, 0.0, 0.0], 30, 2))
    half, whole = plant.twist()[:, 0]
    # 5 %: the first turns, of wheels that speed up, and rollers that are spun up.
    assert half / whole == pytest.approx(0.5, abs=0.05)

"""Faults of wheels on both plants: dead and blocked motors, wear, missing rollers."""

from typing import Any

import numpy as np
import pytest
from benches.plant import (
    ARM_M,
    FRAME_S,
    RADIUS_M,
    ROLLERS,
    TANGENTS,
    WHEELED_PLANTS,
    PlantOf,
    constant,
    drive,
    on_all_wheels,
    ramp,
    with_faults,
)

from omni_control.kinematics import world_to_body
from omni_mj.config.resolve import resolve_settings

FORWARD = np.array([1.0, 0.0, 0.0])


def rolling_speed(plant: Any, wheel: int) -> float:
    """Return the rim speed at which a wheel of the first robot rolls without slip, m/s."""
    x, y, turn = world_to_body(plant.twist()[0], plant.pose()[0, 2])
    return TANGENTS[wheel] @ (x, y) + ARM_M * turn


@WHEELED_PLANTS
def test_a_dead_motor_has_no_current_and_its_wheel_rolls(plant_of: PlantOf) -> None:
    """Its voltage is the back-EMF; its wheel rolls with the robot. Afterwards it drives again."""
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
    drive(plant, ramp([FORWARD] * 2, 2.0, 32))
    telemetry, motor = plant.telemetry(), resolve_settings().motor
    assert abs(telemetry.current_mean[0, 1]) < 1e-9
    assert abs(telemetry.current_mean[1, 1]) > 1e-3
    back_emf = motor.wheel_back_emf_v_s * telemetry.wheel_speed[0, 1]
    # The voltage is one cycle older than the speed, and magnets warm up.
    assert telemetry.voltage[0, 1] == pytest.approx(back_emf, rel=0.02)
    # Only its inertia and its rollers brake it, by 3 % of its speed.
    assert telemetry.wheel_speed[0, 1] == pytest.approx(
        rolling_speed(plant, 1) / RADIUS_M, rel=0.03
    )
    drive(plant, constant(FORWARD, 3, 2))
    assert abs(plant.telemetry().current_mean[0, 1]) > 0.01


@WHEELED_PLANTS
def test_a_blocked_wheel_does_not_turn_and_its_motor_stalls(plant_of: PlantOf) -> None:
    """I = V / R; it slides at the speed of the carpet. Afterwards it turns again."""
    plant = plant_of(
        [
            with_faults(
                {"kind": "motor-blocked", "wheel": 3, "start_s": 0.0, "duration_s": 20 * FRAME_S}
            ),
            with_faults(),
        ]
    )
    drive(plant, ramp([FORWARD] * 2, 2.0, 20))
    telemetry, motor = plant.telemetry(), resolve_settings().motor
    assert abs(telemetry.wheel_speed[0, 2]) < 0.02
    resistance = motor.resistance_ohm * (
        1 + motor.winding_resistance_per_k * (telemetry.winding[0, 2] - 25)
    )
    np.testing.assert_allclose(
        telemetry.current[0, 2], telemetry.voltage[0, 2] / resistance, rtol=2e-3
    )
    assert np.abs(telemetry.current[0, 2]) > 1
    assert telemetry.slip[0, 2] == pytest.approx(abs(rolling_speed(plant, 2)), rel=0.03, abs=0.01)
    drive(plant, constant(FORWARD, 40, 2))
    assert abs(plant.telemetry().wheel_speed[0, 2]) > 0.5 * abs(plant.telemetry().wheel_speed[1, 2])


@WHEELED_PLANTS
def test_equal_wear_of_all_wheels_acts_like_less_friction_of_the_carpet(
    plant_of: PlantOf,
) -> None:
    """Bit for bit, because friction is the product of both."""
    friction, worn = 0.8, 0.5
    worn_wheels = with_faults(
        *on_all_wheels("wheel-worn", factor=worn), carpet={"friction": friction}
    )
    slippery_carpet = with_faults(
        {"kind": "friction", "start_s": 0.0, "friction": friction * worn},
        carpet={"friction": friction},
    )
    poses = drive(
        plant_of([worn_wheels, slippery_carpet, with_faults()]), constant([3.0, 0.5, 2.0], 15, 3)
    )
    np.testing.assert_array_equal(poses[:, 0], poses[:, 1])
    assert poses[-1, 0, 0] < 0.9 * poses[-1, 2, 0]


@WHEELED_PLANTS
def test_sliding_wheels_with_half_of_their_rollers_have_half_the_traction(
    plant_of: PlantOf,
) -> None:
    """While all wheels slide, and rims turn many times."""
    slick: dict[str, Any] = {
        "carpet": {"friction": 0.2, "rolling_resistance": 0.0},
        "drivetrain": {"roller_friction": 0.0, "roller_damping_nm_s": 0.0},
        "firmware": {"turn_rate_gain": 0.0},
    }
    plant = plant_of(
        [
            with_faults(*on_all_wheels("wheel-missing-rollers", rollers=ROLLERS // 2), **slick),
            with_faults(**slick),
        ]
    )
    drive(plant, constant([5.0, 0.0, 0.0], 30, 2))
    half, full = plant.twist()[:, 0]
    # 5 %: wheels and rollers spin up.
    assert half / full == pytest.approx(0.5, abs=0.05)

"""Faults of magnets, gyros and alpha, by the laws of motors and equation 7."""

import numpy as np
from benches.plant import (
    FRAME_S,
    SETTLE_FRAMES,
    TWO_ROLLERS,
    constant,
    drive,
    estimated_heading,
    noiseless,
    rows,
    stand_still,
    with_faults,
    with_settings,
)
from benches.plant import mujoco as plant_of

from omni_mj.config.resolve import resolve_settings
from omni_mj.plants.kinematic_plant import KinematicPlant


def test_a_demagnetized_motor_turns_by_its_torque_constant() -> None:
    """At full voltage without load, w = V / K, during the fault and afterwards."""
    factor, motor = 0.6, {"no_load_current_a": 0.0, "torque_factor": 1.0}
    slick = {
        "carpet": {"friction": 0.01},
        "drivetrain": {"gear_friction_nm": 0.0, "roller_friction": 0.0, "efficiency": 1.0},
    }
    fault = {
        "kind": "motor-demagnetized",
        "start_s": 0.0,
        "duration_s": 0.7,
        "wheel": 2,
        "factor": factor,
    }
    plant = plant_of(
        [
            with_faults(fault, motor=motor, **slick, **TWO_ROLLERS),
            noiseless(motor=motor, **slick, **TWO_ROLLERS),
        ]
    )
    expected = np.ones((2, 4))
    sheet = resolve_settings().motor
    for ratio in (factor, 1.0):
        drive(plant, constant([0, 0, 100.0], 42, 2))
        expected[0, 1], telemetry = ratio, plant.telemetry()
        assert (telemetry.duty_peak == 1).all()
        constants = sheet.torque_constant_nm_a * sheet.gear_ratio * expected
        # The rest of friction and acceleration as in test_variation.py, and magnets that warm up by
        # 2 K.
        np.testing.assert_allclose(telemetry.voltage / telemetry.wheel_speed, constants, rtol=5e-3)


def test_a_gyro_bias_turns_the_estimated_heading() -> None:
    """By bias times time, without correction by vision."""
    bias, frames = 0.4, 20
    fault = {"kind": "gyro-bias", "duration_s": frames * FRAME_S, "bias_rad_s": bias}
    no_vision = {"heading_gain": 0.0, "gyro_bias_gain": 0.0, "turn_rate_gain": 0.0}
    plant = plant_of([with_faults(fault, firmware=no_vision), noiseless(firmware=no_vision)])
    stand_still(plant, SETTLE_FRAMES + frames + 10)
    drift = estimated_heading(plant) - plant.pose()[:, 2]
    # The gyro measurement is one cycle old.
    np.testing.assert_allclose(drift, [bias * frames * FRAME_S, 0.0], atol=1e-4)


def test_a_fault_sets_alpha_in_place_of_the_drawn_value() -> None:
    """Equation 7 during the fault. Before, after, and in other rows alpha is the drawn value."""
    commands = np.random.default_rng(0).normal(size=(30, 2, 3))
    fault = {"kind": "alpha", "start_s": 10 * FRAME_S, "duration_s": 0.2, "alpha": 0.3}
    chosen = [with_settings(fault=[fault]), resolve_settings()]
    poses = drive(KinematicPlant(rows(chosen, [3, 3]), np.zeros((2, 3))), commands)
    steps = np.diff(poses, axis=0)
    np.testing.assert_allclose(steps[10:22, 0], 0.3 * FRAME_S * commands[10:22, 0], atol=1e-12)
    no_fault = [*range(10), *range(22, 30)]
    np.testing.assert_allclose(
        (steps / commands)[no_fault, 0], (steps / commands)[no_fault, 1], rtol=1e-9
    )
    single = drive(KinematicPlant(rows(chosen[:1], [3]), np.zeros((1, 3))), commands[:, :1])
    np.testing.assert_array_equal(single[:, 0], poses[:, 0])

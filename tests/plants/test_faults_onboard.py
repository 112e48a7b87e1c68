"""What breaks on robots, and what that does by laws of motors and wheels."""

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

from omni_mj.config.settings import Settings
from omni_mj.plants.kinematic import KinematicPlant


def test_a_weak_motor_pulls_and_turns_by_its_constant() -> None:
    """At full voltage, free of load: w = V / K, of the one wheel that is weak; and after that as before."""
    share, motor = 0.6, {"no_load_current_a": 0.0}
    slick = {
        "carpet": {"friction": 0.01},
        "drivetrain": {"gear_friction_nm": 0.0, "roller_friction": 0.0},
    }
    fault = {
        "kind": "motor-demagnetized",
        "start_s": 0.0,
        "duration_s": 0.7,
        "wheel": 2,
        "factor": share,
    }
    plant = plant_of(
        [
            with_faults(fault, motor=motor, **slick, **TWO_ROLLERS),
            noiseless(motor=motor, **slick, **TWO_ROLLERS),
        ]
    )
    expected = np.ones((2, 4))
    sheet = Settings().motor
    for weak in (share, 1.0):
        drive(plant, constant([0, 0, 100.0], 42, 2))
        expected[0, 1], told = weak, plant.telemetry()
        assert (told.duty_peak == 1).all()
        constants = sheet.torque_constant_nm_a * sheet.gear_ratio * expected
        # As in test_variation.py: what is left of friction 0.01 and of the run-up, and magnets that
        # warm up by 2 K.
        np.testing.assert_allclose(told.voltage / told.wheel_speed, constants, rtol=5e-3)


def test_a_gyros_bias_turns_what_a_robot_holds_for_its_heading() -> None:
    """By bias times time, where vision corrects nothing."""
    bias, frames = 0.4, 20
    fault = {"kind": "gyro-bias", "duration_s": frames * FRAME_S, "bias_rad_s": bias}
    blind = {"heading_gain": 0.0, "gyro_bias_gain": 0.0, "turn_rate_gain": 0.0}
    plant = plant_of([with_faults(fault, firmware=blind), noiseless(firmware=blind)])
    stand_still(plant, SETTLE_FRAMES + frames + 10)
    drift = estimated_heading(plant) - plant.pose()[:, 2]
    np.testing.assert_allclose(
        drift, [bias * frames * FRAME_S, 0.0], atol=1e-4
    )  # the gyro is a cycle late


def test_alpha_takes_the_place_of_what_is_drawn() -> None:
    """Equation 7 as a sum; before and after, and beside, what would have been drawn anyway."""
    commands = np.random.default_rng(0).normal(size=(30, 2, 3))
    fault = {"kind": "alpha", "start_s": 10 * FRAME_S, "duration_s": 0.2, "alpha": 0.3}
    chosen = [with_settings(fault=[fault]), Settings()]
    poses = drive(KinematicPlant(rows(chosen, [3, 3]), np.zeros((2, 3))), commands)
    moved = np.diff(poses, axis=0)
    np.testing.assert_allclose(moved[10:22, 0], 0.3 * FRAME_S * commands[10:22, 0], atol=1e-12)
    others = [*range(10), *range(22, 30)]
    np.testing.assert_allclose(
        (moved / commands)[others, 0], (moved / commands)[others, 1], rtol=1e-9
    )
    alone = drive(KinematicPlant(rows(chosen[:1], [3]), np.zeros((1, 3))), commands[:, :1])
    np.testing.assert_array_equal(alone[:, 0], poses[:, 0])

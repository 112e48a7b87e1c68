"""Faults of firmware and supply on both plants: timeout, restart, brown-out."""

from typing import Any

import numpy as np
import pytest
from benches.plant import (
    FRAME_S,
    WHEELED_PLANTS,
    PlantOf,
    constant,
    drive,
    estimated_heading,
    ramp,
    with_faults,
)

from omni_mj.config.resolve import resolve_settings
from omni_mj.network.radio import ReceivedCommand

TWIST = np.array([1.0, 0.4, 0.0])
START, DURATION = 30, 20  # frames


def fault(kind: str, **values: Any) -> dict[str, Any]:
    return {"kind": kind, "start_s": START * FRAME_S, "duration_s": DURATION * FRAME_S, **values}


@WHEELED_PLANTS
def test_a_firmware_timeout_acts_like_a_zero_command(plant_of: PlantOf) -> None:
    """Up to rounding; afterwards the robot applies commands again."""
    plant = plant_of([with_faults(fault("firmware-timeout")), with_faults()])
    commands = ramp([TWIST] * 2, 3.0, START + DURATION + 25).copy()
    commands[START : START + DURATION, 1] = 0.0
    commands[START + DURATION, 1] = 0.0  # the fault has ended, and the robot waits for a packet
    poses = drive(plant, commands)
    np.testing.assert_allclose(poses[:, 0], poses[:, 1], atol=1e-9)
    speeds = (
        np.linalg.norm(
            np.diff(poses[START + DURATION - 4 : START + DURATION, 0, :2], axis=0), axis=1
        )
        / FRAME_S
    )
    assert speeds.max() < 0.02
    assert np.linalg.norm(plant.twist()[0, :2]) > 0.8 * np.linalg.norm(TWIST)


@WHEELED_PLANTS
def test_a_brown_out_scales_the_voltage_of_the_motors(plant_of: PlantOf) -> None:
    """At full duty and without load, speeds are in proportion. The battery keeps its charge."""
    factor = 0.5
    slick: dict[str, Any] = {
        "carpet": {"friction": 0.01, "rolling_resistance": 0.0},
        "drivetrain": {"gear_friction_nm": 0.0, "roller_friction": 0.0},
        "motor": {"no_load_current_a": 0.0},
        "battery": {"resistance_ohm": 0.0},
    }
    brown_out = {"kind": "brown-out", "start_s": 0.0, "duration_s": 40 * FRAME_S, "factor": factor}
    plant = plant_of([with_faults(brown_out, **slick), with_faults(**slick)])
    drive(plant, constant([0, 0, 100.0], 40, 2))
    telemetry = plant.telemetry()
    assert (telemetry.duty_peak == 1).all()
    assert telemetry.battery[0] == pytest.approx(factor * telemetry.battery[1], rel=1e-4)
    # As in test_faults_onboard.py: the rest of friction and acceleration.
    np.testing.assert_allclose(
        telemetry.wheel_speed[0], factor * telemetry.wheel_speed[1], rtol=1e-2
    )
    drive(plant, constant([0, 0, 0.0], 2, 2))
    assert plant.telemetry().battery[0] == pytest.approx(telemetry.battery[1], rel=1e-3)


@WHEELED_PLANTS
def test_a_rebooting_robot_coasts_or_brakes(plant_of: PlantOf) -> None:
    """Without current, or with shorted windings, I = -K w / (R + X |w|), which dissipate energy."""
    plant = plant_of([with_faults(fault("reboot", motors=mode)) for mode in ("coast", "brake")])
    start = drive(plant, ramp([TWIST] * 2, 3.0, START))[-1]
    drive(plant, constant(TWIST, 3, 2))
    telemetry, motor = plant.telemetry(), resolve_settings().motor
    assert np.abs(telemetry.current_mean[0]).max() < 1e-9
    assert not telemetry.voltage_mean[1].any()
    speeds = telemetry.wheel_speed[1]
    resistance = motor.resistance_ohm + motor.commutation_ohm_s * motor.gear_ratio * np.abs(speeds)
    shorted = -motor.wheel_back_emf_v_s * speeds / resistance
    # The current is one cycle older than the speed, and wheels slow down.
    np.testing.assert_allclose(telemetry.current[1], shorted, rtol=0.1, atol=0.02)
    drive(plant, constant(TWIST, DURATION - 4, 2))
    coasted, braked = np.linalg.norm((plant.pose() - start)[:, :2], axis=1)
    assert coasted > 1.5 * braked


@WHEELED_PLANTS
def test_a_restarted_robot_takes_the_first_heading_of_vision(
    plant_of: PlantOf,
) -> None:
    """Until then it halts. It has lost its gyro bias and the state of its loops."""
    no_vision = {"heading_gain": 0.0, "gyro_bias_gain": 0.0}
    settings = with_faults(
        fault("reboot"),
        {"kind": "gyro-bias", "start_s": 0.0, "duration_s": 0.3, "bias_rad_s": 2.0},
        firmware=no_vision,
    )
    plant, age = plant_of([settings, with_faults(firmware=no_vision)]), np.zeros(2, int)
    drive(plant, ramp([TWIST] * 2, 3.0, START + DURATION))
    assert estimated_heading(plant)[0] > 0.3  # from the bias, which has ended
    commands = np.tile(TWIST, (2, 1))
    for _ in range(12):  # packets without a heading
        plant.advance(ReceivedCommand(commands, np.full(2, np.nan), age))
    assert np.linalg.norm(plant.twist()[0, :2]) < 0.02
    plant.advance(ReceivedCommand(commands, plant.pose()[:, 2], age))
    assert estimated_heading(plant)[0] == pytest.approx(plant.pose()[0, 2], abs=0.02)
    drive(plant, constant(TWIST, 40, 2))
    np.testing.assert_allclose(estimated_heading(plant), plant.pose()[:, 2], atol=2e-3)
    assert np.linalg.norm(plant.twist()[0, :2]) > 0.8 * np.linalg.norm(TWIST)

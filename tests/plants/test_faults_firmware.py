"""What a processor that stops listening or starts anew, and a supply that sinks, do to robots on both plants."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benches.plant import (
    FRAME_S,
    WHEELED_PLANTS,
    constant,
    drive,
    estimated_heading,
    ramp,
    with_faults,
)

from omni_mj.config.settings import Settings
from omni_mj.network.radio import ReceivedCommand

PlantOf = Callable[[list[Settings]], Any]
TWIST = np.array([1.0, 0.4, 0.0])
START, LASTS = 30, 20  # frames


def fault(kind: str, **values: Any) -> dict[str, Any]:
    return {"kind": kind, "start_s": START * FRAME_S, "duration_s": LASTS * FRAME_S, **values}


@WHEELED_PLANTS
def test_a_firmware_that_times_out_does_as_one_that_is_told_to_stand(plant_of: PlantOf) -> None:
    """To rounding; then it obeys again."""
    plant = plant_of([with_faults(fault("firmware-timeout")), with_faults()])
    commands = ramp([TWIST] * 2, 3.0, START + LASTS + 25).copy()
    commands[START : START + LASTS, 1] = 0.0
    commands[START + LASTS, 1] = 0.0  # it listens again, and waits for the next packet
    poses = drive(plant, commands)
    np.testing.assert_allclose(poses[:, 0], poses[:, 1], atol=1e-9)
    rests = (
        np.linalg.norm(np.diff(poses[START + LASTS - 4 : START + LASTS, 0, :2], axis=0), axis=1)
        / FRAME_S
    )
    assert rests.max() < 0.02
    assert np.linalg.norm(plant.twist()[0, :2]) > 0.8 * np.linalg.norm(TWIST)


@WHEELED_PLANTS
def test_motors_have_as_much_less_voltage_as_the_supply_has_sunk(plant_of: PlantOf) -> None:
    """All that there is, free of load on ice: speeds are in proportion; the battery itself loses nothing."""
    share = 0.5
    slick: dict[str, Any] = {
        "carpet": {"friction": 0.01, "rolling_resistance": 0.0},
        "drivetrain": {"gear_friction_nm": 0.0, "roller_friction": 0.0},
        "motor": {"no_load_current_a": 0.0},
        "battery": {"resistance_ohm": 0.0},
    }
    sinks = {"kind": "brown-out", "start_s": 0.0, "duration_s": 40 * FRAME_S, "factor": share}
    plant = plant_of([with_faults(sinks, **slick), with_faults(**slick)])
    drive(plant, constant([0, 0, 100.0], 40, 2))
    told = plant.telemetry()
    assert (told.duty_peak == 1).all()
    assert told.battery[0] == pytest.approx(share * told.battery[1], rel=1e-4)
    # As in test_faults_onboard.py: what is left of friction and of the run-up.
    np.testing.assert_allclose(told.wheel_speed[0], share * told.wheel_speed[1], rtol=1e-2)
    drive(plant, constant([0, 0, 0.0], 2, 2))
    assert plant.telemetry().battery[0] == pytest.approx(told.battery[1], rel=1e-3)


@WHEELED_PLANTS
def test_a_robot_that_starts_anew_coasts_or_brakes_as_its_drivers_do(plant_of: PlantOf) -> None:
    """Without current, or with shorted windings, I = -K w / (R + X |w|), in which energy goes; so it brakes sooner."""
    own = [with_faults(fault("reboot", motors=motors)) for motors in ("coast", "brake")]
    plant = plant_of(own)
    before = drive(plant, ramp([TWIST] * 2, 3.0, START))[-1]
    drive(plant, constant(TWIST, 3, 2))
    told, motor = plant.telemetry(), Settings().motor
    assert np.abs(told.current_mean[0]).max() < 1e-9
    assert not told.voltage_mean[1].any()
    speeds = told.wheel_speed[1]
    resistance = motor.resistance_ohm + motor.commutation_ohm_s * motor.gear_ratio * np.abs(speeds)
    shorted = -motor.torque_constant_nm_a * motor.gear_ratio * speeds / resistance
    np.testing.assert_allclose(
        told.current[1], shorted, rtol=0.1, atol=0.02
    )  # of a cycle before: wheels brake
    drive(plant, constant(TWIST, LASTS - 4, 2))
    coasted, braked = np.linalg.norm((plant.pose() - before)[:, :2], axis=1)
    assert coasted > 1.5 * braked


@WHEELED_PLANTS
def test_a_robot_that_has_started_anew_believes_the_first_heading_that_it_is_told(
    plant_of: PlantOf,
) -> None:
    """It stands until then, has forgotten its gyro's bias and what its loops were at, and then goes on."""
    blind = {"heading_gain": 0.0, "gyro_bias_gain": 0.0}
    own = with_faults(
        fault("reboot"),
        {"kind": "gyro-bias", "start_s": 0.0, "duration_s": 0.3, "bias_rad_s": 2.0},
        firmware=blind,
    )
    plant, none = plant_of([own, with_faults(firmware=blind)]), np.zeros(2, int)
    drive(plant, ramp([TWIST] * 2, 3.0, START + LASTS))
    assert estimated_heading(plant)[0] > 0.3  # of the bias, which has gone
    commands = np.tile(TWIST, (2, 1))
    for _ in range(12):  # packets without a heading
        plant.advance(ReceivedCommand(commands, np.full(2, np.nan), none))
    assert np.linalg.norm(plant.twist()[0, :2]) < 0.02
    plant.advance(ReceivedCommand(commands, plant.pose()[:, 2], none))
    assert estimated_heading(plant)[0] == pytest.approx(plant.pose()[0, 2], abs=0.02)
    drive(plant, constant(TWIST, 40, 2))
    np.testing.assert_allclose(estimated_heading(plant), plant.pose()[:, 2], atol=2e-3)
    assert np.linalg.norm(plant.twist()[0, :2]) > 0.8 * np.linalg.norm(TWIST)

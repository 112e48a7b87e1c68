"""What encoders and gyros that are wrong do to robots on both plants, by the laws of their loops."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from default_robot import RADIUS_M, TANGENTS
from driving import FRAME_S, STIFF, constant, drive, ramp
from meeting_faults import ON_WHEELS, SETTLE, meets, standing

from omni_mj.scenarios.settings import Settings

PlantOf = Callable[[list[Settings]], Any]
SIGMAS = 5
BLIND = {"heading_gain": 0.0, "bias_gain": 0.0, "turn_gain": 0.0}


@ON_WHEELS
def test_a_frozen_encoder_has_the_loop_push_as_against_a_wheel_at_rest(plant_of: PlantOf) -> None:
    """V = (feed-forward + kp) w; when it counts again, nothing tells how far the wheel has turned meanwhile."""
    firmware = {"ki": 0.0, "kd": 0.0, "turn_gain": 0.0, "kp": 0.1}
    fault = {"kind": "encoder-dropout", "wheel": 1, "at": 0.0, "for": 15 * FRAME_S}
    plant, twist = plant_of([meets(fault, firmware=firmware)]), np.array([0.5, 0.0, 0.0])
    drive(plant, constant(twist, 15, 1))
    f, told = plant._firmware.arrays(), plant.telemetry()
    heading = plant.pose()[0, 2]  # which one wheel that pulls too hard changes
    wanted = TANGENTS[0] @ (twist[0] * np.array([np.cos(heading), -np.sin(heading)])) / RADIUS_M
    duty = (f.back_emf[0] + f.kp[0]) * wanted / f.nominal[0]
    assert told.voltage[0, 0] / told.battery[0] == pytest.approx(duty, rel=0.02)
    assert abs(told.wheel_speed[0, 0]) > 1.5 * abs(wanted)
    drive(plant, constant(twist, 1, 1))
    assert np.abs(plant._voltages[2:, 0, 0]).max() < np.abs(told.voltage[0, 0])


@ON_WHEELS
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_encoders_that_count_otherwise_have_the_robot_drive_otherwise(plant_of: PlantOf, factor: float) -> None:
    """Loops that integrate bring what they see to what is asked: wheels turn at w / factor."""
    scales = [{"kind": "encoder-scale", "wheel": w, "to": factor, "at": 0.0} for w in (1, 2, 3, 4)]
    plant, twist = plant_of([meets(*scales, firmware=STIFF)]), np.array([0.5, 0.3, 0.0])
    drive(plant, ramp([twist], 1.5, 60))
    turned = plant.telemetry().wheel_angle
    drive(plant, constant(twist, 30, 1))
    turned = (plant.telemetry().wheel_angle - turned)[0]
    wanted = TANGENTS @ twist[:2] / RADIUS_M * 30 * FRAME_S
    np.testing.assert_allclose(turned * factor, wanted, atol=0.02 * wanted.max())  # the robot turns a little


@ON_WHEELS
def test_a_loose_encoder_stands_still_in_as_many_frames_as_said(plant_of: PlantOf) -> None:
    """A binomial share; the wheels beside it count in all."""
    share, frames = 0.4, 150
    fault = {"kind": "encoder-dropout", "wheel": 4, "probability": share, "at": 0.0}
    plant = plant_of([meets(fault)])
    drive(plant, ramp([[0.8, 0.0, 0.0]], 3.0, SETTLE))
    stands, f = [], plant._firmware.arrays()
    for _ in range(frames):
        counts, angles = f.last_count.copy(), plant.telemetry().wheel_angle
        drive(plant, constant([0.8, 0.0, 0.0], 1, 1))
        turned = (plant.telemetry().wheel_angle - angles)[0] * f.counts_per_rad[0]
        stands.append((np.abs((f.last_count - counts)[:, 0]) < 0.5 * np.abs(turned)) & (np.abs(turned) > 50))
    part = np.mean(stands, axis=0)
    assert part[3] == pytest.approx(share, abs=SIGMAS * np.sqrt(share * (1 - share) / frames))
    assert not part[:3].any()


@ON_WHEELS
def test_a_gyro_of_another_scale_turns_what_a_robot_holds_for_its_heading(plant_of: PlantOf) -> None:
    """By its factor times the true turn; one that shows nothing leaves it as it was."""
    own = [{"kind": "gyro-scale", "to": 0.7}, {"kind": "gyro-scale", "to": 1.5}, {"kind": "gyro-scale", "to": 0.0}]
    plant = plant_of([*(meets({**each, "at": 0.0}, firmware=BLIND) for each in own), meets(firmware=BLIND)])
    drive(plant, ramp([[0.0, 0.0, 2.0]] * 4, 4.0, 30))
    turned, held = plant.pose()[:, 2], plant._firmware.estimate.heading
    assert (turned > 0.4).all()
    late = 2 * 2.0 / 960  # rad: by which a gyro is, a cycle or two, at this rate
    np.testing.assert_allclose(held, np.array([0.7, 1.5, 0.0, 1.0]) * turned, atol=1.5 * late)
    assert held[2] == 0


@ON_WHEELS
def test_a_dead_gyro_shows_no_bias_either(plant_of: PlantOf) -> None:
    faults = [{"kind": "gyro-bias", "rad_s": 0.5}, {"kind": "gyro-scale", "to": 0.0}]
    plant = plant_of([meets(*faults, firmware=BLIND), meets(faults[0], firmware=BLIND)])
    standing(plant, SETTLE + 12)
    np.testing.assert_allclose(plant._firmware.estimate.heading, [0.0, 0.1], atol=1e-3)

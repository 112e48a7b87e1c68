"""What encoders and gyros that are wrong do to robots on both plants, by the laws of their loops."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benches.plant import (
    FRAME_S,
    RADIUS_M,
    SETTLE_FRAMES,
    STIFF,
    TANGENTS,
    WHEELED_PLANTS,
    constant,
    drive,
    encoder_angles,
    estimated_heading,
    ramp,
    stand_still,
    with_faults,
)

from omni_mj.config.settings import Settings

PlantOf = Callable[[list[Settings]], Any]
SIGMAS = 5
BLIND = {"heading_gain": 0.0, "gyro_bias_gain": 0.0, "turn_rate_gain": 0.0}


@WHEELED_PLANTS
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_encoders_that_count_otherwise_have_the_robot_drive_otherwise(
    plant_of: PlantOf, factor: float
) -> None:
    """Loops that integrate bring what they see to what is asked: wheels turn at w / factor."""
    scales = [
        {"kind": "encoder-scale", "wheel": w, "factor": factor, "start_s": 0.0}
        for w in (1, 2, 3, 4)
    ]
    plant, twist = plant_of([with_faults(*scales, firmware=STIFF)]), np.array([0.5, 0.3, 0.0])
    drive(plant, ramp([twist], 1.5, 60))
    turned = plant.telemetry().wheel_angle
    drive(plant, constant(twist, 30, 1))
    turned = (plant.telemetry().wheel_angle - turned)[0]
    wanted = TANGENTS @ twist[:2] / RADIUS_M * 30 * FRAME_S
    np.testing.assert_allclose(
        turned * factor, wanted, atol=0.02 * wanted.max()
    )  # the robot turns a little


@WHEELED_PLANTS
def test_a_loose_encoder_stands_still_in_as_many_frames_as_said(plant_of: PlantOf) -> None:
    """A binomial share; the wheels beside it count in all."""
    share, frames = 0.4, 150
    fault = {"kind": "encoder-dropout", "wheel": 4, "probability": share, "start_s": 0.0}
    plant = plant_of([with_faults(fault)])
    drive(plant, ramp([[0.8, 0.0, 0.0]], 3.0, SETTLE_FRAMES))
    stands = []
    for _ in range(frames):
        counts, angles = encoder_angles(plant), plant.telemetry().wheel_angle
        drive(plant, constant([0.8, 0.0, 0.0], 1, 1))
        turned = (plant.telemetry().wheel_angle - angles)[0]
        stands.append(
            (np.abs((encoder_angles(plant) - counts)[0]) < 0.5 * np.abs(turned))
            & (np.abs(turned) > 0.05)
        )
    part = np.mean(stands, axis=0)
    assert part[3] == pytest.approx(share, abs=SIGMAS * np.sqrt(share * (1 - share) / frames))
    assert not part[:3].any()


@WHEELED_PLANTS
def test_a_gyro_of_another_scale_turns_what_a_robot_holds_for_its_heading(
    plant_of: PlantOf,
) -> None:
    """By its factor times the true turn; one that shows nothing leaves it as it was."""
    own = [
        {"kind": "gyro-scale", "factor": 0.7},
        {"kind": "gyro-scale", "factor": 1.5},
        {"kind": "gyro-scale", "factor": 0.0},
    ]
    plant = plant_of(
        [
            *(with_faults({**each, "start_s": 0.0}, firmware=BLIND) for each in own),
            with_faults(firmware=BLIND),
        ]
    )
    drive(plant, ramp([[0.0, 0.0, 2.0]] * 4, 4.0, 30))
    turned, held = plant.pose()[:, 2], estimated_heading(plant)
    assert (turned > 0.4).all()
    late = 2 * 2.0 / 960  # rad: by which a gyro is, a cycle or two, at this rate
    np.testing.assert_allclose(held, np.array([0.7, 1.5, 0.0, 1.0]) * turned, atol=1.5 * late)
    assert held[2] == 0


@WHEELED_PLANTS
def test_a_dead_gyro_shows_no_bias_either(plant_of: PlantOf) -> None:
    faults = [{"kind": "gyro-bias", "bias_rad_s": 0.5}, {"kind": "gyro-scale", "factor": 0.0}]
    plant = plant_of([with_faults(*faults, firmware=BLIND), with_faults(faults[0], firmware=BLIND)])
    stand_still(plant, SETTLE_FRAMES + 12)
    np.testing.assert_allclose(estimated_heading(plant), [0.0, 0.1], atol=1e-3)

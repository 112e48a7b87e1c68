"""Faults of encoders and gyros on both plants, by the laws of the control loops."""

import numpy as np
import pytest
from benches.plant import (
    FRAME_S,
    RADIUS_M,
    SETTLE_FRAMES,
    SIGMAS,
    STIFF,
    TANGENTS,
    WHEELED_PLANTS,
    PlantOf,
    constant,
    drive,
    encoder_angles,
    estimated_heading,
    on_all_wheels,
    ramp,
    stand_still,
    with_faults,
)

NO_VISION = {"heading_gain": 0.0, "gyro_bias_gain": 0.0, "turn_rate_gain": 0.0}


@WHEELED_PLANTS
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_wheels_turn_by_the_inverse_of_the_encoder_scale(plant_of: PlantOf, factor: float) -> None:
    """Loops with an integral bring the measured speed to the desired one: w / factor."""
    scales = on_all_wheels("encoder-scale", factor=factor)
    plant, twist = plant_of([with_faults(*scales, firmware=STIFF)]), np.array([0.5, 0.3, 0.0])
    drive(plant, ramp([twist], 1.5, 60))
    start_angle = plant.telemetry().wheel_angle
    heading = drive(plant, constant(twist, 30, 1))[:-1, 0, 2]
    angle = (plant.telemetry().wheel_angle - start_angle)[0]
    # The robot turns, because creep differs between its wheels.
    cosine, sine = np.cos(heading), np.sin(heading)
    velocity = [twist[0] * cosine + twist[1] * sine, twist[1] * cosine - twist[0] * sine]
    desired = TANGENTS @ np.sum(velocity, axis=1) / RADIUS_M * FRAME_S
    np.testing.assert_allclose(angle * factor, desired, atol=0.02 * np.abs(desired).max())


@WHEELED_PLANTS
def test_an_encoder_drops_out_in_frames_with_the_set_probability(plant_of: PlantOf) -> None:
    """The number of frames is binomial; other wheels never drop out."""
    probability, frames = 0.4, 150
    fault = {"kind": "encoder-dropout", "wheel": 4, "probability": probability, "start_s": 0.0}
    plant = plant_of([with_faults(fault)])
    drive(plant, ramp([[0.8, 0.0, 0.0]], 3.0, SETTLE_FRAMES))
    dropouts = []
    for _ in range(frames):
        counts, angles = encoder_angles(plant), plant.telemetry().wheel_angle
        drive(plant, constant([0.8, 0.0, 0.0], 1, 1))
        turns = (plant.telemetry().wheel_angle - angles)[0]
        dropouts.append(
            (np.abs((encoder_angles(plant) - counts)[0]) < 0.5 * np.abs(turns))
            & (np.abs(turns) > 0.05)
        )
    fraction = np.mean(dropouts, axis=0)
    sigma = np.sqrt(probability * (1 - probability) / frames)
    assert fraction[3] == pytest.approx(probability, abs=SIGMAS * sigma)
    assert not fraction[:3].any()


@WHEELED_PLANTS
def test_the_scale_of_a_gyro_scales_the_turn_of_the_estimated_heading(
    plant_of: PlantOf,
) -> None:
    """By its factor times the true turn; with a factor of zero the estimate stays."""
    scales = [
        {"kind": "gyro-scale", "factor": 0.7},
        {"kind": "gyro-scale", "factor": 1.5},
        {"kind": "gyro-scale", "factor": 0.0},
    ]
    plant = plant_of(
        [
            *(with_faults({**scale, "start_s": 0.0}, firmware=NO_VISION) for scale in scales),
            with_faults(firmware=NO_VISION),
        ]
    )
    drive(plant, ramp([[0.0, 0.0, 2.0]] * 4, 4.0, 30))
    heading, estimate = plant.pose()[:, 2], estimated_heading(plant)
    assert (heading > 0.4).all()
    lag = 2 * 2.0 / 960  # rad: a gyro is a cycle or two late, at this rate
    np.testing.assert_allclose(estimate, np.array([0.7, 1.5, 0.0, 1.0]) * heading, atol=1.5 * lag)
    assert estimate[2] == 0


@WHEELED_PLANTS
def test_a_gyro_with_a_factor_of_zero_has_no_bias(plant_of: PlantOf) -> None:
    faults = [{"kind": "gyro-bias", "bias_rad_s": 0.5}, {"kind": "gyro-scale", "factor": 0.0}]
    plant = plant_of(
        [with_faults(*faults, firmware=NO_VISION), with_faults(faults[0], firmware=NO_VISION)]
    )
    stand_still(plant, SETTLE_FRAMES + 12)
    np.testing.assert_allclose(estimated_heading(plant), [0.0, 0.1], atol=1e-3)

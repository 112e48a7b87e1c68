"""Faults act on their row only, and leave nothing behind."""

from typing import Any

import numpy as np
import pytest
from benches.plant import (
    ICE,
    MAX_DRIFT,
    SETTLE_FRAMES,
    PlantOf,
    changeable_values,
    drive,
    noiseless,
    planar,
    ramp,
    stand_still,
    stop_robot,
    with_faults,
    with_settings,
)
from benches.plant import mujoco as plant_of

EVERYTHING: list[dict[str, Any]] = [
    {"kind": "push", "start_s": 0.05, "duration_s": 0.1, "force_n": 15.0, "direction_deg": 30.0},
    {"kind": "tilt", "start_s": 0.1, "duration_s": 0.1, "angle_deg": 3.0, "direction_deg": -60.0},
    {"kind": "friction", "start_s": 0.05, "duration_s": 0.2, "friction": 0.2},
    {"kind": "payload", "start_s": 0.1, "duration_s": 0.1, "mass_kg": 0.8, "height_m": 0.13},
    {"kind": "motor-demagnetized", "start_s": 0.0, "duration_s": 0.2, "wheel": 3, "factor": 0.6},
    {"kind": "gyro-bias", "start_s": 0.05, "duration_s": 0.1, "bias_rad_s": 0.5},
    {"kind": "kidnap", "start_s": 0.1, "duration_s": 0.1, "x_m": 0.05, "heading_deg": 20.0},
    {
        "kind": "friction-patch",
        "start_s": 0.05,
        "duration_s": 0.1,
        "x_m": 0.1,
        "y_m": 0.0,
        "radius_m": 1.0,
        "friction": 0.1,
    },
    {"kind": "motor-dead", "start_s": 0.05, "duration_s": 0.15, "wheel": 1},
    {"kind": "motor-blocked", "start_s": 0.05, "duration_s": 0.15, "wheel": 4},
    {"kind": "wheel-worn", "start_s": 0.0, "duration_s": 0.2, "wheel": 2, "factor": 0.2},
    {"kind": "wheel-missing-rollers", "start_s": 0.0, "duration_s": 0.2, "wheel": 3, "rollers": 6},
    {"kind": "encoder-dropout", "start_s": 0.1, "duration_s": 0.1, "wheel": 2},
    {
        "kind": "encoder-dropout",
        "start_s": 0.05,
        "duration_s": 0.15,
        "wheel": 3,
        "probability": 0.6,
    },
    {"kind": "encoder-scale", "start_s": 0.05, "duration_s": 0.15, "wheel": 1, "factor": 1.3},
    {"kind": "gyro-scale", "start_s": 0.05, "duration_s": 0.15, "factor": 1.8},
    {"kind": "gyro-scale", "factor": 0.0, "start_s": 0.1, "duration_s": 0.1},
    {"kind": "firmware-timeout", "start_s": 0.1, "duration_s": 0.1},
    {"kind": "brown-out", "start_s": 0.05, "duration_s": 0.15, "factor": 0.3},
    {"kind": "reboot", "start_s": 0.1, "duration_s": 0.1, "motors": "brake"},
]


@pytest.mark.parametrize(
    ("make", "model", "faults_by_row"),
    [
        (plant_of, "rollers", [[], EVERYTHING]),
        (plant_of, "two-rollers", [[], EVERYTHING, *([fault] for fault in EVERYTHING)]),
        (planar, "rollers", [[], EVERYTHING, *([fault] for fault in EVERYTHING)]),
    ],
)
def test_faults_of_a_row_do_not_change_other_rows(
    make: PlantOf, model: str, faults_by_row: list[list[dict[str, Any]]]
) -> None:
    """Bit for bit: all rows in a batch, and rows without faults, with all, and the others apart."""
    settings = [with_settings(wheels={"model": model}, fault=faults) for faults in faults_by_row]
    commands = ramp([[1.5, 0.3, 2.0]] * len(settings), 3.0, 16)
    together = drive(make(settings), commands)
    for subset in filter(len, ([0], [1], range(2, len(settings)))):
        separate = drive(make([settings[i] for i in subset]), commands[:, : len(subset)])
        np.testing.assert_array_equal(separate, together[:, list(subset)])
    for i, row_settings in enumerate(settings[1:], 1):
        assert (together[-1, i] != together[-1, 0]).all(), row_settings.fault


def test_a_fault_that_has_ended_leaves_nothing_behind() -> None:
    """All fields of the model, friction and motors are those of a robot without faults."""
    plant = plant_of(
        [
            with_settings(fault=EVERYTHING),
            with_settings(randomization={"mass_std": 0.1, "com_offset_std_m": 0.005}),
        ]
    )
    initial = changeable_values(plant)
    stand_still(plant, 7)
    during = changeable_values(plant)
    # Values of the other robot, which differ from those of this one, never change.
    assert all((now[0] != then[0]).any() for now, then in zip(during, initial, strict=True))
    assert all((now[1] == then[1]).all() for now, then in zip(during, initial, strict=True))
    stand_still(plant, 9)
    for now, then in zip(changeable_values(plant), initial, strict=True):
        np.testing.assert_array_equal(now, then)


def test_no_push_force_acts_on_a_failed_robot() -> None:
    """In a world that continues because of another robot, on which the force acts."""
    plant = plant_of(
        [with_faults({"kind": "push", "start_s": 0.0, "force_n": 9.0}, **ICE)] * 2,
        [[0, 0, 0], [1, 0, 0]],
        per_world=2,
    )
    stop_robot(plant, 0)
    stand_still(plant, 10)
    assert plant.pose()[0, 0] < MAX_DRIFT < 0.03 < plant.pose()[1, 0] - 1


def test_faults_act_on_their_slot_only() -> None:
    """A payload and a push of the second robot in the second world."""
    start = [[0, 0, 0], [1, 0, 0]] * 2
    force, load = {"kind": "push", "force_n": 9.0}, {"kind": "payload", "mass_kg": 1.0}
    plant = plant_of([*[noiseless(**ICE)] * 3, with_faults(force, load, **ICE)], start, per_world=2)
    displacement = stand_still(plant, SETTLE_FRAMES + 10)[-1] - start
    assert (np.abs(displacement[:3]) < MAX_DRIFT).all()
    assert displacement[3, 0] > 0.03
    mass = plant._batch.expand("body_mass")
    chassis = [robot.chassis for robot in plant._world.robots]
    np.testing.assert_allclose(mass[1, chassis[1]] - mass[:, chassis].ravel()[:3], 1.0)

"""Faults concern nobody but their row, and leave nothing behind."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benches.plant import (
    ICE,
    MAX_DRIFT,
    SETTLE_FRAMES,
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

from omni_mj.config.settings import Settings

PlantOf = Callable[[list[Settings]], Any]
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
    ("model", "happening"),
    [
        ("rollers", [[], EVERYTHING]),
        ("two-rollers", [[], EVERYTHING, *([each] for each in EVERYTHING)]),
    ],
)
def test_what_happens_to_a_row_concerns_no_other(
    model: str, happening: list[list[dict[str, Any]]]
) -> None:
    """To the last bit: all together, and those with nothing and with everything alone, the others by themselves."""
    own = [with_settings(wheels={"model": model}, fault=each) for each in happening]
    commands = ramp([[1.5, 0.3, 2.0]] * len(own), 3.0, 16)
    together = drive(plant_of(own), commands)
    for part in filter(len, ([0], [1], range(2, len(own)))):
        apart = drive(plant_of([own[i] for i in part]), commands[:, : len(part)])
        np.testing.assert_array_equal(apart, together[:, list(part)])
    for i, each in enumerate(own[1:], 1):
        assert (together[-1, i] != together[-1, 0]).all(), each.fault


def test_what_happens_to_a_row_concerns_no_other_on_the_planar_plant_either() -> None:
    own = [with_settings(fault=each) for each in ([], EVERYTHING, *([each] for each in EVERYTHING))]
    commands = ramp([[1.5, 0.3, 2.0]] * len(own), 3.0, 16)
    together = drive(planar(own), commands)
    for part in ([0], [1], range(2, len(own))):
        apart = drive(planar([own[i] for i in part]), commands[:, : len(part)])
        np.testing.assert_array_equal(apart, together[:, list(part)])
    for i, each in enumerate(own[1:], 1):
        assert (together[-1, i] != together[-1, 0]).all(), each.fault


def test_a_fault_that_has_ended_leaves_nothing_behind() -> None:
    """Every field of the model, friction, motors and forces are those of a robot that met nothing."""
    plant = plant_of(
        [
            with_settings(fault=EVERYTHING),
            with_settings(randomization={"mass_std": 0.1, "com_offset_std_m": 0.005}),
        ]
    )
    before = changeable_values(plant)
    stand_still(plant, 7)
    during = changeable_values(plant)
    # Of the other robot, which is no two's like, nothing ever changes.
    assert all((now[0] != then[0]).any() for now, then in zip(during, before, strict=True))
    assert all((now[1] == then[1]).all() for now, then in zip(during, before, strict=True))
    stand_still(plant, 9)
    for now, then in zip(changeable_values(plant), before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_a_robot_that_failed_is_pushed_no_more() -> None:
    """In a world that another robot, which is, keeps going."""
    plant = plant_of(
        [with_faults({"kind": "push", "start_s": 0.0, "force_n": 9.0}, **ICE)] * 2,
        [[0, 0, 0], [1, 0, 0]],
        per_world=2,
    )
    stop_robot(plant, 0)
    stand_still(plant, 10)
    assert plant.pose()[0, 0] < MAX_DRIFT < 0.03 < plant.pose()[1, 0] - 1


def test_rows_at_several_places_meet_their_own() -> None:
    """A payload and a push of the second robot of the second world are its alone."""
    start = [[0, 0, 0], [1, 0, 0]] * 2
    push, load = {"kind": "push", "force_n": 9.0}, {"kind": "payload", "mass_kg": 1.0}
    plant = plant_of([*[noiseless(**ICE)] * 3, with_faults(push, load, **ICE)], start, per_world=2)
    moved = stand_still(plant, SETTLE_FRAMES + 10)[-1] - start
    assert (np.abs(moved[:3]) < MAX_DRIFT).all()
    assert moved[3, 0] > 0.03
    mass = plant._batch.expand("body_mass")
    chassis = [robot.chassis for robot in plant._world.robots]
    np.testing.assert_allclose(mass[1, chassis[1]] - mass[:, chassis].ravel()[:3], 1.0)

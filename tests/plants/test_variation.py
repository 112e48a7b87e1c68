"""What sets robots and carpets apart: how it is drawn, and the laws by which it acts."""

from typing import Any

import numpy as np
import pytest
from benches.plant import (
    FRAME_S,
    SIGMAS,
    constant,
    drive,
    noiseless,
    ramp,
    rows,
    wheel_loads,
    with_settings,
)
from benches.plant import mujoco as plant_of
from numpy.typing import NDArray

from omni_mj import load_scenario, run
from omni_mj.config.robot_settings import RandomizationSettings
from omni_mj.config.settings import Settings
from omni_mj.plants.domain_randomization import RobotVariation

MODELS = ["rollers", "two-rollers"]
ALL = {
    "wheel_friction_std": 0.1,
    "max_wear_m": 0.0005,
    "torque_constant_std": 0.05,
    "mass_std": 0.1,
    "com_offset_std_m": 0.005,
}
NO_DRAG: dict[str, Any] = {
    "drivetrain": {"roller_friction": 0.0},
    "carpet": {"rolling_resistance": 0.0},
}
GRAVITY = 9.81


def drawn(seeds: range | list[int], **variation: float) -> RobotVariation:
    return RobotVariation.draw(
        rows([with_settings(randomization=variation)] * len(seeds), list(seeds))
    )


def flat(one: RobotVariation) -> NDArray:
    return np.column_stack(list(one.columns().values()))


# --- how it is drawn ---


def test_a_seed_draws_the_same_whatever_else_is_drawn() -> None:
    """Another seed, or place in a world, draws others; a wider spread stretches what is drawn."""
    together, alone = flat(drawn(range(5), **ALL)), flat(drawn([3], **ALL))
    np.testing.assert_array_equal(together[3:4], alone)
    assert not (together[0] == together[1]).any()
    pair = flat(
        RobotVariation.draw(rows([with_settings(randomization=ALL)] * 2, [3, 3], per_world=2))
    )
    np.testing.assert_array_equal(pair[0], alone[0])
    assert not (pair[0] == pair[1]).any()
    wider = drawn([3], **{**ALL, "wheel_friction_std": 0.2})
    np.testing.assert_array_equal(wider.wear, drawn([3], **ALL).wear)
    np.testing.assert_allclose(
        wider.friction_factor - 1, 2 * (drawn([3], **ALL).friction_factor - 1), rtol=1e-12
    )


def test_spreads_are_those_asked_for() -> None:
    """Standard errors: of a mean s/sqrt(n), of a deviation s/sqrt(2n) for normal numbers, s/sqrt(5n) for others."""
    robots = drawn(range(1500), **ALL)
    # A normal number that is cut at 3 deviations has a deviation of 0.9866.
    for values, middle, name in (
        (robots.friction_factor, 1, "wheel_friction_std"),
        (robots.magnet_factor, 1, "torque_constant_std"),
        (robots.mass_factor, 1, "mass_std"),
        (robots.center_shift, 0, "com_offset_std_m"),
    ):
        sigma, n = 0.9866 * ALL[name], values.size
        assert abs(values.mean() - middle) < SIGMAS * sigma / np.sqrt(n), name
        assert abs(values.std() - sigma) < SIGMAS * sigma / np.sqrt(2 * n), name
        assert np.abs(values - middle).max() <= 3 * ALL[name] * (1 + 1e-12), name
    wear, n = robots.wear / ALL["max_wear_m"], robots.wear.size
    assert wear.min() >= 0
    assert wear.max() <= 1
    assert abs(wear.mean() - 1 / 2) < SIGMAS / np.sqrt(12 * n)
    assert abs(wear.std() - 1 / np.sqrt(12)) < SIGMAS / np.sqrt(60 * n)
    # Four wheels, two axes: each its own.
    correlation = np.corrcoef(flat(robots).T) - np.eye(flat(robots).shape[1])
    assert np.abs(correlation).max() < SIGMAS / np.sqrt(1500)


def test_a_summary_says_what_was_drawn_for_whom() -> None:
    """Each seed's robot once, though several controllers drive it; no robot on a plant without wheels."""
    short = load_scenario(
        "worn-robots", reference={"waypoints": [[0, 0], [0.05, 0]]}, wheels={"model": "two-rollers"}
    )
    result = run(short, ["flc", "comp-flc"], seeds=[3, 4])
    (entry,) = result.summary()["scenarios"].values()
    expected = drawn([3, 4], **dict(short.settings.randomization)).columns()
    for i, told in enumerate(entry["drawn_parameters"]):
        assert told == {
            "seed": 3 + i,
            "slot": 0,
            **{name: values[i] for name, values in expected.items()},
        }
    assert result.rows()["friction_1"].to_pylist() == [*expected["friction_1"]] * 2
    new = short.settings.replace(randomization=RandomizationSettings())
    for alike in (short.replace(plant="kinematic"), short.replace(settings=new)):
        (entry,) = run(alike, ["flc"], seeds=[3]).summary()["scenarios"].values()
        assert entry["drawn_parameters"] == []


# --- rows ---


# --- robots ---


@pytest.mark.parametrize("model", MODELS)
def test_worn_wheels_roll_at_their_own_radius_and_stand_as_new_ones(model: str) -> None:
    """Without drag, and with rubber that hardly creeps: every wheel's way is its angle times its own radius."""
    free = {
        **NO_DRAG,
        "drivetrain": {"roller_friction": 0.0, "creep_stiffness": 1e3},
        "wheels": {"model": model},
    }
    plant = plant_of(
        [noiseless(randomization={"max_wear_m": wear}, **free) for wear in (0.0, 0.0, 1e-3, 1e-3)],
        seeds=[0, 0, 1, 2],
    )
    commands = ramp([[0.5, 0, 0], [0, 0.5, 0]] * 2, 1.0, 40)
    before = drive(plant, commands)[-1]
    turned, way = -plant.telemetry().wheel_angle, np.zeros((4, 4))
    for _ in range(30):
        after = drive(plant, commands[-4:])[-1]
        x, y, angle = (after - before).T
        heading = (after + before)[:, 2] / 2
        body = np.column_stack(
            [np.cos(heading) * x + np.sin(heading) * y, np.cos(heading) * y - np.sin(heading) * x]
        )
        way += np.column_stack([body, angle]) @ plant.geometry.matrix.T
        before = after
    turned += plant.telemetry().wheel_angle
    radius = way / turned
    assert np.ptp(plant.variation.wear[2:]) > 5e-4
    # 0.05 % of the radius between new and worn, which differ by 3 %; both roll at 0.1 % less than
    # their radius, on polygons of rollers.
    np.testing.assert_allclose(
        radius[2:] - radius[:2], -plant.variation.wear[2:], atol=5e-4 * 0.0285
    )
    standing = plant_of(
        [noiseless(randomization={"max_wear_m": wear}, **free) for wear in (0.0, 1e-3)],
        [[0, 0, 0]] * 2,
        [0, 1],
    )
    drive(standing, constant([0, 0, 0], 30, 2))
    new, worn = wheel_loads(standing)
    np.testing.assert_allclose(worn, new, rtol=0.01)  # at rest the springs still swing by less
    assert np.abs(standing.pose()).max() < 1e-4


def test_a_wheel_that_slides_pulls_by_its_own_friction() -> None:
    """All wheels spin: the robot turns up by sum(mu_i N_i) arm, and drifts by the sum of the wheels' pulls."""
    share, mu, frames = 0.3, 0.1, 14
    base = {"firmware": {"kp": 0.4, "turn_rate_gain": 0.0}, "drivetrain": NO_DRAG["drivetrain"]}
    carpet = {"friction": mu, "rolling_resistance": 0.0}
    chosen = [
        noiseless(carpet=carpet, randomization={"wheel_friction_std": each}, **base)
        for each in (0.0, *[share] * 4)
    ]
    plant = plant_of(chosen, seeds=range(5))
    drive(plant, constant([0, 0, 0], 30, 5))
    load = wheel_loads(plant)[0]  # at rest
    poses = drive(plant, constant([0, 0, 25.0], frames, 5))
    assert plant.telemetry().slip.min() > 0.5
    # Second differences: what is gained from frame 4 on, when all wheels slide.
    place, heading = poses[..., 0] + 1j * poses[..., 1], poses[..., 2]
    moved, turned = (
        each[-1] - each[4] - (each[4] - each[3]) * (frames - 4) for each in (place, heading)
    )
    friction, azimuths = plant.variation.friction_factor, plant.geometry.azimuths
    # Divided by the new robot's, whose inertia with all that turns along is the same. 1.5 %: the
    # net pull, 0.3 m/s^2 at 45 mm under the centre of mass, moves up to 5 % of a wheel's load to
    # another, and only some of it is turning.
    np.testing.assert_allclose(turned / turned[0], (friction @ load) / load.sum(), rtol=0.015)
    pulls = mu * (friction * load) @ np.exp(1j * (azimuths + np.pi / 2)) / (load.sum() / GRAVITY)
    frame = np.arange(4, frames)[:, None]
    expected = FRAME_S**2 * ((frames - frame) * pulls * np.exp(1j * heading[4:-1])).sum(0)
    # 7 % of the farthest: loads, as above, and 1 % for rims that turn along; new wheels pull on the
    # spot.
    np.testing.assert_allclose(moved, expected, atol=0.07 * np.abs(expected).max())


def test_mass_and_centre_are_carried_by_the_wheels() -> None:
    """The loads' sum is the weight, their middle the centre of mass, which the wheels dilute."""
    plant = plant_of(
        [noiseless(randomization={"mass_std": 0.1, "com_offset_std_m": 0.005})] * 4, seeds=range(4)
    )
    drive(plant, constant([0, 0, 0], 60, 4))
    load, body = wheel_loads(plant), Settings().body
    wheels = (
        sum(plant._world.model.body_mass)
        - plant._world.model.body_mass[plant._world.robots[0].chassis]
    )
    chassis = (body.mass_kg - wheels) * plant.variation.mass_factor[:, 0]
    np.testing.assert_allclose(load.sum(1), (chassis + wheels) * GRAVITY, rtol=1e-3)
    feet = plant.geometry.arm * np.column_stack(
        [np.cos(plant.geometry.azimuths), np.sin(plant.geometry.azimuths)]
    )
    middle = load @ feet / load.sum(1)[:, None]
    as_built = (body.mass_kg * np.array([body.com_x_m, 0]) - wheels * feet.mean(0)) / (
        body.mass_kg - wheels
    )
    moments = chassis[:, None] * (as_built + plant.variation.center_shift) + wheels * feet.mean(0)
    np.testing.assert_allclose(
        middle, moments / (chassis + wheels)[:, None], atol=5e-5
    )  # a hundredth of its spread


def test_a_robot_on_a_patch_slides_as_on_carpet_of_its_friction_and_brakes_at_its_edge() -> None:
    edge = 0.15  # of a patch so large that it is straight
    chosen = [
        noiseless(carpet=carpet, firmware={"kp": 0.4})
        for carpet in (
            {"friction": 0.2},
            {"friction": 0.8, "patches": [[0, 0, 5.0, 0.2]]},
            {"friction": 0.8, "patches": [[edge - 50, 0, 50.0, 0.2]]},
        )
    ]
    plant = plant_of(chosen)
    poses = drive(plant, constant([2.0, 0.0, 0.0], 60, 3))
    np.testing.assert_array_equal(poses[:, 0], poses[:, 1])
    x = poses[:, 2, 0]
    front, rear = plant.geometry.arm * np.cos(plant.geometry.azimuths[:2])
    on, off = np.flatnonzero(x + front < edge), np.flatnonzero(x + rear > edge)
    np.testing.assert_array_equal(poses[on[:-1], 2], poses[on[:-1], 0])
    gained = np.diff(x, 2) / FRAME_S**2
    # Four times the friction, less the same drag.
    assert gained[off[0] : off[0] + 2].min() > 4 * gained[on[5:-3]].max() > 0

"""Domain randomization of robots, and patches of carpets: distributions and effects."""

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
from omni_mj.config.resolve import resolve_settings
from omni_mj.config.world_settings import RandomizationSettings
from omni_mj.plants.randomization import RobotVariation

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


def draw(seeds: range | list[int], **variation: float) -> RobotVariation:
    return RobotVariation.draw(
        rows([with_settings(randomization=variation)] * len(seeds), list(seeds))
    )


def to_columns(variation: RobotVariation) -> NDArray:
    return np.column_stack(list(variation.to_columns().values()))


# --- distributions ---


def test_draws_of_a_seed_do_not_depend_on_other_rows_and_settings() -> None:
    """Another seed or slot draws other values; a larger deviation scales the drawn values."""
    batch, single = to_columns(draw(range(5), **ALL)), to_columns(draw([3], **ALL))
    np.testing.assert_array_equal(batch[3:4], single)
    assert not (batch[0] == batch[1]).any()
    pair = to_columns(
        RobotVariation.draw(rows([with_settings(randomization=ALL)] * 2, [3, 3], per_world=2))
    )
    np.testing.assert_array_equal(pair[0], single[0])
    assert not (pair[0] == pair[1]).any()
    wider = draw([3], **{**ALL, "wheel_friction_std": 0.2})
    np.testing.assert_array_equal(wider.wear, draw([3], **ALL).wear)
    np.testing.assert_allclose(
        wider.friction_factor - 1, 2 * (draw([3], **ALL).friction_factor - 1), rtol=1e-12
    )


def test_distributions_have_the_set_deviations() -> None:
    """Errors: s/sqrt(n) of means, s/sqrt(2n) of normal and s/sqrt(5n) of uniform deviations."""
    robots = draw(range(1500), **ALL)
    # A normal number that is truncated at 3 deviations has a deviation of 0.9866.
    for values, mean, name in (
        (robots.friction_factor, 1, "wheel_friction_std"),
        (robots.magnet_factor, 1, "torque_constant_std"),
        (robots.mass_factor, 1, "mass_std"),
        (robots.center_offset, 0, "com_offset_std_m"),
    ):
        sigma, n = 0.9866 * ALL[name], values.size
        assert abs(values.mean() - mean) < SIGMAS * sigma / np.sqrt(n), name
        assert abs(values.std() - sigma) < SIGMAS * sigma / np.sqrt(2 * n), name
        assert np.abs(values - mean).max() <= 3 * ALL[name] * (1 + 1e-12), name
    wear, n = robots.wear / ALL["max_wear_m"], robots.wear.size
    assert wear.min() >= 0
    assert wear.max() <= 1
    assert abs(wear.mean() - 1 / 2) < SIGMAS / np.sqrt(12 * n)
    assert abs(wear.std() - 1 / np.sqrt(12)) < SIGMAS / np.sqrt(60 * n)
    # Wheels and axes are independent.
    correlation = np.corrcoef(to_columns(robots).T) - np.eye(to_columns(robots).shape[1])
    assert np.abs(correlation).max() < SIGMAS / np.sqrt(1500)


def test_a_summary_has_the_drawn_parameters_of_each_seed() -> None:
    """Once per seed, even with several controllers; none on a plant without wheels."""
    short = load_scenario(
        "worn-robots", reference={"waypoints": [[0, 0], [0.05, 0]]}, wheels={"model": "two-rollers"}
    )
    result = run(short, ["flc", "comp-flc"], seeds=[3, 4])
    (entry,) = result.summary()["scenarios"].values()
    expected = draw([3, 4], **dict(short.settings.randomization)).to_columns()
    for i, parameters in enumerate(entry["drawn_parameters"]):
        assert parameters == {
            "seed": 3 + i,
            "slot": 0,
            **{name: values[i] for name, values in expected.items()},
        }
    assert result.rows()["friction_factor_1"].to_pylist() == [*expected["friction_factor_1"]] * 2
    new = short.settings.replace(randomization=RandomizationSettings())
    for nominal in (short.replace(plant="kinematic"), short.replace(settings=new)):
        (entry,) = run(nominal, ["flc"], seeds=[3]).summary()["scenarios"].values()
        assert entry["drawn_parameters"] == []


# --- effects ---


@pytest.mark.parametrize("model", MODELS)
def test_worn_wheels_roll_with_their_radius_and_stand_like_new_ones(model: str) -> None:
    """Without drag and nearly without creep, the path of a wheel is its angle times its radius."""
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
    pose = drive(plant, commands)[-1]
    angle, path = -plant.telemetry().wheel_angle, np.zeros((4, 4))
    for _ in range(30):
        new_pose = drive(plant, commands[-4:])[-1]
        x, y, turn = (new_pose - pose).T
        heading = (new_pose + pose)[:, 2] / 2
        body = np.column_stack(
            [np.cos(heading) * x + np.sin(heading) * y, np.cos(heading) * y - np.sin(heading) * x]
        )
        path += np.column_stack([body, turn]) @ plant.geometry.matrix.T
        pose = new_pose
    angle += plant.telemetry().wheel_angle
    radius = path / angle
    assert np.ptp(plant.variation.wear[2:]) > 5e-4
    # 0.05 % of the radius; new and worn wheels differ by 3 %. Both roll with 0.1 % less than their
    # radius, because rollers form a polygon.
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
    np.testing.assert_allclose(worn, new, rtol=0.01)  # the springs still oscillate by less
    assert np.abs(standing.pose()).max() < 1e-4


def test_traction_of_a_sliding_wheel_is_proportional_to_its_friction() -> None:
    """With all wheels sliding, the moment is sum(mu_i N_i) arm, the force the sum of tractions."""
    deviation, mu, frames = 0.3, 0.1, 14
    base = {"firmware": {"kp": 0.4, "turn_rate_gain": 0.0}, "drivetrain": NO_DRAG["drivetrain"]}
    carpet = {"friction": mu, "rolling_resistance": 0.0}
    chosen = [
        noiseless(carpet=carpet, randomization={"wheel_friction_std": std}, **base)
        for std in (0.0, *[deviation] * 4)
    ]
    plant = plant_of(chosen, seeds=range(5))
    drive(plant, constant([0, 0, 0], 30, 5))
    load = wheel_loads(plant)[0]  # at rest
    poses = drive(plant, constant([0, 0, 25.0], frames, 5))
    assert plant.telemetry().slip.min() > 0.5
    # Displacement and turn by the accelerations from frame 4 on, when all wheels slide
    position, heading = poses[..., 0] + 1j * poses[..., 1], poses[..., 2]
    displacement, turn = (x[-1] - x[4] - (x[4] - x[3]) * (frames - 4) for x in (position, heading))
    friction, azimuths = plant.variation.friction_factor, plant.geometry.azimuths
    # Over the turn of the nominal robot, which has the same inertia. 1.5 %: the net force,
    # 0.3 m/s^2 at 45 mm below the center of mass, shifts up to 5 % of a wheel's normal force to
    # another, with less effect on the turn.
    np.testing.assert_allclose(turn / turn[0], (friction @ load) / load.sum(), rtol=0.015)
    forces = mu * (friction * load) @ np.exp(1j * (azimuths + np.pi / 2)) / (load.sum() / GRAVITY)
    frame = np.arange(4, frames)[:, None]
    expected = FRAME_S**2 * ((frames - frame) * forces * np.exp(1j * heading[4:-1])).sum(0)
    # 7 % of the largest: normal forces, as above, and 1 % for the inertia of rims
    np.testing.assert_allclose(displacement, expected, atol=0.07 * np.abs(expected).max())


def test_wheels_carry_the_drawn_mass_and_center_of_mass() -> None:
    """The sum of the normal forces is the weight, their center that of chassis and wheels."""
    plant = plant_of(
        [noiseless(randomization={"mass_std": 0.1, "com_offset_std_m": 0.005})] * 4, seeds=range(4)
    )
    drive(plant, constant([0, 0, 0], 60, 4))
    load, body = wheel_loads(plant), resolve_settings().body
    wheels = (
        sum(plant._world.model.body_mass)
        - plant._world.model.body_mass[plant._world.robots[0].chassis]
    )
    chassis = (body.mass_kg - wheels) * plant.variation.mass_factor[:, 0]
    np.testing.assert_allclose(load.sum(1), (chassis + wheels) * GRAVITY, rtol=1e-3)
    feet = plant.geometry.arm * np.column_stack(
        [np.cos(plant.geometry.azimuths), np.sin(plant.geometry.azimuths)]
    )
    center = load @ feet / load.sum(1)[:, None]
    as_built = (body.mass_kg * np.array([body.com_x_m, 0]) - wheels * feet.mean(0)) / (
        body.mass_kg - wheels
    )
    moments = chassis[:, None] * (as_built + plant.variation.center_offset) + wheels * feet.mean(0)
    # The tolerance is a hundredth of the deviation.
    np.testing.assert_allclose(center, moments / (chassis + wheels)[:, None], atol=5e-5)


def test_a_patch_acts_like_a_carpet_of_its_friction_up_to_its_edge() -> None:
    edge = 0.15  # of a large patch, about straight
    chosen = [
        noiseless(carpet=carpet, firmware={"kp": 0.4}, drivetrain={"roller_friction": 0.09})
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
    acceleration = np.diff(x, 2) / FRAME_S**2
    # Four times the friction, less the same drag.
    assert acceleration[off[0] : off[0] + 2].min() > 4 * acceleration[on[5:-3]].max() > 0

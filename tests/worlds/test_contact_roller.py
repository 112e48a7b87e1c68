"""The faster wheel is the same physics: what it weighs, how it drives, where it leads."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from driving import FRAME_S, constant, drive, quiet, ramp, with_settings
from driving import mujoco as plant_of

from omni_control.kinematics import Array
from omni_mj.link.radio import Received
from omni_mj.worlds import build

FAST = {"model": "contact-roller"}
EITHER = (quiet(), quiet(wheels=FAST))


def inertia(world: build.World) -> Array:
    model = world.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    dofs = [*range(6), *world.robots[0].wheel_dofs]
    return full[np.ix_(dofs, dofs)]


def test_robots_with_either_wheel_weigh_and_turn_the_same() -> None:
    worlds = build.world(), build.world(one_roller=True)
    assert [world.model.nv for world in worlds] == [74, 14]
    assert [world.model.npair for world in worlds] == [64, 4]
    # Equal up to rounding: lumping moves nothing, and a mass matrix at rest knows nothing of the rollers' own spin.
    assert inertia(worlds[1]) == pytest.approx(inertia(worlds[0]), rel=1e-9, abs=1e-15)


def test_velocities_in_closed_loop_profiles_agree() -> None:
    """Ramps of 1 and 3 m/s^2 in x, y and diagonally, and a turn: within 1 % rms of the highest speed."""
    twists = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.8, -0.8, 0], [1.5, 0, 0], [0, 1.5, 0], [0, 0, 6.0]])
    commands = ramp(twists, [1.0, 1.0, 1.0, 3.0, 3.0, 12.0], 75)
    slow, fast = (np.diff(drive(plant_of([chosen] * 6), commands), axis=0) / FRAME_S for chosen in EITHER)
    size = np.linalg.norm(twists, axis=1)
    difference = ((fast - slow) * twists / size[:, None]).sum(-1)
    assert (np.sqrt((difference**2).mean(0)) < 0.01 * size).all()


def test_a_rectangle_is_driven_alike() -> None:
    """Held on its way by true poses: paths within 1 mm rms of each other, the largest errors within 10 %."""
    corners = np.array([[0, 0, 0], [0.4, 0, 0], [0.4, 0.3, 1.5], [0, 0.3, 0], [0, 0, 0]])
    share = (1 - np.cos(np.pi * np.arange(45) / 45)) / 2  # from rest to rest, at up to 3.5 m/s^2
    way = np.concatenate([a + share[:, None] * (b - a) for a, b in pairwise(corners)])
    speed = np.diff(way, axis=0, append=way[-1:]) / FRAME_S
    paths = []
    for chosen in EITHER:
        plant, path = plant_of([chosen]), []
        for wanted, ahead in zip(way, speed, strict=True):
            path.append(plant.pose()[0])
            plant.advance(Received.at_once((ahead + 3.0 * (wanted - path[-1]))[None], plant.pose()[:, 2]))
        paths.append(np.array(path))
    apart = paths[1] - paths[0]
    assert np.sqrt((apart[:, :2] ** 2).sum(1).mean()) < 1e-3
    errors = [np.abs(path - way).max(0) for path in paths]
    assert errors[1] == pytest.approx(errors[0], rel=0.1)


def test_wheel_angles_go_on_while_the_model_steps_back() -> None:
    """Angle is the integral of the wheel's speed, over many hand-overs and in either direction."""
    plant, speeds = plant_of([with_settings(wheels=FAST)] * 2), []
    start = plant.telemetry().wheel_angle
    for command in constant([[0.6, 0, 0], [0, 0, -5.0]], 60, 2):
        plant.advance(Received.at_once(command))
        speeds.append(plant.telemetry().wheel_speed)
    turned = plant.telemetry().wheel_angle - start
    assert (np.abs(turned) > 10).all()
    # Rectangles of a frame under a speed that hardly changes after the first few: 1 %.
    assert turned == pytest.approx(np.sum(speeds, axis=0) * FRAME_S, rel=0.01)

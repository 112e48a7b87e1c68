"""The faster wheel is the same physics: mass, load, driving, slip, and path."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from benches.plant import FRAME_S, ROLLERS, STIFF, constant, drive, noiseless, receive_at_once
from benches.plant import mujoco as plant_of
from benches.step_recorder import StepRecorder
from numpy.typing import NDArray

from omni_control.kinematics import Array
from omni_mj.mjcf import world_builder

FAST = {"model": "two-rollers"}
EITHER = (noiseless(), noiseless(wheels=FAST))


def inertia(world: world_builder.World, wheel_angle: float) -> Array:
    """Return the mass matrix without the rollers' dofs, with all wheels turned by an angle."""
    model, robot = world.model, world.robots[0]
    data = mujoco.MjData(model)
    data.qpos[robot.wheel_qpos] = wheel_angle
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    dofs = [*range(6), *robot.wheel_dofs, *robot.slip_dofs]
    return full[np.ix_(dofs, dofs)]


@pytest.mark.parametrize("wheel_angle", [0.0, 0.1, 0.3])
def test_both_wheel_models_have_the_same_inertia(wheel_angle: float) -> None:
    worlds = [world_builder.build_world(settings_i) for settings_i in EITHER]
    assert [world.model.nv for world in worlds] == [78, 22]
    assert [world.model.npair for world in worlds] == [64, 8]
    # Equal up to rounding: lumping moves nothing, and a mass matrix at rest knows nothing of the
    # rollers' own spin.
    assert inertia(worlds[1], wheel_angle) == pytest.approx(
        inertia(worlds[0], wheel_angle), rel=1e-9, abs=1e-12
    )


def rms(values: NDArray) -> NDArray:
    """Return the root mean square over steps and wheels for each row."""
    return np.asarray(np.sqrt((values**2).mean((0, 2))))


def test_both_wheel_models_drive_the_same_rectangle() -> None:
    """Feedback of true poses: paths differ by less than 0.3 mm rms, slips by less than a tenth."""
    corners = np.array([[0, 0, 0], [0.4, 0, 1.5], [0.4, 0.3, 3.0], [0, 0.3, 4.5], [0, 0, 6.0]])
    fraction = (1 - np.cos(np.pi * np.arange(45) / 45)) / 2  # from rest to rest, at up to 3.5 m/s^2
    route = np.concatenate([a + fraction[:, None] * (b - a) for a, b in pairwise(corners)])
    speed = np.diff(route, axis=0, append=route[-1:]) / FRAME_S
    paths, slips = [], []
    for chosen in EITHER:
        plant, path, slip = plant_of([chosen]), [], []
        for desired, ahead in zip(route, speed, strict=True):
            path.append(plant.pose()[0])
            plant.advance(
                receive_at_once((ahead + 3.0 * (desired - path[-1]))[None], plant.pose()[:, 2])
            )
            slip.append(plant.telemetry().slip)
        paths.append(np.array(path))
        slips.append(rms(np.array(slip))[0])
    difference = paths[1] - paths[0]
    assert np.sqrt((difference[:, :2] ** 2).sum(1).mean()) < 0.3e-3
    assert slips[1] == pytest.approx(slips[0], rel=0.1)


@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_both_wheel_models_slide_alike(friction: float) -> None:
    """TeamModel to be at 3 m/s at once; within 1 % of the way."""
    commands = constant([[3.0, 0, 0], [0, 3.0, 0], [-2.1, 2.1, 0]], 30, 3)
    poses = [
        drive(
            plant_of(
                [noiseless(carpet={"friction": friction}, firmware=STIFF, wheels=settings_i)] * 3
            ),
            commands,
        )[..., :2]
        for settings_i in ({}, FAST)
    ]
    displacement = np.linalg.norm(poses[0][-1], axis=1)
    assert (np.linalg.norm(poses[1] - poses[0], axis=2).max(0) < 0.01 * displacement).all()


def test_wrapping_rollers_does_not_change_the_encoder() -> None:
    """The hub angle is the integral of its speed in each step, over many wraps, both directions."""
    plant = plant_of([noiseless(wheels=FAST)] * 2)
    start = plant.telemetry().wheel_angle
    tape = StepRecorder(plant).drive(constant([[0.6, 0, 0], [0, 0, -5.0]], 60, 2))
    wheel_angle = plant.telemetry().wheel_angle - start
    assert (np.abs(wheel_angle) > 10).all()
    assert wheel_angle == pytest.approx(
        tape.steps["wheels"].sum(0) / 960, abs=1e-9
    )  # Euler's rule, up to rounding
    # The rims have been turned back by whole pitches; their slip angles remain.
    slips = plant._batch.bind("qpos")[:, plant._world.robots[0].slip_qpos]
    slid = tape.steps["slips"].sum(0) / 960
    back = (slips - slid) / (2 * np.pi / ROLLERS)
    assert back == pytest.approx(np.rint(back), abs=1e-6)
    assert np.abs(back).max() > 20

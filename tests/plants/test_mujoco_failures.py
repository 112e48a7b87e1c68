"""Failed rows are reported with the cause and stopped, and do not change others."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from benches.plant import mujoco as plant_of
from benches.plant import noiseless, receive_at_once, rows, with_settings
from numpy.typing import NDArray

from omni_control.errors import OmniError
from omni_mj.plants.mujoco_plant import MujocoPlant

# With this friction a braking robot tips over its wheels; on the league's carpet they slide. The
# current is not limited: with 9 A a robot only leans on the edge of its hull, at 31 degrees.
GRIPPING = {"carpet": {"friction": 5.0}, "firmware": {"current_limit_a": 1000.0}}
ORDINARY = {"disturbance": {"force_n": 2.0}}
FRAMES, BRAKES = 70, 45


@pytest.fixture(autouse=True)
def temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo logs its warnings to a file in the working directory


def run(
    plant: MujocoPlant, fast: tuple[int, ...], frames: int = FRAMES
) -> tuple[NDArray, dict[int, tuple[int, str]]]:
    """Return poses (frames, n, 3) and failures of robots that speed up and brake, some hard."""
    n, poses, failed = len(plant.pose()), [], {}
    max_speed = np.where(np.isin(np.arange(n), fast), 3.0, 0.6)
    for frame in range(frames):
        speed = np.minimum(max_speed, frame * 0.08) if frame < BRAKES else -max_speed
        command = np.stack([speed, 0 * speed, 0 * speed], axis=1)
        for row, cause in plant.advance(receive_at_once(command, plant.pose()[:, 2])).items():
            assert row not in failed, "reported once"
            failed[row] = frame, cause
        poses.append(plant.pose())
    return np.array(poses), failed


def test_a_toppling_robot_does_not_change_a_bit_of_others() -> None:
    ordinary, gripping = (
        noiseless(wheels={"model": "two-rollers"}, **sections) for sections in (ORDINARY, GRIPPING)
    )
    batch, failed = run(plant_of([ordinary, gripping, ordinary], seeds=[1, 2, 3]), (1,))
    separate, failures = run(plant_of([ordinary] * 2, seeds=[1, 3]), ())
    assert failures == {}
    np.testing.assert_array_equal(batch[:, [0, 2]], separate)
    ((row, (frame, cause)),) = failed.items()
    assert (row, cause) == (1, "toppled over")
    assert BRAKES < frame < FRAMES - 5
    np.testing.assert_array_equal(
        batch[frame + 1 :, 1], batch[[frame + 1] * (FRAMES - frame - 1), 1]
    )


def test_a_toppled_robot_stays_in_its_world_with_its_motors_off() -> None:
    start = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    plant = plant_of([noiseless(**ORDINARY), noiseless(**GRIPPING)], start, [1, 2], per_world=2)
    poses, failed = run(plant, (1,), FRAMES + 20)  # until it is at rest
    assert {row: cause for row, (_, cause) in failed.items()} == {1: "toppled over"}
    frame = failed[1][0]
    telemetry = plant.telemetry()
    assert (telemetry.voltage[1] == 0).all()
    assert (np.abs(telemetry.voltage[0]) > 0).any()
    # From at most 1.4 m/s it slides v^2 / (2 g 0.3) = 0.33 m with the hull's friction of 0.3, and
    # rollers slide too.
    assert np.abs(poses[-1, 1, :2] - poses[frame, 1, :2]).max() < 0.4
    # It lies on its hull, and no contact is deeper than a hard one.
    model, data = plant._batch.get_model(0), plant._batch.get_data(0)
    mujoco.mj_forward(model, data)
    assert {model.geom(g).name for contact in data.contact for g in contact.geom} >= {
        "carpet",
        "robot_2/hull",
    }
    assert min(contact.dist for contact in data.contact) > -5e-3
    # The other drives as it does alone, up to the solver's tolerance (see test_meeting) for the
    # whole world: large forces on a falling robot make it coarse. With a tolerance of 1e-10 in
    # place of 1e-8, the two differ by 1e-9.
    separate, _ = run(plant_of([noiseless(**ORDINARY)], seeds=[1]), (), FRAMES + 20)
    np.testing.assert_allclose(poses[:, 0], separate[:, 0], rtol=0, atol=3e-4)


def test_a_robot_has_toppled_from_45_degrees_of_tilt_in_any_direction() -> None:
    """Falling robots keep their tilt, 44.9 or 45.1 degrees, whatever their heading."""
    headings, axes, tilts = np.meshgrid([0.0, 2.0], np.arange(4) * 1.6, np.radians([44.9, 45.1]))
    heading, axis, tilt = headings.ravel(), axes.ravel(), tilts.ravel()
    plant = plant_of([noiseless()] * tilt.size)
    pose = np.array(plant._views.pose.get())
    pose[2] = 0.5  # m above the carpet
    tilt_about_axis = np.array([np.cos(axis), np.sin(axis)]) * np.sin(tilt / 2)
    for i in range(tilt.size):
        turn = np.array([np.cos(heading[i] / 2), 0, 0, np.sin(heading[i] / 2)])
        tilted = np.array([np.cos(tilt[i] / 2), *tilt_about_axis[:, i], 0])
        quaternion = np.zeros(4)
        mujoco.mju_mulQuat(quaternion, tilted, turn)
        pose[3:, i] = quaternion
    plant._views.pose.set(pose)
    failed = plant.advance(receive_at_once(np.zeros((tilt.size, 3)), plant.pose()[:, 2]))
    is_beyond = tilt > np.radians(45)
    assert failed == dict.fromkeys(np.flatnonzero(is_beyond).tolist(), "toppled over")


@pytest.mark.parametrize("x", [math.nan, 1e11], ids=["not a number", "too far"])
def test_an_unstable_robot_is_reported_and_does_not_change_a_bit_of_others(
    x: float,
) -> None:
    start = np.array([[0.3, 0, 0], [x, 0, 0], [0, 0, 1]])
    batch, failed = run(plant_of([noiseless(**ORDINARY)] * 3, start, [1, 2, 3]), (), 12)
    separate, _ = run(plant_of([noiseless(**ORDINARY)] * 2, start[[0, 2]], [1, 3]), (), 12)
    np.testing.assert_array_equal(batch[:, [0, 2]], separate)
    cause = "became unstable (MuJoCo: mjWARN_BADQPOS)"
    assert failed == {1: (0, cause)}


def test_an_unstable_world_stops_all_its_robots_and_no_other_world() -> None:
    start = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]] * 2
    plant, calm = (
        plant_of([noiseless(**ORDINARY)] * 4, start, [1, 1, 2, 2], per_world=2) for _ in range(2)
    )
    plant._batch.bind("qvel")[0, 80] = math.nan
    poses, failed = run(plant, (), 12)
    cause = "became unstable (MuJoCo: mjWARN_BADQVEL)"
    assert failed == {0: (0, cause), 1: (0, cause)}
    np.testing.assert_array_equal(poses[:, 2:], run(calm, (), 12)[0][:, 2:])
    # They are put back to their start poses, and stay.
    np.testing.assert_allclose(poses[1:, :2], np.tile(start[:2], (11, 1, 1)), atol=1e-3)


def test_rows_that_cannot_share_a_batch_are_refused() -> None:
    finer = rows([with_settings(), with_settings(physics={"substeps": 2})])
    heavier = rows([with_settings(), with_settings(body={"mass_kg": 3.0}, wheels={"arm_m": 0.09})])
    geared = rows([with_settings(), with_settings(motor={"gear_ratio": 4.0})])
    for wrong, message in (
        (finer, "rows 0 and 1 differ in physics"),
        (heavier, "rows 0 and 1 differ in body"),
        (geared, "rows 0 and 1 differ in motor.gear_ratio"),
    ):
        with pytest.raises(OmniError, match=message):
            MujocoPlant(wrong, np.zeros((len(wrong), 3)))

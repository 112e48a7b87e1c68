"""Rows have their own settings, and the same bits alone and in a batch, also if others fail."""

from pathlib import Path

import numpy as np
import pytest
from benches.short_simulations import (
    FAST,
    PLANTS,
    assert_rows_equal,
    isolate_row,
    simulation,
    variants,
)

import omni_mj as om

ROUTE = ("reference.waypoints=[[0,0],[0.25,0]]", "reference.settle_s=0.1", *FAST)


@pytest.mark.parametrize("plant", PLANTS)
def test_rows_of_a_batch_equal_single_runs(plant: str) -> None:
    """Rows differ in delay, noise, jitter, friction, gains, limits and reference."""
    changes = [
        {},
        {"radio": {"delay_frames": 3}},
        {"radio": {"delay_frames": 9, "jitter_frames": 4}, "control": {"delay_error_frames": -2}},
        {"vision": {"position_noise_m": 0.004, "miss_probability": 0.2, "dropout_fraction": 0.5}},
        {
            "carpet": {"friction": 0.3},
            "disturbance": {"force_n": 8.0, "velocity_m_s": 0.2},
            "radio": {"delay_frames": 3.5, "jitter_frames": 0.5, "loss_probability": 0.1},
        },
        {
            "firmware": {"kp": 0.1, "ki": 1.0},
            "battery": {"charge": 0.15},
            "kinematic": {"alpha_correlation_time_s": 1.0},
            "radio": {"delay_frames": 2, "kind": "wifi-broadcast"},
        },
        {"control": {"max_speed_m_s": 0.3, "error_range_m": 0.2}, "motor": {"winding_c": 110.0}},
        {
            "reference": {"max_acceleration_m_s2": 2.0, "mode": "iterated"},
            "sensors": {"gyro_bias_rad_s": 0.05},
        },
    ]
    together = variants(plant, changes, ("comp-flc", "adaptive-comp-flc"), ROUTE)
    batch = together.run()
    assert not together.failures
    for row in (
        range(len(changes)) if plant == "kinematic" else (4, 5, 7)
    ):  # what wheels, motors and sensors know of
        assert_rows_equal(batch, row, isolate_row(together, row).run(), 0)
    assert len(set(batch.lengths)) > 1, "routes of different lengths end at different times"


USERS = """
from omni_control import Controller


class Raises(Controller):
    at: int = 20

    def command(self, frame, observation):
        if frame == self.at:
            raise RuntimeError("had enough")
        return self.reference.at(frame, observation.pose)[1]


class NotANumber(Controller):
    def command(self, frame, observation):
        command = self.reference.at(frame, observation.pose)[1].copy()
        if frame == 20:
            command[observation.pose[:, 0] > observation.pose[:, 0].min()] = float("nan")
        return command


class Ragged(Controller):
    def command(self, frame, observation):
        return [[1.0, 2.0], [3.0]]


class Unmade(Controller):
    def __init__(self, told, reference, n):
        raise ValueError("not today")
"""


@pytest.fixture
def users(tmp_path: Path) -> dict[str, str]:
    file = tmp_path / "users.py"
    file.write_text(USERS)
    return {name: f"{file}:{name}" for name in ("Raises", "NotANumber", "Ragged", "Unmade")}


def test_a_controller_that_fails_stops_its_own_rows_and_no_others(users: dict[str, str]) -> None:
    names = (users["Raises"], "comp-flc", users["NotANumber"], users["Ragged"], users["Unmade"])
    simulated = simulation("kinematic", controllers=names, seeds=2)
    log = simulated.run()
    by_themselves = simulation("kinematic", controllers=("comp-flc",), seeds=2).run()
    for seed in range(2):
        assert_rows_equal(log, 2 + seed, by_themselves, seed)
    failed = {(failure.controller, failure.seed): failure for failure in simulated.failures}
    for seed in range(2):
        raised, ragged, unmade = (failed[name, seed] for name in ("Raises", "Ragged", "Unmade"))
        assert raised.time_s == pytest.approx(20 / 60)
        assert "users.py, line 10" in raised.cause
        assert "had enough" in raised.cause
        assert ragged.time_s == 0
        assert "not today" in unmade.cause
    # Only the row whose values were not finite stops; the other of the same controller goes on.
    (not_finite,) = [
        failure for failure in simulated.failures if failure.controller == "NotANumber"
    ]
    assert "finite" in not_finite.cause
    lengths = log.lengths.tolist()
    assert lengths[:2] == [20, 20]
    assert sorted(lengths[4:6]) == [20, log.length]
    assert lengths[6:] == [0] * 4


def test_a_toppled_robot_is_stopped_and_the_others_do_not_change() -> None:
    """A robot that reverses from 3 m/s with 40 m/s^2 on a rough carpet topples."""
    task = {
        "assumed_friction": 0.0,
        "max_acceleration_m_s2": 20.0,
        "max_speed_m_s": 3.0,
        "waypoints": [[0, 0], [3, 0], [0, 0]],
    }
    rough = {
        "carpet": {"friction": 3.0},
        "control": {"max_acceleration_m_s2": 100.0},
        "reference": task,
    }
    together = variants(
        "mujoco", [{}, rough | {"radio": {"delay_frames": 0}}, {}], ("comp-flc",), ROUTE
    )
    log = together.run()
    (failure,) = together.failures
    assert (failure.row, failure.controller) == (1, "comp-flc")
    assert "toppled" in failure.cause
    assert 0 < failure.time_s < 3
    assert log.lengths[1] == round(failure.time_s * 60)
    for row in range(3):  # what it did until it fell is recorded, and is what it does alone
        assert_rows_equal(log, row, isolate_row(together, row).run(), 0)


@pytest.mark.parametrize("plant", PLANTS)
def test_robots_of_one_world_drive_next_to_each_other(plant: str) -> None:
    """Start poses displace the references. The first robot has the noise of a single robot."""
    start_poses = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.5 * np.pi]]
    together = simulation(
        plant, (f"world.start_poses={start_poses}",), ("comp-flc",), seeds=2, route=ROUTE
    )
    log = together.run()
    assert not together.failures
    assert [(row.world_index, row.slot, row.seed) for row in together.rows] == [
        (0, 0, 0),
        (0, 1, 0),
        (1, 0, 1),
        (1, 1, 1),
    ]
    single_log = simulation(plant, (), ("comp-flc",), seeds=2, route=ROUTE).run()
    noise = (log.channel("vision") - log.channel("pose"))[..., :2]
    single = (single_log.channel("vision") - single_log.channel("pose"))[..., :2]
    np.testing.assert_allclose(noise[:, [0, 2]], single, rtol=0, atol=1e-12)
    assert (noise[:, 0] != noise[:, 1])[~np.isnan(noise[:, 1]) & ~np.isnan(noise[:, 0])].all()
    ref = log.channel("ref")
    # A quarter turn maps driving along x from the origin to driving along y from (0, 1).
    np.testing.assert_allclose(ref[:, 1, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(ref[:, 1, 1], 1.0 + ref[:, 0, 0], atol=1e-12)
    np.testing.assert_allclose(ref[:, 1, 2], 0.5 * np.pi)
    error = np.linalg.norm((log.channel("pose") - ref)[..., :2], axis=-1)
    assert error.max() < 0.06


def test_a_row_whose_controller_the_scenario_lacks_is_named() -> None:
    rows = simulation("kinematic", ROUTE, ("flc",), seeds=1).rows
    with pytest.raises(
        om.OmniError, match="a row names the controller 'flc'; choose from comp-flc"
    ):
        om.Simulation(om.load_scenario("rect", plant="kinematic"), ["comp-flc"], rows=rows)

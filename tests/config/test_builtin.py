"""The scenarios that come with the package: tasks for a division-B field that every controller can be set."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from commands import listed
from numpy.typing import NDArray

import omni_mj as om

BUILTIN, ROBOTS = listed("scenarios"), listed("robots")
TASKS = ("circle", "figure-eight", "rect-spin", "sprint", "random-waypoints")
PERIOD_S = 1 / 60
FIELD_M = (9.0, 6.0)  # division B, RoboCup-SSL rules
ROBOT_M = 0.09  # radius of the largest robot, same


@cache
def built_in(name: str) -> tuple[om.Scenario, NDArray]:
    """Return the scenario and its timed reference's poses (frames, 3)."""
    scenario = om.load_scenario(name, plant="planar" if name.startswith("fault") else "kinematic")
    return scenario, om.Simulation(scenario, ["p"], seeds=[0]).references[0].poses


@pytest.mark.parametrize("name", BUILTIN)
def test_every_scenario_is_a_drive_on_the_field_and_reads_back(name: str, tmp_path) -> None:
    """Finite, from rest to rest, the whole robot inside the lines; the lists name and describe it."""
    scenario, poses = built_in(name)
    limit = scenario.settings.reference
    for ends in (
        poses[:2],
        poses[-2:],
    ):  # at rest: no more than a frame's acceleration away from it
        moved = np.abs(ends[1] - ends[0]) / PERIOD_S**2
        assert np.hypot(*moved[:2]) <= limit.max_acceleration_m_s2 * (1 + 1e-8)
        assert moved[2] <= limit.max_turn_acceleration_rad_s2 * (1 + 1e-8)
    assert (np.abs(poses[:, :2]).max(0) + ROBOT_M <= np.array(FIELD_M) / 2).all()
    assert name not in TASKS or 8 <= (len(poses) - 1) * PERIOD_S <= 25
    assert scenario.name == name
    assert scenario.description
    (tmp_path / "again.toml").write_text(scenario.to_toml())
    assert om.load_scenario(tmp_path / "again.toml") == scenario


def test_the_papers_rectangle_and_what_the_tasks_are() -> None:
    rect, _ = built_in("rect")
    corners = [waypoint[:2] for waypoint in rect.settings.reference.waypoints]
    assert [math.dist(a, b) for a, b in pairwise(corners)] == [2.0, 1.5, 2.0, 1.5]
    assert rect.settings.radio.delay_frames / 60 == pytest.approx(0.1)  # the paper's dead time, s
    assert rect.settings.reference.max_acceleration_m_s2 == 0.826
    noise, _ = built_in("rect-noise")
    assert noise.settings.disturbance.velocity_m_s == 0.1
    assert noise.settings.reference == rect.settings.reference
    _, circle = built_in("circle")  # two laps of one metre radius; chords of 3 cm are 4e-5 short
    np.testing.assert_allclose(np.hypot(circle[:, 0], circle[:, 1]), 1, atol=1e-12)
    assert np.hypot(*np.diff(circle[:, :2], axis=0).T).sum() == pytest.approx(4 * math.pi, rel=1e-4)
    _, eight = built_in("figure-eight")
    np.testing.assert_allclose(np.ptp(eight[:, :2], axis=0), [2, 1], atol=1e-3)
    assert np.ptp(eight[:, 2]) == pytest.approx(1.5 * math.pi, abs=0.01)  # faced along
    _, sprint = built_in("sprint")
    assert np.ptp(sprint, axis=0) == pytest.approx([4, 0, 0], abs=1e-9)
    assert np.abs(np.diff(sprint[:, 0])).max() / PERIOD_S == pytest.approx(2.5)


@pytest.mark.parametrize("name", TASKS)
def test_a_certain_robot_without_dead_time_drives_every_task_exactly(name: str) -> None:
    """On equation 7 with alpha = 1, without noise and dead time, feed-forward alone is the task: nothing is left."""
    vision = {"position_noise_m": 0.0, "heading_noise_rad": 0.0, "miss_probability": 0.0}
    exact = {
        "kinematic": {"alpha_low": 1.0},
        "radio": {"delay_frames": 0},
        "control": {"assumed_lag_s": 0.0},
        "vision": vision,
    }
    frames = om.run(
        om.load_scenario(name, plant="kinematic", **exact), ["flc", "comp-flc"]
    ).frames()
    for column in ("x_m", "y_m", "heading_rad"):
        np.testing.assert_allclose(frames[column], frames[f"ref_{column}"], rtol=0, atol=1e-9)


def random_points(**changes: object) -> NDArray:
    """Return the way-points (count, 3) that a random task rests at."""
    task = {
        "shape": "random",
        "dwell_s": 0.1,
        "initial_rest_s": 0.1,
        "settle_s": 0.1,
        "assumed_friction": 0.0,
        **changes,
    }
    poses = (
        om.Simulation(om.load_scenario("rect", plant="kinematic", reference=task), ["p"])
        .references[0]
        .poses
    )
    rests = (np.diff(poses, axis=0) == 0).all(1)
    return poses[1:][rests & np.append(True, ~rests[:-1])]


def test_random_way_points_fill_the_rectangle_and_all_headings_and_are_a_seeds_own() -> None:
    """A uniform variable on (-1, 1) has mean 0 and variance 1/3; of 300, within 5 standard errors."""
    points = random_points(waypoint_count=300, length_m=4.0, width_m=3.0)
    assert points.shape == (300, 3)
    assert np.abs(np.diff(points[:, 2])).max() <= math.pi
    headings = np.angle(np.exp(1j * points[:, 2]))
    for unit in (points[:, 0] / 2, points[:, 1] / 1.5, headings / math.pi):
        assert np.abs(unit).max() <= 1
        assert abs(unit.mean()) < 5 * math.sqrt(1 / 3 / 300)
        assert abs((unit**2).mean() - 1 / 3) < 5 * math.sqrt((1 / 5 - 1 / 9) / 300)
    assert (
        random_points(seed=3, waypoint_count=12)[:10].tobytes()
        == random_points(seed=3, waypoint_count=10).tobytes()
    )
    assert not np.isin(random_points(seed=3), random_points(seed=4)).any()


def test_commands_must_arrive_before_the_end() -> None:
    short = {"waypoints": [[0, 0], [0.1, 0]], "settle_s": 0.1}
    frames = (
        om.Simulation(om.load_scenario("rect", plant="kinematic", reference=short))
        .references[0]
        .frames
    )
    om.Simulation(
        om.load_scenario(
            "rect", plant="kinematic", reference=short, radio={"delay_frames": frames - 1}
        )
    )
    message = f"must be less than the {frames} frames of the reference, got {frames}"
    with pytest.raises(om.OmniError, match=message):
        om.Simulation(
            om.load_scenario(
                "rect", plant="kinematic", reference=short, radio={"delay_frames": frames}
            )
        )


@pytest.mark.parametrize("name", ["league", "sprint", "slippery", "rect-spin"])
def test_no_task_is_slowed_by_what_wheels_can_do(name: str) -> None:
    """On the carpet that teams believe in, every robot's wheels do what the limits of motion ask."""
    for robot in ROBOTS:
        believed, free = (
            om.Simulation(
                om.load_scenario(name, plant="kinematic", robot=robot, **more), ["p"], seeds=[0]
            )
            .references[0]
            .poses
            for more in ({}, {"reference": {"assumed_friction": 0.0}})
        )
        np.testing.assert_array_equal(believed, free)

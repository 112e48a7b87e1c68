"""The scenarios of the package: tasks for a division-B field and every controller."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from commands import list_names
from numpy.typing import NDArray

import omni_mj as om

BUILTIN, ROBOTS = list_names("scenarios"), list_names("robots")
TASKS = ("circle", "figure-eight", "rect-spin", "sprint", "random-waypoints")
PERIOD_S = 1 / 60
FIELD_M = (9.0, 6.0)  # division B, RoboCup SSL rules
ROBOT_RADIUS_M = 0.09  # largest robot, RoboCup SSL rules


def plan_reference(name: str, **sections: object) -> NDArray:
    """Return the poses (frames, 3) of the timed reference of a scenario."""
    scenario = om.load_scenario(name, plant="kinematic", **sections)
    return om.Simulation(scenario, ["p"], seeds=[0]).references[0].poses


@cache
def load_builtin(name: str) -> tuple[om.Scenario, NDArray]:
    """Return the scenario and its timed reference's poses (frames, 3)."""
    scenario = om.load_scenario(name, plant="planar" if name.startswith("fault") else "kinematic")
    return scenario, om.Simulation(scenario, ["p"], seeds=[0]).references[0].poses


@pytest.mark.parametrize("name", BUILTIN)
def test_every_scenario_stays_on_the_field_and_reads_back(name: str, tmp_path) -> None:
    """Check motion from rest to rest, the whole robot inside the lines, and the description."""
    scenario, poses = load_builtin(name)
    limits = scenario.settings.reference
    for end_poses in (poses[:2], poses[-2:]):
        # Starting from rest, the first frame displaces by at most the acceleration limit.
        acceleration = np.abs(end_poses[1] - end_poses[0]) / PERIOD_S**2
        assert np.hypot(*acceleration[:2]) <= limits.max_acceleration_m_s2 * (1 + 1e-8)
        assert acceleration[2] <= limits.max_turn_acceleration_rad_s2 * (1 + 1e-8)
    assert (np.abs(poses[:, :2]).max(0) + ROBOT_RADIUS_M <= np.array(FIELD_M) / 2).all()
    assert name not in TASKS or 8 <= (len(poses) - 1) * PERIOD_S <= 25
    assert scenario.name == name
    assert scenario.description
    (tmp_path / "written.toml").write_text(scenario.to_toml())
    assert om.load_scenario(tmp_path / "written.toml") == scenario


def test_routes_have_their_described_dimensions() -> None:
    rect, _ = load_builtin("rect")
    corners = [waypoint[:2] for waypoint in rect.settings.reference.waypoints]
    assert [math.dist(a, b) for a, b in pairwise(corners)] == [2.0, 1.5, 2.0, 1.5]
    assert rect.settings.radio.delay_frames / 60 == pytest.approx(0.1)  # the paper's dead time, s
    assert rect.settings.reference.max_acceleration_m_s2 == 0.826
    noise, _ = load_builtin("rect-noise")
    assert noise.settings.disturbance.velocity_m_s == 0.1
    assert noise.settings.reference == rect.settings.reference
    _, circle = load_builtin("circle")  # two laps of 1 m radius; chords of 3 cm are 4e-5 short
    np.testing.assert_allclose(np.hypot(circle[:, 0], circle[:, 1]), 1, atol=1e-12)
    assert np.hypot(*np.diff(circle[:, :2], axis=0).T).sum() == pytest.approx(4 * math.pi, rel=1e-4)
    _, eight = load_builtin("figure-eight")
    np.testing.assert_allclose(np.ptp(eight[:, :2], axis=0), [2, 1], atol=1e-3)
    assert np.ptp(eight[:, 2]) == pytest.approx(1.5 * math.pi, abs=0.01)  # heading along the path
    _, sprint = load_builtin("sprint")
    assert np.ptp(sprint, axis=0) == pytest.approx([4, 0, 0], abs=1e-9)
    assert np.abs(np.diff(sprint[:, 0])).max() / PERIOD_S == pytest.approx(2.5)


@pytest.mark.parametrize("name", TASKS)
def test_ideal_robot_follows_every_task_exactly(name: str) -> None:
    """With alpha = 1 in equation 7 and no noise or dead time, feedforward alone is exact."""
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


def find_random_waypoints(**changes: object) -> NDArray:
    """Return the waypoints (n, 3) of a random reference: the poses at which it rests."""
    task = {
        "shape": "random",
        "dwell_s": 0.1,
        "initial_rest_s": 0.1,
        "settle_s": 0.1,
        "assumed_friction": 0.0,
        **changes,
    }
    poses = plan_reference("rect", reference=task)
    rests = (np.diff(poses, axis=0) == 0).all(1)
    return poses[1:][rests & np.append(True, ~rests[:-1])]


def test_random_waypoints_are_uniform_and_depend_on_the_seed() -> None:
    """Compare with mean 0 and variance 1/3 of uniform(-1, 1), within 5 standard errors."""
    points = find_random_waypoints(waypoint_count=300, length_m=4.0, width_m=3.0)
    assert points.shape == (300, 3)
    assert np.abs(np.diff(points[:, 2])).max() <= math.pi
    headings = np.angle(np.exp(1j * points[:, 2]))
    for normalized in (points[:, 0] / 2, points[:, 1] / 1.5, headings / math.pi):
        assert np.abs(normalized).max() <= 1
        assert abs(normalized.mean()) < 5 * math.sqrt(1 / 3 / 300)
        assert abs((normalized**2).mean() - 1 / 3) < 5 * math.sqrt((1 / 5 - 1 / 9) / 300)
    assert (
        find_random_waypoints(seed=3, waypoint_count=12)[:10].tobytes()
        == find_random_waypoints(seed=3, waypoint_count=10).tobytes()
    )
    assert not np.isin(find_random_waypoints(seed=3), find_random_waypoints(seed=4)).any()


def test_dead_time_must_be_shorter_than_the_reference() -> None:
    short = {"waypoints": [[0, 0], [0.1, 0]], "settle_s": 0.1}
    frames = len(plan_reference("rect", reference=short))
    plan_reference("rect", reference=short, radio={"delay_frames": frames - 1})
    message = f"must be less than the {frames} frames of the reference, got {frames}"
    with pytest.raises(om.OmniError, match=message):
        plan_reference("rect", reference=short, radio={"delay_frames": frames})


@pytest.mark.parametrize("name", ["league", "sprint", "slippery", "rect-spin"])
def test_wheel_limits_slow_down_no_task(name: str) -> None:
    """With the assumed friction, every robot has the traction that the motion limits need."""
    for robot in ROBOTS:
        limited = plan_reference(name, robot=robot)
        unlimited = plan_reference(name, robot=robot, reference={"assumed_friction": 0.0})
        np.testing.assert_array_equal(limited, unlimited)

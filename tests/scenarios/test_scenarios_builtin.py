"""The scenarios that come with the package: tasks for a division-B field that every controller can be set."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from omni_control.kinematics import Array
from omni_control.traction import traction_limits
from omni_mj import robots
from omni_mj.measure import recovery
from omni_mj.scenarios import references, scenario
from omni_mj.scenarios.faults import Friction, span
from omni_mj.scenarios.library import builtin
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.slip.law import expected
from omni_mj.worlds.build import kinematics

TASKS = ("circle", "eight", "square-spin", "sprint", "waypoints")
PAPERS = ("flc", "comp-flc")
FIELD_M = (9.0, 6.0)  # division B, RoboCup-SSL rules
ROBOT_M = 0.09  # radius of the largest robot, same


@cache
def built_in(name: str) -> tuple[Scenario, Array]:
    """The scenario and its timed reference's poses (frames, 3)."""
    loaded = scenario.load(name)
    return loaded, references.timed(loaded.settings).poses


@pytest.mark.parametrize("name", builtin())
def test_every_task_is_a_drive_on_the_field(name: str) -> None:
    """Finite, from rest to rest, and the whole robot inside the lines."""
    loaded, poses = built_in(name)
    assert np.isfinite(poses).all()
    limit = loaded.settings.reference
    for ends in (poses[:2], poses[-2:]):  # at rest: no more than a frame's acceleration away from it
        moved = np.abs(ends[1] - ends[0]) / PERIOD_S**2
        assert np.hypot(*moved[:2]) <= limit.max_acceleration_m_s2 * (1 + 1e-8)
        assert moved[2] <= limit.max_turn_acceleration_rad_s2 * (1 + 1e-8)
    assert (np.abs(poses[:, :2]).max(0) + ROBOT_M <= np.array(FIELD_M) / 2).all()


@pytest.mark.parametrize("name", TASKS)
def test_the_tasks_are_there_and_take_8_to_25_seconds(name: str) -> None:
    """Long enough to show a controller, short enough to try ten seeds of it."""
    _, poses = built_in(name)
    assert 8 <= (len(poses) - 1) * PERIOD_S <= 25


EXACT = (
    "kinematic.alpha_low=1",
    "radio.delay_frames=0",
    "control.lag_s=0",
    "vision.position_noise_m=0",
    "vision.heading_noise_rad=0",
    "vision.miss_probability=0",
)


@cache
def exact() -> Log:
    """All tasks in one batch, by the paper's controllers: a row each is what it is alone."""
    chosen = [scenario.load(name, EXACT, {"plant": "kinematic"}) for name in TASKS]
    rows = [(each, label) for each in chosen for label in PAPERS]
    numbered = [Row(i, 0, label, 0, each.settings, each.robot) for i, (each, label) in enumerate(rows)]
    simulation = Simulation(chosen[0], PAPERS, rows=numbered)
    simulation.run()
    assert not simulation.failures
    return simulation.log


@pytest.mark.parametrize("name", TASKS)
def test_a_certain_robot_without_dead_time_drives_every_task_exactly(name: str) -> None:
    """On equation 7 with alpha = 1, without noise and dead time, feed-forward alone is the task: nothing is left."""
    log, frames = exact(), len(built_in(name)[1])
    first = TASKS.index(name) * len(PAPERS)
    rows = slice(first, first + len(PAPERS))
    assert (log.lengths[rows] == frames).all()
    errors = log.channel("pose")[:frames, rows] - log.channel("ref")[:frames, rows]
    np.testing.assert_allclose(errors, 0, rtol=0, atol=1e-9)


# --- what each of them is ---


def test_the_circle_is_two_laps_of_one_metre_radius() -> None:
    """Every pose is a metre from the centre, at heading 0; the way is twice its circumference."""
    _, poses = built_in("circle")
    np.testing.assert_allclose(np.hypot(poses[:, 0], poses[:, 1]), 1, atol=1e-12)
    assert (poses[:, 2] == 0).all()
    # Chords of 3 cm on a circle of 1 m: 4e-5 short.
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() == pytest.approx(4 * math.pi, rel=1e-4)


def test_the_eight_is_faced_along_and_two_by_one_metre() -> None:
    """It fills its extents, up to the frames next to the outermost points, and turns through most of a circle."""
    _, poses = built_in("eight")
    np.testing.assert_allclose(np.ptp(poses[:, :2], axis=0), [2, 1], atol=1e-3)
    assert np.ptp(poses[:, 2]) == pytest.approx(1.5 * math.pi, abs=0.01)  # from 45 deg on to 45 deg beyond a half turn


def test_the_square_spin_turns_half_a_turn_a_side_while_driving() -> None:
    """The paper's rectangle; on each side the turn takes at least 9/10 of the drive, and the drive of the turn."""
    loaded, poses = built_in("square-spin")
    points = loaded.settings.reference.waypoints
    assert [point[:2] for point in points] == [point[:2] for point in built_in("rect")[0].settings.reference.waypoints]
    np.testing.assert_allclose(np.diff([point[2] for point in points]), math.pi)
    corners = [int(np.abs(poses - point).max(1).argmin()) for point in points]
    for start, end in pairwise(corners):
        moves = np.abs(np.diff(poses[start : end + 1], axis=0))
        driving, turning = np.hypot(moves[:, 0], moves[:, 1]) > 1e-9, moves[:, 2] > 1e-9
        assert (driving & turning).sum() >= 0.9 * max(driving.sum(), turning.sum())


def test_the_sprint_is_four_metres_at_the_leagues_speed() -> None:
    """There and back, reaching 2.5 m/s on the way."""
    _, poses = built_in("sprint")
    assert np.ptp(poses, axis=0) == pytest.approx([4, 0, 0], abs=1e-9)  # a reference snaps to a way-point from there
    assert np.abs(np.diff(poses[:, 0])).max() / PERIOD_S == pytest.approx(2.5)


# --- way-points at random ---


def visits(**changes: object) -> Array:
    """The way-points (count, 3) of a random task, as an iterated reference knows them."""
    return references.iterated(Settings(reference={"shape": "random", **changes}), 1).waypoints


@hypothesis_settings(deadline=None, max_examples=60, derandomize=True)
@given(st.integers(0, 10**6), st.integers(2, 50), st.floats(0.1, 20), st.floats(0.1, 20))
def test_random_way_points_are_as_asked(seed: int, count: int, length: float, width: float) -> None:
    """As many as asked, inside the rectangle, each elsewhere than the one before, turning the shorter way."""
    points = visits(seed=seed, count=count, length_m=length, width_m=width)
    assert points.shape == (count, 3)
    assert (np.abs(points[:, :2]) <= [length / 2, width / 2]).all()
    assert (np.diff(points, axis=0) != 0).all()
    assert np.abs(np.diff(points[:, 2])).max() <= math.pi


def test_random_way_points_fill_the_rectangle_and_all_headings() -> None:
    """A uniform variable on (-1, 1) has mean 0 and variance 1/3; of 1000, within 5 standard errors."""
    points = visits(count=1000, length_m=4.0, width_m=3.0)
    headings = np.angle(np.exp(1j * points[:, 2]))
    for unit in (points[:, 0] / 2, points[:, 1] / 1.5, headings / math.pi):
        assert abs(unit.mean()) < 5 * math.sqrt(1 / 3 / 1000)
        assert abs((unit**2).mean() - 1 / 3) < 5 * math.sqrt((1 / 5 - 1 / 9) / 1000)


def test_one_seed_one_task_another_another() -> None:
    """The same seed draws the same bits, another shares no number with it; more way-points do not change the first."""
    assert visits(seed=3).tobytes() == visits(seed=3).tobytes()
    assert not np.isin(visits(seed=3), visits(seed=4)).any()
    assert visits(seed=3, count=12)[:10].tobytes() == visits(seed=3, count=10).tobytes()


def test_all_seeds_of_a_run_see_the_same_task() -> None:
    """The run's seed is for its noise, not for its way-points."""
    first, other = (scenario.load("waypoints", (), {"seed": seed}).settings for seed in (0, 1))
    assert references.timed(first).poses.tobytes() == references.timed(other).poses.tobytes()


def test_a_random_task_can_be_planned_anew_in_every_frame() -> None:
    """An iterated reference is given the way-points that the timed one drives through."""
    settings = scenario.load("waypoints", ["reference.mode=iterated"]).settings
    poses = references.timed(settings).poses
    for point in references.iterated(settings, 2).waypoints:
        assert (poses == point).all(1).any()


@pytest.mark.parametrize("name", builtin())
def test_no_task_is_slowed_by_what_wheels_can_do(name: str) -> None:
    """On the carpet that teams believe in, every robot's wheels do what the limits of motion ask."""
    for robot in robots.builtin():
        loaded = scenario.load(name, (), {"robot": robot}).settings
        wheels = references.reference_limits(loaded).wheels
        poses = references.timed(loaded.replace(reference={"friction": 0.0})).poses
        assert wheels is not None
        assert max(wheels.shares(poses, PERIOD_S)) <= 1


@pytest.mark.parametrize("robot", robots.builtin())
def test_the_smooth_league_leaves_a_quarter_of_what_may_be_commanded(robot: str) -> None:
    """Wheels that creep are told u = (1 + T d) v + (tau + T v) a, whose rate is highest where braking begins.

    With T and drag d of the law of creep; docs/reference.md derives it.
    """
    settings = scenario.load("league-smooth", (), {"robot": robot}).settings
    task, told, law = settings.reference, settings.control, expected(settings)
    slope, dragged = (law.time / law.gain**2)[:2], law.drag[:2] / settings.body.mass_kg
    a, v = np.array([task.max_acceleration_m_s2, task.max_side_acceleration_m_s2]), task.max_speed_m_s
    assert (v * (1 + slope * (a + dragged)) + told.lag_s * a <= 0.75 * told.max_speed_m_s).all()
    braking = a * (1 + slope * (dragged - a)) + task.max_jerk_m_s3 * (told.lag_s + slope * v)
    assert (braking <= 0.76 * told.max_acceleration_m_s2).all()


def shares_asked(settings: Settings, friction: float) -> list[float]:
    """Of what wheels can push ahead and aside, what they must: to speed up, and what pile and bearings drag.

    Each wheel by its share of the weight.
    """
    azimuths = np.radians(settings.wheels.azimuths_deg)
    limits = traction_limits(kinematics(settings.wheels), friction, settings.body.centre_height_m)
    shares = np.linalg.pinv([np.ones(4), np.cos(azimuths), np.sin(azimuths)]) @ [1.0, 0.0, 0.0]
    asked = settings.reference.max_acceleration_m_s2, settings.reference.max_side_acceleration_m_s2
    axles = np.abs([np.cos(azimuths), np.sin(azimuths)])
    drags = 9.81 * (settings.carpet.pile + settings.drive.roller_friction * axles @ shares)
    return [(wanted + drag) / limit for limit, wanted, drag in zip(limits, asked, drags, strict=True)]


def test_slippery_asks_for_nine_tenths_of_what_its_carpet_gives() -> None:
    settings = scenario.scenario("slippery").settings
    assert shares_asked(settings, settings.carpet.friction) == pytest.approx([0.9, 0.9], abs=0.01)


# --- what happens in them ---


def test_a_carpet_that_becomes_slippery_can_be_driven_all_the_same() -> None:
    """About half of what wheels can push before, most of it after."""
    settings = scenario.scenario("fault-friction").settings
    (fault,) = settings.fault
    assert isinstance(fault, Friction)
    assert shares_asked(settings, settings.carpet.friction) == pytest.approx([0.50, 0.55], abs=0.01)
    assert shares_asked(settings, fault.to) == pytest.approx([0.78, 0.88], abs=0.01)


@pytest.mark.parametrize("name", [name for name in builtin() if name.startswith("fault-")])
def test_faults_happen_while_the_robot_drives_one_after_the_other(name: str) -> None:
    """Of one alone that ends, what comes after is seen before the first corner; of several, before the next begins."""
    loaded, poses = built_in(name)
    corner = int(np.flatnonzero(poses[:, 1] > poses[0, 1])[0])
    spans = [span(fault) for fault in loaded.settings.fault]
    assert spans == sorted(spans)
    nexts = [*(start for start, _ in spans[1:]), corner if len(spans) == 1 else len(poses)]
    for (start, end), following in zip(spans, nexts, strict=True):
        assert (poses[start] != poses[start - 1]).any()
        assert math.isinf(end) or following == start or end + recovery.AFTER_S / PERIOD_S <= following

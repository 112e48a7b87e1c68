"""What a user must know of is said: windings too hot, a battery that gave up."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from recorded import Recorded

from omni_control.limits import CommandLimits
from omni_mj.measure import events
from omni_mj.scenarios import scenario
from omni_mj.simulate.log import Trajectory
from omni_mj.simulate.simulation import Simulation

SHORT = ["reference.waypoints=[[0, 0], [0.5, 0]]", "reference.settle_s=0"]


def simulate(*overrides: str) -> tuple[Simulation, list[events.Event]]:
    simulation = Simulation(scenario.load("rect", [*SHORT, *overrides]))
    simulation.run()
    return simulation, events.find(simulation.trajectory, simulation.scenario.settings)


def test_an_ordinary_run_has_no_events() -> None:
    assert simulate()[1] == []


def test_the_first_frame_above_the_limit_is_named() -> None:
    # 25.02 deg C: the windings pass it after a few frames of driving.
    simulation, found = simulate("motor.limit_c=25.02")
    assert {e.controller for e in found} == {"flc", "comp-flc"}
    for event in found:
        i = simulation.scenario.controllers.index(event.controller)
        hot = simulation.trajectory.channel("winding")[:, i, 0].max(-1) > 25.02
        assert event.frame == np.flatnonzero(hot)[0] > 0
        assert event.time_s == pytest.approx(event.frame / 60)
        assert "25.02 deg C" in event.text


def test_an_empty_battery_stops_the_robot_and_says_so() -> None:
    simulation, found = simulate("battery.charge=0.05")
    assert all("gives no more power" in e.text for e in found)
    assert len(found) == 2
    end = simulation.trajectory.channel("wheel_speed")[-1]
    assert np.abs(end).max() < 0.1


def test_a_run_reports_events_everywhere(tmp_path: Path) -> None:
    settings = [argument for s in [*SHORT, "motor.winding_c=126"] for argument in ("--set", s)]
    command = [sys.executable, "-m", "omni_mj.run", "--scenario", "rect", *settings, "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert "note: 0.00 s, flc, seed 0: a winding is above 125 deg C" in done.stdout
    assert done.stdout.count("note: ") == 2  # of which way-points and lost frames are none
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [e["controller"] for e in summary["events"]] == ["flc", "comp-flc"]
    windings = pq.read_table(tmp_path / "trajectory.parquet", columns=["winding_1_c", "winding_4_c"])
    assert summary["results"]["flc"]["peak_winding_c"] >= windings["winding_1_c"].to_numpy().max() * 0.99 > 120
    recorded = Recorded(tmp_path / "recording.rrd")
    for controller in ("flc", "comp-flc"):
        texts = [row[0] for row in recorded.column(f"/events/{controller}", "TextLog:text")]
        assert texts[0] == f"0.00 s  {controller}: a winding is above 125 deg C"
        assert texts[-1].endswith(f"{controller}: way-point 1 of 1 reached")


def track(frames: int) -> Trajectory:
    """A robot at rest at the first way-point, seen, told nothing."""
    trajectory = Trajectory(("flc",), [0], frames)
    rest = {"pose": (0, 0, 0), "ref": (0, 0, 0), "command": (0, 0, 0), "vision_valid": True, "duty_peak": 0.5}
    for frame in range(frames):
        trajectory.write(frame, battery=22.0, winding=[25.0] * 4, **rest)
    return trajectory


def told(trajectory: Trajectory, kind: str, *overrides: str) -> list[tuple[int, str]]:
    settings = scenario.load("rect", [*SHORT, *overrides]).settings
    return [(e.frame, e.text) for e in events.find_all(trajectory, settings) if e.kind == kind]


def test_a_robot_at_rest_has_no_events() -> None:
    assert events.find_all(track(100), scenario.load("rect", SHORT).settings) == []


@pytest.mark.parametrize(
    ("axis", "limit", "unit"), [(0, 2.0, "m/s"), (1, 2.0, "m/s"), (2, 3.0, "rad/s")], ids=["x", "y", "turn"]
)
def test_a_command_at_its_limit_is_told_once_until_it_has_been_away(axis: int, limit: float, unit: str) -> None:
    """At the limit in frames 10, 12 to 20, and 40: told in 10 and 40, a quarter of a second after 20."""
    trajectory, command = track(60), np.zeros((60, 3))
    command[[10, *range(12, 21), 40], axis] = -limit
    for frame in range(60):
        trajectory.write(frame, command=command[frame])
    free = ["control.max_acceleration_m_s2=1000", "control.max_turn_acceleration_rad_s2=10000"]
    limits = ["control.max_speed_m_s=2", "control.max_turn_rate_rad_s=3"]
    text = f"the command is held back to {limit:g} {unit}"
    assert told(trajectory, events.LIMIT, *free, *limits) == [(10, text), (40, text)]


def test_a_command_that_changes_as_fast_as_it_may_is_told() -> None:
    """From rest to 3 m/s in frame 5, of which the limits let 4.7 m/s^2 through."""
    trajectory, limits = track(40), CommandLimits(scenario.load("rect").settings.control, 1)
    for frame in range(40):
        trajectory.write(frame, command=limits(np.array([[3.0 * (frame >= 5), 0, 0]])))
    assert told(trajectory, events.LIMIT) == [(5, "the command is held back to 4.7 m/s^2")]


def test_frames_that_vision_misses_are_told() -> None:
    trajectory = track(30)
    for frame in (0, 7, 20, 21, 22, 29):
        trajectory.write(frame, vision_valid=False)
    trajectory.write(29, vision_valid=False)
    lost = "vision does not see the robot"
    again = (23, "vision sees the robot again after 3 frames")
    assert told(trajectory, events.VISION) == [(0, lost), (7, lost), (20, lost), again, (29, lost)]


def test_a_motor_that_takes_all_of_the_battery_is_told() -> None:
    trajectory = track(40)
    for frame in (8, 9):
        trajectory.write(frame, duty_peak=1.0)
    trajectory.write(39, duty_peak=1.0, battery=0.0)  # that battery gave up
    text = "a motor takes all the battery's voltage"
    assert told(trajectory, events.VOLTAGE) == [(8, text)]


@pytest.mark.parametrize("mode", ["timed", "iterated"])
def test_way_points_are_reached_within_2_cm_and_a_tenth_of_a_radian(mode: str) -> None:
    """Recomputed from the poses: the first frame near each in turn, on two laps over the same way-points."""
    back = ["reference.waypoints=[[0, 0], [0.3, 0], [0, 0]]", "reference.laps=2"]
    simulation, _ = simulate(*back, f"reference.mode={mode}")
    found = events.find_all(simulation.trajectory, simulation.scenario.settings)
    for i, controller in enumerate(simulation.trajectory.controllers):
        own = [(e.frame, e.text) for e in found if (e.kind, e.controller) == (events.WAY_POINT, controller)]
        x, y, heading = simulation.trajectory.channel("pose")[:, i, 0].T
        expected, frame = [], 0
        for k, goal in enumerate((0.3, 0.0, 0.3, 0.0), 1):
            near = np.flatnonzero((np.hypot(x - goal, y) < 0.02) & (np.abs(heading) < 0.1))
            if (near >= frame).any():
                frame = int(near[near >= frame][0])
                expected.append((frame, f"way-point {k} of 4 reached"))
        assert own == expected
        assert len(own) >= 3  # one that keeps no timetable is late


def test_events_do_not_depend_on_what_comes_after_them() -> None:
    """Those of a run's first frames are those of the whole run in these frames."""
    simulation, _ = simulate("reference.waypoints=[[0, 0], [0.4, 0], [0.4, 0.2]]", "motor.limit_c=25.02")
    trajectory, settings = simulation.trajectory, simulation.scenario.settings
    everything = events.find_all(trajectory, settings)
    assert {e.kind for e in everything} >= {events.TEMPERATURE, events.VISION, events.WAY_POINT}
    for frames in range(1, trajectory.length, 7):
        trajectory.length = frames
        assert events.find_all(trajectory, settings) == [e for e in everything if e.frame < frames]

"""What a user must know of is said: rows that were stopped, windings too hot, a battery that gave up, and the rest."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from benches.logs import events, failure, filled, rows

from omni_control.limits import CommandLimits
from omni_control.reference.curves import CURVES
from omni_control.reference.limits import MotionLimits
from omni_mj.scenarios import references
from omni_mj.scenarios.library import builtin
from omni_mj.scenarios.scenario import load
from omni_mj.scenarios.settings import Settings
from omni_mj.simulate.simulation import Simulation

SHORT = ("reference.waypoints=[[0, 0], [0.5, 0]]", "reference.settle_s=0")
AWAY = ("reference.waypoints=[[0, 0], [0.4, 0], [0.4, 0.2]]", "reference.settle_s=0")
REST = {"vision_valid": True, "duty_peak": 0.5, "current_limited": 0.0, "battery": 22.0, "winding": 25.0}


@cache
def simulated(*overrides: str) -> Simulation:
    simulation = Simulation(load("rect", [*SHORT, *overrides], {"plant": "planar"}))
    simulation.run()
    return simulation


def settings(*overrides: str) -> Settings:
    return load("rect", [*SHORT, *overrides]).settings


def everything(log: Any, failures: Any = ()) -> list[events.Event]:
    """Of the first row of each controller, in the order of time."""
    found = [event for name in log.controllers for event in events.of_row(log, log.first(name), failures)]
    return sorted(found, key=lambda event: event.frame)


def told(log: Any, *kinds: str) -> list[tuple[int, str]]:
    return [(event.frame, event.text) for event in everything(log) if event.kind in kinds]


def constant(value: float, frames: int, at: Any, other: float) -> np.ndarray:
    """A channel (frames, 1, 1) that is `value` but for `other` in the frames `at`."""
    channel = np.full((frames, 1, 1), value)
    channel[at] = other
    return channel


def test_a_robot_at_rest_has_no_events() -> None:
    assert everything(filled(rows(settings=settings()), 100, **REST)) == []


def test_the_first_frame_above_the_limit_and_an_empty_battery_are_told_of_every_row() -> None:
    """Each by its own settings; 25.02 deg C: the windings pass it after a few frames of driving."""
    warm, empty = simulated("motor.limit_c=25.02").log, simulated("battery.charge=0.05").log
    found = {(event.kind, event.controller): event for log in (warm, empty) for event in events.find(log)}
    assert set(found) == {(kind, name) for kind in ("temperature", "battery") for name in ("flc", "comp-flc")}
    for i, name in enumerate(("flc", "comp-flc")):
        event = found["temperature", name]
        hot = warm.channel("winding")[:, i].max(-1) > 25.02
        assert event.frame == np.flatnonzero(hot)[0] > 0
        assert event.time_s == pytest.approx(event.frame / 60)
        assert "25.02 deg C" in event.text
        assert found["battery", name].text == "the battery sank below 13.6 V and gives no more power"
    assert np.abs(empty.channel("wheel_speed")[-1]).max() < 0.1
    table = [*rows(("a",), (0, 1), settings("motor.limit_c=20")), *rows(("b",), (3,), settings())]
    cold = filled(table, 2, **REST)
    assert [(event.controller, event.seed) for event in events.find(cold)] == [("a", 0), ("a", 1)]


def test_a_row_that_was_stopped_is_told_after_its_last_frame_and_nothing_else_of_it() -> None:
    lengths = [30, 12]
    log = filled(rows(("a", "b"), settings=settings()), 30, lengths, **REST)
    stopped = events.Event(12, 0.2, "b", 0, "stopped", "stopped: toppled over")
    assert events.find(log, [failure(log, 1)]) == [stopped]
    assert everything(log, [failure(log, 1)]) == [stopped]


def test_a_command_at_its_limit_is_told_once_until_it_has_been_away() -> None:
    """At the limit in frames 10, 12 to 20, and 40: told in 10 and 40, a quarter of a second after 20."""
    free = ("control.max_acceleration_m_s2=1000", "control.max_turn_acceleration_rad_s2=10000")
    table = rows(settings=settings(*free, "control.max_speed_m_s=2", "control.max_turn_rate_rad_s=3"))
    for axis, limit, unit in ((0, 2.0, "m/s"), (1, 2.0, "m/s"), (2, 3.0, "rad/s")):
        command = np.zeros((60, 1, 3))
        command[[10, *range(12, 21), 40], :, axis] = -limit
        text = f"the command is held back to {limit:g} {unit}"
        assert told(filled(table, 60, command=command, **REST), events.LIMIT) == [(10, text), (40, text)]


def test_a_command_that_changes_as_fast_as_it_may_is_told() -> None:
    """From rest to 3 m/s in frame 5, of which the limits let 4.7 m/s^2 through."""
    limits, last = CommandLimits([MotionLimits(3.7, 4.7, 26.0, 50.8)], 1 / 60), np.zeros((1, 3))
    command = []
    for frame in range(40):
        last = limits(np.array([[3.0 * (frame >= 5), 0, 0]]), last)
        command.append(last)
    log = filled(rows(settings=settings()), 40, command=np.array(command), **REST)
    assert told(log, events.LIMIT) == [(5, "the command is held back to 4.7 m/s^2")]


def test_frames_that_vision_misses_and_motors_that_take_all_of_the_battery_are_told() -> None:
    valid = constant(True, 30, [0, 7, 20, 21, 22, 29], False)
    log = filled(rows(settings=settings()), 30, **{**REST, "vision_valid": valid.astype(bool)})
    lost = "vision does not see the robot"
    again = (23, "vision sees the robot again after 3 frames")
    assert told(log, events.VISION) == [(0, lost), (7, lost), (20, lost), again, (29, lost)]
    given_up = {"duty_peak": constant(0.5, 40, [8, 9, 39], 1.0), "battery": constant(22.0, 40, 39, 0.0)}
    log = filled(rows(settings=settings()), 40, **{**REST, **given_up})
    assert told(log, events.VOLTAGE) == [(8, "a motor takes all the battery's voltage")]


def test_drivers_that_limit_a_current_are_told_with_the_motor() -> None:
    """Motor 2 in frames 8, 9 and 39, motor 4 in 9: each once until it has been away; the first of each row to all."""
    limited = np.zeros((40, 1, 4))
    limited[[8, 9, 39], :, 1], limited[9, :, 3] = 1 / 16, 1.0
    table = rows(("a", "b"), settings=settings("firmware.current_limit_a=7.5"))
    log = filled(table, 40, **{**REST, "current_limited": limited})
    texts = [f"the driver limits the current of motor {motor} to 7.5 A" for motor in (2, 4)]
    expected = [(8, texts[0]), (9, texts[1]), (39, texts[0])]
    assert [(e.frame, e.text) for e in events.of_row(log, 1) if e.kind == events.CURRENT] == expected
    first = [(e.controller, e.frame, e.kind, e.text) for e in events.find(log)]
    assert first == [("a", 8, "current", texts[0]), ("b", 8, "current", texts[0])]


def test_way_points_are_reached_within_2_cm_and_a_tenth_of_a_radian() -> None:
    """Recomputed from the poses: the first frame near each in turn, on two laps over the same way-points."""
    back = ("reference.waypoints=[[0, 0], [0.3, 0], [0, 0]]", "reference.laps=2")
    for more in ("reference.mode=timed", "reference.mode=iterated", "reference.max_jerk_m_s3=20"):
        simulation = simulated(*back, more)
        found = everything(simulation.log)
        for i, controller in enumerate(simulation.log.controllers):
            own = [(e.frame, e.text) for e in found if (e.kind, e.controller) == (events.WAY_POINT, controller)]
            x, y, heading = simulation.log.channel("pose")[:, i].T
            expected, frame = [], 0
            for k, goal in enumerate((0.3, 0.0, 0.3, 0.0), 1):
                near = np.flatnonzero((np.hypot(x - goal, y) < 0.02) & (np.abs(heading) < 0.1))
                if (near >= frame).any():
                    frame = int(near[near >= frame][0])
                    expected.append((frame, f"way-point {k} of 4 reached"))
            assert own == expected
            assert len(own) >= 3  # one that keeps no timetable is late


@pytest.mark.parametrize("name", builtin())
def test_a_robot_that_is_where_it_should_be_reaches_every_way_point_of_every_scenario(name: str) -> None:
    """One after the other, whatever shape, limits and laps it has; curves have none."""
    settings = load(name).settings
    poses = references.timed(settings).poses
    log = filled(rows(settings=settings), len(poses), pose=poses[:, None], ref=poses[:, None])
    reached = [event.text for event in everything(log) if event.kind == events.WAY_POINT]
    last = max(len(references.waypoints(settings.reference)) - 1, 0)
    assert reached == [f"way-point {k} of {last} reached" for k in range(1, last + 1)]
    assert last or settings.reference.shape in CURVES


def test_a_watch_tells_each_event_once_while_the_log_grows() -> None:
    """Together those of the whole run: no event depends on what comes after its frame."""
    simulation = Simulation(load("rect", [*AWAY, "motor.limit_c=25.02"], {"plant": "planar"}))
    watches, heard = {}, []

    def after_frame(frame: int) -> None:
        if frame == 0:
            watches.update({i: events.Watch(simulation.log, i) for i in range(2)})
        if frame % 7 == 0 or frame == simulation.references[0].frames - 1:
            fresh = [event for watch in watches.values() for event in watch.new(simulation.failures)]
            assert all(event.frame <= frame for event in fresh)
            heard.extend(fresh)

    simulation.run(after_frame)
    whole = everything(simulation.log)
    assert {e.kind for e in whole} >= {events.TEMPERATURE, events.VISION, events.WAY_POINT}
    assert sorted(heard, key=lambda e: (e.frame, e.controller, e.text)) == sorted(
        whole, key=lambda e: (e.frame, e.controller, e.text)
    )


def test_faults_are_events_of_every_row_when_they_begin_and_end() -> None:
    push = {"kind": "push", "at": 1.0, "for": 0.5, "force_n": 10.0}
    own = settings().replace(fault=(push, {"kind": "tilt", "at": 3.0, "angle_deg": 2.0}))
    log = filled(rows(("a", "b"), settings=own), 200, [200, 85], winding=25.0, battery=22.0)
    found = events.find(log)
    assert {event.kind for event in found} == {"fault"}
    assert [(e.frame, e.controller, e.text.split(":")[0]) for e in found] == [
        (60, "a", "begins"), (60, "b", "begins"), (90, "a", "ends"), (180, "a", "begins"),
    ]  # fmt: skip

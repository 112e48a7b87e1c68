"""What a user must know of is said: rows that were stopped, windings too hot, a battery that gave up, and the rest."""

from typing import Any

import numpy as np
import pytest
from benches.logs import events, failure, filled, rows

import omni_mj as om

SHORT: dict[str, Any] = {"reference": {"waypoints": [[0, 0], [0.5, 0]], "settle_s": 0}}
REST = {"vision_valid": True, "duty_peak": 0.5, "current_limited": 0.0, "battery": 22.0, "winding": 25.0}


def simulated(reference: dict[str, Any], plant: str = "planar", **sections: Any) -> om.Simulation:
    route = {**SHORT["reference"], **reference}
    simulation = om.Simulation(om.scenario("rect", plant=plant, reference=route, **sections))
    simulation.run()
    return simulation


def settings(**sections: Any) -> Any:
    return om.scenario("rect", **SHORT, **sections).settings


def told(log: Any, *kinds: str, row: int = 0) -> list[tuple[int, str]]:
    return [(event.frame, event.text) for event in events.of_row(log, row) if event.kind in kinds]


def constant(value: float, frames: int, at: Any, other: float) -> np.ndarray:
    """A channel (frames, 1, 1) that is `value` but for `other` in the frames `at`."""
    channel = np.full((frames, 1, 1), value)
    channel[at] = other
    return channel


def test_the_first_frame_above_the_limit_and_an_empty_battery_are_told_of_every_row() -> None:
    """Each by its own settings; 25.02 deg C: the windings pass it after a few frames of driving."""
    warm, empty = (simulated({}, **own).log for own in ({"motor": {"limit_c": 25.02}}, {"battery": {"charge": 0.05}}))
    found = {(event.kind, event.controller): event for log in (warm, empty) for event in events.find(log)}
    assert set(found) == {(kind, name) for kind in ("temperature", "battery") for name in ("flc", "comp-flc")}
    for i, name in enumerate(("flc", "comp-flc")):
        event = found["temperature", name]
        assert event.frame == np.flatnonzero(warm.channel("winding")[:, i].max(-1) > 25.02)[0] > 0
        assert event.time_s == pytest.approx(event.frame / 60)
        assert "13.6 V" in found["battery", name].text


def test_what_goes_on_is_told_once_until_it_has_been_away() -> None:
    """A command at the limit in frames 10, 12 to 20, and 40: told in 10 and 40, a quarter of a second after 20. Motor 2
    is limited in frames 8, 9 and 39, motor 4 in 9; of each row the first is told to all."""
    control = {"max_speed_m_s": 2, "max_turn_rate_rad_s": 3, "max_acceleration_m_s2": 1000}
    control["max_turn_acceleration_rad_s2"] = 10000
    own = settings(control=control, firmware={"current_limit_a": 7.5})
    for axis, limit, unit in ((0, 2.0, "m/s"), (2, 3.0, "rad/s")):
        command = np.zeros((60, 1, 3))
        command[[10, *range(12, 21), 40], :, axis] = -limit
        text = f"the command is held back to {limit:g} {unit}"
        assert told(filled(rows(settings=own), 60, command=command, **REST), "limit") == [(10, text), (40, text)]
    limited = np.zeros((40, 1, 4))
    limited[[8, 9, 39], :, 1], limited[9, :, 3] = 1 / 16, 1.0
    log = filled(rows(("a", "b"), settings=own), 40, **{**REST, "current_limited": limited})
    texts = [f"the driver limits the current of motor {motor} to 7.5 A" for motor in (2, 4)]
    assert told(log, "current", row=1) == [(8, texts[0]), (9, texts[1]), (39, texts[0])]
    assert [(e.controller, e.frame, e.text) for e in events.find(log)] == [("a", 8, texts[0]), ("b", 8, texts[0])]


def test_frames_that_vision_misses_and_motors_that_take_all_of_the_battery_are_told() -> None:
    valid = constant(True, 30, [0, 7, 20, 21, 22, 29], False)
    log = filled(rows(settings=settings()), 30, **{**REST, "vision_valid": valid.astype(bool)})
    lost = "vision does not see the robot"
    again = (23, "vision sees the robot again after 3 frames")
    assert told(log, "vision") == [(0, lost), (7, lost), (20, lost), again, (29, lost)]
    given_up = {"duty_peak": constant(0.5, 40, [8, 9, 39], 1.0), "battery": constant(22.0, 40, 39, 0.0)}
    log = filled(rows(settings=settings()), 40, **{**REST, **given_up})
    assert [frame for frame, _ in told(log, "voltage")] == [8]


@pytest.mark.parametrize("reference", [{}, {"mode": "iterated"}, {"max_jerk_m_s3": 20}])
def test_way_points_are_reached_within_2_cm_and_a_tenth_of_a_radian(reference: dict[str, Any]) -> None:
    """Recomputed from the poses: the first frame near each in turn, on two laps over the same way-points."""
    simulation = simulated({"waypoints": [[0, 0], [0.3, 0], [0, 0]], "laps": 2, **reference}, "kinematic")
    for i in range(2):
        x, y, heading = simulation.log.channel("pose")[:, i].T
        expected, frame = [], 0
        for k, goal in enumerate((0.3, 0.0, 0.3, 0.0), 1):
            near = np.flatnonzero((np.hypot(x - goal, y) < 0.02) & (np.abs(heading) < 0.1))
            if (near >= frame).any():
                frame = int(near[near >= frame][0])
                expected.append((frame, f"way-point {k} of 4 reached"))
        assert told(simulation.log, "way-point", row=i) == expected
        assert len(expected) >= 3  # one that keeps no timetable is late


@pytest.mark.parametrize("block", [1, 7, 30])
def test_events_stay_the_same_while_the_log_grows(block: int) -> None:
    """No event depends on later frames."""
    route = {"waypoints": [[0, 0], [0.4, 0], [0.4, 0.2]], "settle_s": 0}
    out = {"kind": "vision-out", "at": 0.4, "for": 0.3}
    chosen = om.scenario("rect", plant="planar", reference=route, motor={"limit_c": 25.02}, fault=[out])
    simulation = om.Simulation(chosen, ["flc"])
    reported: list[Any] = []

    def after_frame(frame: int) -> None:
        if frame % block == 0 or frame == simulation.references[0].frames - 1:
            found = events.of_row(simulation.log, 0)
            assert found[: len(reported)] == reported
            assert all(event.frame <= frame for event in found)
            reported[:] = found

    simulation.run(after_frame)
    whole = events.of_row(simulation.log, 0)
    assert {e.kind for e in whole} >= {"temperature", "vision", "way-point", "fault"}
    assert reported == whole


def test_faults_and_rows_that_were_stopped_are_events_of_every_row() -> None:
    push = {"kind": "push", "at": 1.0, "for": 0.5, "force_n": 10.0}
    own = settings().replace(fault=(push, {"kind": "tilt", "at": 3.0, "angle_deg": 2.0}))
    log = filled(rows(("a", "b"), settings=own), 200, [200, 85], winding=25.0, battery=22.0)
    found = [(e.frame, e.controller, e.text.split(":")[0]) for e in events.find(log, [failure(log, 1)])]
    assert found == [
        (60, "a", "begins"), (60, "b", "begins"), (85, "b", "stopped"), (90, "a", "ends"), (180, "a", "begins"),
    ]  # fmt: skip

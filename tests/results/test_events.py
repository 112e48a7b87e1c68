"""Events of a run: stopped rows, overheated windings, an empty battery, faults."""

from typing import Any

import numpy as np
import pytest
from benches.logs import events, failure, fill_log, rows

import omni_mj as om

SHORT: dict[str, Any] = {"reference": {"waypoints": [[0, 0], [0.5, 0]], "settle_s": 0}}
REST = {
    "vision_valid": True,
    "duty_peak": 0.5,
    "current_limited": 0.0,
    "battery": 22.0,
    "winding": 25.0,
}


def simulated(reference: dict[str, Any], plant: str = "planar", **sections: Any) -> om.Simulation:
    route = {**SHORT["reference"], **reference}
    simulation = om.Simulation(om.load_scenario("rect", plant=plant, reference=route, **sections))
    simulation.run()
    return simulation


def settings(**sections: Any) -> Any:
    return om.load_scenario("rect", **SHORT, **sections).settings


def texts_of_kinds(log: Any, *kinds: str, row: int = 0) -> list[tuple[int, str]]:
    return [
        (event.frame, event.text)
        for event in events.row_events(log, row, ())
        if event.kind in kinds
    ]


def test_each_row_reports_an_overheated_winding_and_an_empty_battery() -> None:
    """The windings exceed 25.02 deg C after a few frames of driving."""
    warm, empty = (
        simulated({}, **fault_settings).log
        for fault_settings in ({"motor": {"max_winding_c": 25.02}}, {"battery": {"charge": 0.05}})
    )
    events_found = {
        (event.kind, event.controller): event
        for log in (warm, empty)
        for event in events.find_events(log, ())
    }
    assert set(events_found) == {
        (kind, name) for kind in ("temperature", "battery") for name in ("flc", "comp-flc")
    }
    for i, name in enumerate(("flc", "comp-flc")):
        event = events_found["temperature", name]
        assert event.frame == np.flatnonzero(warm.channel("winding")[:, i].max(-1) > 25.02)[0] > 0
        assert event.time_s == pytest.approx(event.frame / 60)
        assert "13.6 V" in events_found["battery", name].text


def test_events_stay_the_same_while_the_log_grows() -> None:
    """Events depend on no later frame: further frames only add events."""
    route = {"waypoints": [[0, 0], [0.4, 0], [0.4, 0.2]], "settle_s": 0}
    out = {"kind": "vision-loss", "start_s": 0.4, "duration_s": 0.3}
    chosen = om.load_scenario(
        "rect", plant="planar", reference=route, motor={"max_winding_c": 25.02}, fault=[out]
    )
    simulation = om.Simulation(chosen, ["flc"])
    reported: list[Any] = []

    def after_frame(frame: int) -> None:
        events_found = events.row_events(simulation.log, 0, ())
        assert events_found[: len(reported)] == reported
        assert all(event.frame <= frame for event in events_found)
        reported[:] = events_found

    simulation.run(after_frame)
    all_events = events.row_events(simulation.log, 0, ())
    assert {e.kind for e in all_events} >= {"temperature", "fault"}
    assert reported == all_events


def test_each_row_reports_its_faults_and_its_failure() -> None:
    push_fault = {"kind": "push", "start_s": 1.0, "duration_s": 0.5, "force_n": 10.0}
    fault_settings = settings().replace(
        fault=(push_fault, {"kind": "tilt", "start_s": 3.0, "angle_deg": 2.0})
    )
    log = fill_log(
        rows(("a", "b"), settings=fault_settings), 200, [200, 85], winding=25.0, battery=22.0
    )
    events_found = [
        (e.frame, e.controller, e.text.split(":")[0])
        for e in events.find_events(log, [failure(log, 1)])
    ]
    assert events_found == [
        (60, "a", "begins"), (60, "b", "begins"), (85, "b", "stopped"), (90, "a", "ends"),
        (180, "a", "begins"),
    ]  # fmt: skip

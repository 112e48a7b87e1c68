"""What a user must know of is said: windings too hot, a battery that gave up."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from rerun.chunk import RrdReader

from omni_mj import events, scenario
from omni_mj.loop import Simulation

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
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [e["controller"] for e in summary["events"]] == ["flc", "comp-flc"]
    windings = pq.read_table(tmp_path / "trajectory.parquet", columns=["winding_1_c", "winding_4_c"])
    assert summary["results"]["flc"]["peak_winding_c"] >= windings["winding_1_c"].to_numpy().max() * 0.99 > 120
    logged = [c for c in RrdReader(tmp_path / "recording.rrd").stream().to_chunks() if c.entity_path == "/events"]
    texts = [t for c in logged for t in c.to_record_batch()["TextLog:text"].to_pylist()]
    assert len(texts) == 2

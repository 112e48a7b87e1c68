"""A recording is whole up to where a run, a robot or a block of it ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from recorded import Driven, Recorded, driven_by, poses, rows, rrd

from omni_control.controllers.base import Controller, Seen
from omni_mj.measure.metrics import ALPHA_START_FRAMES, ALPHA_WINDOW_FRAMES
from omni_mj.scenarios import scenario
from omni_mj.show.recording import FileRecording
from omni_mj.simulate.simulation import Simulation

SHORT = "reference.waypoints=[[0, 0], [0.3, 0.2]]"


class Own(Controller):
    """Records what it does to the error, from frame 50 on how often it was asked; and says that it believes in 0.9."""

    def command(self, frame: int, seen: Seen) -> NDArray:
        self.alpha_hat, self.channels["alpha_sigma"] = (
            np.full((len(seen.pose), 3), 0.9),
            np.full((len(seen.pose), 3), 0.05),
        )
        target, speed = self.reference.at(frame, seen.pose)
        pull = 3.0 * (target - seen.pose)
        self.channels["pull"] = pull[:, :2]
        if frame >= 50:
            self.channels["asked"] = np.full(len(pull), float(frame))
        return speed + pull


class Breaks(Own):
    """Fails in frame 70."""

    def command(self, frame: int, seen: Seen) -> NDArray:
        return super().command(frame, seen) if frame < 70 else np.full((len(seen.pose), 3), np.nan)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """Controllers with channels of their own, of which one fails."""
    return driven_by(tmp_path_factory.mktemp("own") / "recording.rrd", ["flc", Own, Breaks], SHORT)


def test_channels_of_a_controllers_own_are_recorded_from_when_it_has_them(own: Driven) -> None:
    found = {entity for entity in own.recorded.entities() if entity.startswith("/plots/own/")}
    assert found == {
        f"/plots/own/{channel}/{name}" for channel in ("pull", "asked", "alpha_sigma") for name in ("Own", "Breaks")
    }
    table = rows(own.table, "Own")
    pull = np.column_stack([table["own_pull_1"], table["own_pull_2"]])
    np.testing.assert_array_equal(own.recorded.values("/plots/own/pull/Own"), pull)
    asked = own.recorded.values("/plots/own/asked/Own")[:, 0]
    np.testing.assert_array_equal(asked[-3:], table["own_asked"][-3:])
    assert np.isnan(asked[:50]).all()
    np.testing.assert_allclose(
        own.recorded.values("/plots/alpha/x/Own/sigma"), np.broadcast_to([0.8, 1.0], (len(asked), 2))
    )
    assert own.recorded.static("/plots/own/pull/Own", "SeriesLines:names") == ["Own 1 (60 Hz)", "Own 2 (60 Hz)"]
    layouts = own.recorded.layouts()
    assert all({"own", "pull"} <= names for names in layouts)
    assert ["asked" in names for names in layouts].count(True) == 1


def test_a_robot_that_failed_is_recorded_up_to_there_and_says_why(own: Driven) -> None:
    assert sorted(own.recorded.frames("/world/Breaks/robot")) == list(range(70))
    assert len(own.recorded.frames("/world/Own/robot")) > 100
    said = [row[0] for row in own.recorded.column("/events/Breaks", "TextLog:text")]
    assert next(text for text in said if "stopped" in text).startswith("1.17 s  Breaks: stopped: ")
    assert len(said) == len(set(said))


@pytest.mark.parametrize("before", [0, 40, 400])
def test_a_simulation_that_is_reset_is_recorded_from_its_start(tmp_path: Path, before: int) -> None:
    """However much of what was before has been sent: nothing, or a block, what is read back is the last run alone."""
    simulation = Simulation(scenario.load("rect", ["reference.laps=2"], {"plant": "kinematic"}), ["flc"])
    with FileRecording(tmp_path / "reset.rrd", simulation) as recording:
        for _ in range(before):
            simulation.step()
            recording.update()
        simulation.reset(seed=5)
        for _ in range(350):
            simulation.step()
            recording.update()
        recording.write()
    recorded = Recorded(tmp_path / "reset.rrd")
    assert sorted(recorded.frames("/world/flc/robot")) == list(range(350))
    table = rows(simulation.log.table(), "flc", 5)
    np.testing.assert_allclose(poses(recorded, "/world/flc/robot")[:, 0], table["x_m"], atol=1e-6)
    assert "seed 5" in recorded.static("/settings", "TextDocument:text")[0]


def test_a_block_is_made_of_its_own_frames(tmp_path: Path) -> None:
    """So that it costs the same however long the run: the same is recorded where all frames before were wiped out.

    But for the last, from which the path goes on, and those of the window of alpha's ratio.
    """
    chosen = scenario.load("rect-noise", ["reference.laps=2", "reference.settle_s=0.1"], {"plant": "kinematic"})

    def record_run(path: Path, wiped: bool) -> int:
        simulation = Simulation(chosen, ["comp-flc"])
        log = simulation.log
        with FileRecording(path, simulation) as recording:

            def after_frame(frame: int) -> None:
                recording.update()
                if wiped and recording._sent == log.length:
                    for channel in log.columns:
                        log.channel(channel)[: log.length - 1 - ALPHA_WINDOW_FRAMES - ALPHA_START_FRAMES] = 0

            simulation.run(after_frame)
            recording.write()
        return log.length

    lengths = [record_run(tmp_path / f"{wiped}.rrd", wiped) for wiped in (False, True)]
    assert min(lengths) > 4 * 300, "blocks of 300 frames"
    assert rrd("compare", tmp_path / "False.rrd", tmp_path / "True.rrd").returncode == 0


def test_a_killed_run_leaves_its_blocks(tmp_path: Path) -> None:
    """Killed while it writes, of every entity the same whole blocks of 300 frames are there, but for the last one."""
    options = ["--scenario", "rect", "--plant", "kinematic", "--set", "reference.laps=100", "--out", tmp_path]
    process = subprocess.Popen([sys.executable, "-m", "omni_mj.run", "--no-figures", "--quiet", *options])
    path, deadline = tmp_path / "recording.rrd", time.monotonic() + 60
    while not (path.exists() and path.stat().st_size > 2e6) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    with pytest.warns(match="no footer"):
        recorded = Recorded(path)
    series = [e for e in recorded.entities() if "/plots/" in e or e.endswith("/robot")]
    lengths = {entity: len(recorded.frames(entity)) for entity in series}
    assert len(series) == 2 * 15 + 2
    assert min(lengths.values()) >= 600
    assert max(lengths.values()) - min(lengths.values()) <= 300
    for entity in series:
        assert sorted(recorded.frames(entity)) == list(range(lengths[entity]))
    assert "| laps | **100** |" in recorded.static("/settings", "TextDocument:text")[0]
    assert "has not ended" in recorded.static("/summary", "TextDocument:text")[0]


@pytest.mark.skipif(sys.platform != "linux", reason="pipes have the size that they have")
def test_a_file_that_takes_nothing_more_costs_the_recording_and_holds_up_nobody(tmp_path: Path) -> None:
    """A pipe of 1 MiB that nobody reads: rerun waits for what it writes there as for a writer that has died."""
    program = f"""
import fcntl, os
from pathlib import Path
from omni_mj.scenarios.scenario import load
from omni_mj.show.recording import FileRecording, patience
from omni_mj.simulate.simulation import Simulation
patience.FLUSH_S = 1.0
path = Path({str(tmp_path / "pipe")!r})
os.mkfifo(path)
held = os.open(path, os.O_RDWR)
fcntl.fcntl(held, fcntl.F_SETPIPE_SZ, 2**20)
simulation = Simulation(load("rect", [], {{"plant": "kinematic"}}))
try:
    with FileRecording(path, simulation) as recording:
        simulation.run(lambda frame: recording.update())
except OSError as error:
    print(error.strerror)
print(simulation.done)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    said, ended = done.stdout.splitlines()
    assert "could not be written to its end" in said
    assert (ended, done.returncode) == ("True", 0)

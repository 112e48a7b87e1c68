"""A recording is complete up to the end of a run, a robot or a block, for any reason of the end."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from benches.recording import RecordedRun, RecordingFile, record_run, rows
from commands import run_python, split_words
from numpy.typing import NDArray

from omni_control.controllers.base import Controller, Observation

SHORT = "reference.waypoints=[[0, 0], [0.3, 0.2]]"


class Own(Controller):
    """Proportional controller with own channels, one of them from frame 50 on, and alpha 0.9."""

    def command(self, frame: int, observation: Observation) -> NDArray:
        shape = (len(observation.pose), 3)
        self.alpha_hat, self.channels["alpha_sigma"] = np.full(shape, 0.9), np.full(shape, 0.05)
        target, speed = self.reference.at(frame, observation.pose)
        pull = 3.0 * (target - observation.pose)
        self.channels["pull"] = pull[:, :2]
        if frame >= 50:
            self.channels["frame_number"] = np.full(len(pull), float(frame))
        return speed + pull


class Breaks(Own):
    """Own, but its command is NaN from frame 70 on."""

    def command(self, frame: int, observation: Observation) -> NDArray:
        return (
            super().command(frame, observation)
            if frame < 70
            else np.full((len(observation.pose), 3), np.nan)
        )


@pytest.fixture(scope="module")
def recorded_run(tmp_path_factory: pytest.TempPathFactory) -> RecordedRun:
    """A run of controllers that record own channels; one controller fails."""
    return record_run(tmp_path_factory.mktemp("own") / "recording.rrd", ["flc", Own, Breaks], SHORT)


def test_channels_of_controllers_are_recorded(recorded_run: RecordedRun) -> None:
    recorded, table = recorded_run.recorded, rows(recorded_run.table, "Own")
    channels = {entity for entity in recorded.entities() if entity.startswith("/plots/channels/")}
    expected = {
        f"/plots/channels/{c}/{name}"
        for c in ("pull", "frame_number", "alpha_sigma")
        for name in ("Own", "Breaks")
    }
    assert channels == expected
    pull = np.column_stack([table["channel_pull_1"], table["channel_pull_2"]])
    np.testing.assert_array_equal(recorded.values("/plots/channels/pull/Own"), pull)
    np.testing.assert_array_equal(
        recorded.values("/plots/channels/frame_number/Own")[:, 0], table["channel_frame_number"]
    )
    band = recorded.values("/plots/alpha/x/Own")[:, 1:]
    np.testing.assert_allclose(band, np.broadcast_to([0.8, 1.0, 0.9], (len(pull), 3)))
    assert all({"channels", "pull", "frame_number"} <= names for names in recorded.layouts())


def test_a_failed_robot_is_recorded_up_to_its_failure_with_the_cause(
    recorded_run: RecordedRun,
) -> None:
    assert sorted(recorded_run.recorded.frames("/world/Breaks/robot")) == list(range(70))
    assert len(recorded_run.recorded.frames("/world/Own/robot")) > 100
    texts = [row[0] for row in recorded_run.recorded.column("/events/Breaks", "TextLog:text")]
    assert next(text for text in texts if "stopped" in text).startswith("1.17 s  Breaks: stopped: ")
    assert len(texts) == len(set(texts))


def test_a_killed_run_leaves_complete_blocks(tmp_path: Path) -> None:
    """Of a killed run, all entities have complete blocks of 300 frames, and as many but one."""
    options = "--scenario rect --plant kinematic --set reference.laps=100 --no-figures --quiet"
    command = split_words(sys.executable, "-m omni_mj.run", options, "--out", tmp_path)
    process = subprocess.Popen(command)
    path, deadline = tmp_path / "recording.rrd", time.monotonic() + 60
    while not (path.exists() and path.stat().st_size > 2e6) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    with pytest.warns(match="no footer"):
        recorded = RecordingFile(path)
    series = [e for e in recorded.entities() if "/plots/" in e or e.endswith("/robot")]
    assert len(series) > 20
    ends = []
    for entity in series:
        first, *_, last = frames = sorted(recorded.frames(entity))
        assert frames == list(range(first, last + 1))
        ends.append(last + 1)
    assert min(ends) >= 600
    assert max(ends) - min(ends) <= 300


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux can set the size of a pipe")
def test_a_blocked_file_ends_the_recording_but_not_the_run(
    tmp_path: Path,
) -> None:
    """The file is a pipe of 1 MiB without a reader, at which rerun's writer stops."""
    program = f"""
import fcntl, os
from pathlib import Path
from typing import Any
from benches.recording import create_simulation, run_and_record, set_flush_timeout
set_flush_timeout(1.0)
path = Path({str(tmp_path / "pipe")!r})
os.mkfifo(path)
held = os.open(path, os.O_RDWR)
fcntl.fcntl(held, fcntl.F_SETPIPE_SZ, 2**20)
simulation = create_simulation(["flc", "comp-flc"])
try:
    run_and_record(simulation, path)
except OSError as error:
    print(error.strerror)
print(simulation.done)
"""
    support = {"PYTHONPATH": str(Path(__file__).parents[1] / "support")}
    done = run_python(code=program, env=os.environ | support)
    assert not done.stderr
    message, ended = done.stdout.splitlines()
    assert "could not be written to its end" in message
    assert (ended, done.returncode) == ("True", 0)

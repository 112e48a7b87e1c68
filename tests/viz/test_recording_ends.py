"""A recording is whole up to where a run, a robot or a block of it ends, whatever ends it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from benches.recording import Driven, Recorded, driven_by, rows
from numpy.typing import NDArray

from omni_control.controllers.base import Controller, Observation

SHORT = "reference.waypoints=[[0, 0], [0.3, 0.2]]"


class Own(Controller):
    """Records what it does to the error, from frame 50 on how often it was asked; and says that it believes in 0.9."""

    def command(self, frame: int, observation: Observation) -> NDArray:
        shape = (len(observation.pose), 3)
        self.alpha_hat, self.channels["alpha_sigma"] = np.full(shape, 0.9), np.full(shape, 0.05)
        target, speed = self.reference.at(frame, observation.pose)
        pull = 3.0 * (target - observation.pose)
        self.channels["pull"] = pull[:, :2]
        if frame >= 50:
            self.channels["asked"] = np.full(len(pull), float(frame))
        return speed + pull


class Breaks(Own):
    """Fails in frame 70."""

    def command(self, frame: int, observation: Observation) -> NDArray:
        return (
            super().command(frame, observation)
            if frame < 70
            else np.full((len(observation.pose), 3), np.nan)
        )


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """Controllers with channels of their own, of which one fails."""
    return driven_by(tmp_path_factory.mktemp("own") / "recording.rrd", ["flc", Own, Breaks], SHORT)


def test_channels_of_a_controllers_own_are_recorded(own: Driven) -> None:
    recorded, table = own.recorded, rows(own.table, "Own")
    channels = {entity for entity in recorded.entities() if entity.startswith("/plots/channels/")}
    expected = {
        f"/plots/channels/{c}/{name}"
        for c in ("pull", "asked", "alpha_sigma")
        for name in ("Own", "Breaks")
    }
    assert channels == expected
    pull = np.column_stack([table["channel_pull_1"], table["channel_pull_2"]])
    np.testing.assert_array_equal(recorded.values("/plots/channels/pull/Own"), pull)
    np.testing.assert_array_equal(
        recorded.values("/plots/channels/asked/Own")[:, 0], table["channel_asked"]
    )
    band = recorded.values("/plots/alpha/x/Own")[:, 1:]
    np.testing.assert_allclose(band, np.broadcast_to([0.8, 1.0, 0.9], (len(pull), 3)))
    assert all({"channels", "pull", "asked"} <= names for names in recorded.layouts())


def test_a_robot_that_failed_is_recorded_up_to_there_and_says_why(own: Driven) -> None:
    assert sorted(own.recorded.frames("/world/Breaks/robot")) == list(range(70))
    assert len(own.recorded.frames("/world/Own/robot")) > 100
    texts = [row[0] for row in own.recorded.column("/events/Breaks", "TextLog:text")]
    assert next(text for text in texts if "stopped" in text).startswith("1.17 s  Breaks: stopped: ")
    assert len(texts) == len(set(texts))


def test_a_killed_run_leaves_its_blocks(tmp_path: Path) -> None:
    """Killed while it writes, of every entity the same whole blocks of 300 frames are there, but for the last one."""
    options = [
        "--scenario",
        "rect",
        "--plant",
        "kinematic",
        "--set",
        "reference.laps=100",
        "--out",
        tmp_path,
    ]
    process = subprocess.Popen(
        [sys.executable, "-m", "omni_mj.run", "--no-figures", "--quiet", *options]
    )
    path, deadline = tmp_path / "recording.rrd", time.monotonic() + 60
    while not (path.exists() and path.stat().st_size > 2e6) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    with pytest.warns(match="no footer"):
        recorded = Recorded(path)
    series = [e for e in recorded.entities() if "/plots/" in e or e.endswith("/robot")]
    assert len(series) > 20
    ends = []
    for entity in series:
        first, *_, last = frames = sorted(recorded.frames(entity))
        assert frames == list(range(first, last + 1))
        ends.append(last + 1)
    assert min(ends) >= 600
    assert max(ends) - min(ends) <= 300


@pytest.mark.skipif(sys.platform != "linux", reason="pipes have the size that they have")
def test_a_file_that_takes_nothing_more_costs_the_recording_and_holds_up_nobody(
    tmp_path: Path,
) -> None:
    """A pipe of 1 MiB that nobody reads: rerun waits for what it writes there as for a writer that has died."""
    program = f"""
import fcntl, os
from pathlib import Path
from typing import Any
from benches.recording import record, set_flush_timeout, simulated
set_flush_timeout(1.0)
path = Path({str(tmp_path / "pipe")!r})
os.mkfifo(path)
held = os.open(path, os.O_RDWR)
fcntl.fcntl(held, fcntl.F_SETPIPE_SZ, 2**20)
simulation = simulated(["flc", "comp-flc"])
try:
    record(simulation, path)
except OSError as error:
    print(error.strerror)
print(simulation.done)
"""
    support = {"PYTHONPATH": str(Path(__file__).parents[1] / "support")}
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=False, env=os.environ | support
    )
    assert not done.stderr
    message, ended = done.stdout.splitlines()
    assert "could not be written to its end" in message
    assert (ended, done.returncode) == ("True", 0)

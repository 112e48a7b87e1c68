"""A run can be watched while it goes on; a viewer that is not there, or goes away, costs nothing but a line."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from recorded import RERUN, Recorded, rrd

from omni_control.errors import OmniError
from omni_mj.show.recording import live

SHORT = ["--set", "reference.waypoints=[[0, 0], [0.5, 0.2]]", "--plant", "kinematic"]


class Listener:
    """`rerun --save`: listens as a viewer does and needs no graphics."""

    def __init__(self, path: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.path, self.url = path, f"rerun+http://127.0.0.1:{port}/proxy"
        command = [RERUN, "--save", path, "--bind", "127.0.0.1", "--port", str(port)]
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                return
            except OSError:
                time.sleep(0.05)

    def end(self, number: int = signal.SIGTERM) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, number)
        self.process.wait()


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[Listener]:
    started = Listener(tmp_path / "heard.rrd")
    yield started
    started.end()


def run(*args: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "omni_mj.run", "--scenario", "rect", "--no-figures", "--quiet", *args]
    kept = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, env=kept | environment)


def test_a_viewer_is_sent_what_is_recorded(listener: Listener, tmp_path: Path) -> None:
    done = run(*SHORT, "--connect", listener.url, "--out", tmp_path / "run")
    assert (done.returncode, done.stderr) == (0, "")
    written = Recorded(tmp_path / "run" / "recording.rrd")
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and (
        not listener.path.exists() or listener.path.stat().st_size < written.path.stat().st_size
    ):
        time.sleep(0.1)
    time.sleep(0.5)
    listener.end(signal.SIGKILL)
    with pytest.warns(match="no footer"):
        heard = Recorded(listener.path)
    assert heard.entities() == written.entities()
    for entity in written.entities() - {"/events"}:
        assert sorted(heard.frames(entity)) == sorted(written.frames(entity)), entity


def test_a_viewer_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"rerun+http://127.0.0.1:{free.getsockname()[1]}/proxy"
        done = run(*SHORT, "--connect", url, "--out", tmp_path)
    assert done.returncode == 0
    assert done.stderr == f"warning: no viewer at {url}; the run goes on without it\n"
    assert rrd("verify", tmp_path / "recording.rrd").returncode == 0


def test_a_viewer_that_goes_away_is_one_line(listener: Listener, tmp_path: Path) -> None:
    options = [
        "--set",
        "reference.laps=8",
        "--plant",
        "kinematic",
        "--connect",
        listener.url,
        "--out",
        tmp_path / "run",
    ]
    command = [sys.executable, "-m", "omni_mj.run", "--scenario", "rect", "--no-figures", "--quiet", *options]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (listener.path.exists() and listener.path.stat().st_size > 3e5):
        time.sleep(0.02)
    listener.end(signal.SIGKILL)
    _, stderr = process.communicate(timeout=120)
    assert process.returncode == 0
    assert stderr == f"warning: no viewer at {listener.url}; the run goes on without it\n"
    path = tmp_path / "run" / "recording.rrd"
    assert rrd("verify", path).returncode == 0
    assert max(Recorded(path).frames("/world/flc/robot")) > 5_000


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux says by its environment whether there is a display")
@pytest.mark.parametrize(
    ("display", "said"), [({}, "--view needs a display"), ({"DISPLAY": ":987"}, "viewer does not start: ")]
)
def test_a_window_needs_a_display(tmp_path: Path, display: dict[str, str], said: str) -> None:
    done = run(*SHORT, "--view", "--out", tmp_path / "run", **display)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("url", ["", "localhost", "http://127.0.0.1:9876", "rerun+http://127.0.0.1/proxy"])
def test_an_address_that_is_none_is_bad_input(url: str) -> None:
    with pytest.raises(OmniError, match=r"--connect needs the address of a rerun viewer, such as rerun\+http://"):
        live.check(url)


def test_bad_input_is_said_before_the_run(tmp_path: Path) -> None:
    done = run(*SHORT, "--connect", "", "--out", tmp_path / "run")
    assert done.returncode == 2
    assert done.stderr.startswith("error: --connect needs")
    assert not (tmp_path / "run").exists()

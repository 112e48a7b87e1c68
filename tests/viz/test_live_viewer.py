"""A viewer shows a run in progress; a missing viewer causes one warning and no failure."""

import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from benches.recording import (
    Listener,
    RecordingFile,
    create_simulation,
    run_and_record,
    run_rrd_command,
)
from commands import appears

from omni_control.errors import OmniError
from omni_mj.cli.run_command import run_command
from omni_mj.viz.recording import viewer

SHORT = "reference.waypoints=[[0, 0], [0.5, 0.2]]"


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[Listener]:
    """A `rerun --save` process, which listens like a viewer and needs no graphics."""
    started = Listener("--save", tmp_path / "received.rrd")
    yield started
    started.end()


def run(
    url: str, path: Path, *overrides: str, after_frame: Callable[[int], None] | None = None
) -> None:
    """Run on the kinematic plant, shown by the viewer at `url` and recorded in `path`."""
    run_and_record(create_simulation(["flc", "comp-flc"], *overrides), path, url, after_frame)


def unused_url() -> str:
    """Return an address at which no viewer listens."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"rerun+http://127.0.0.1:{free.getsockname()[1]}/proxy"


def wait_until_complete(path: Path) -> None:
    """Wait until a file has not grown for 2 s."""
    assert appears(path)
    size, grown = 0, time.monotonic()
    while time.monotonic() < grown + 2:
        if path.stat().st_size > size:
            size, grown = path.stat().st_size, time.monotonic()
        time.sleep(0.1)


def test_a_viewer_receives_the_same_data_as_the_file(
    listener: Listener, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(listener.url, tmp_path / "recording.rrd", SHORT)
    assert capsys.readouterr().err == ""
    written, path = RecordingFile(tmp_path / "recording.rrd"), tmp_path / "received.rrd"
    wait_until_complete(path)
    listener.end(signal.SIGKILL)
    with pytest.warns(match="no footer"):
        received = RecordingFile(path)
    assert received.entities() == written.entities()
    for entity in written.entities():  # series begin with the block of their first number
        frames = sorted(received.frames(entity))
        assert (
            entity.endswith("/shape") or frames == sorted(written.frames(entity))[-len(frames) :]
        ), entity


def test_a_missing_viewer_causes_one_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = unused_url()
    run(url, tmp_path / "recording.rrd", SHORT)
    assert capsys.readouterr().err == f"warning: no viewer at {url}; the run goes on without it\n"
    assert run_rrd_command("verify", tmp_path / "recording.rrd").returncode == 0


def test_a_viewer_that_is_closed_causes_one_warning(
    listener: Listener, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The viewer is closed in frame 200; the file has all 774 frames of the rectangle."""
    run(
        listener.url,
        tmp_path / "recording.rrd",
        after_frame=lambda frame: listener.end(signal.SIGKILL) if frame == 200 else None,
    )
    assert (
        capsys.readouterr().err
        == f"warning: no viewer at {listener.url}; the run goes on without it\n"
    )
    assert run_rrd_command("verify", tmp_path / "recording.rrd").returncode == 0
    assert max(RecordingFile(tmp_path / "recording.rrd").frames("/world/flc/robot")) == 773


@pytest.mark.skipif(
    sys.platform != "linux", reason="only on Linux does the environment name the display"
)
@pytest.mark.parametrize(
    ("display", "message"), [(None, "--view needs a display"), (":987", "viewer does not start: ")]
)
def test_a_window_needs_a_display(
    display: str | None, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(OmniError, match=message) as error:
        viewer.open_viewer()
    assert "\n" not in str(error.value)


def test_a_bad_address_is_reported_before_the_run(tmp_path: Path) -> None:
    arguments = ["--scenario", "rect", "--connect", "", "--out", str(tmp_path / "run")]
    with pytest.raises(OmniError, match="--connect needs"):
        run_command.main(arguments, standalone_mode=False)
    assert not (tmp_path / "run").exists()

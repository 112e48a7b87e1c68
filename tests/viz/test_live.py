"""A run can be watched while it goes on; a viewer that is not there, or goes away, costs nothing but a line."""

import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from benches.recording import Listener, Recorded, record, rrd, simulated

from omni_control.errors import OmniError
from omni_mj.cli.run import command
from omni_mj.viz.recording import viewer

SHORT = "reference.waypoints=[[0, 0], [0.5, 0.2]]"


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[Listener]:
    """`rerun --save`, which listens as a viewer does and needs no graphics."""
    started = Listener("--save", tmp_path / "heard.rrd")
    yield started
    started.end()


def run(
    url: str, path: Path, *overrides: str, after_frame: Callable[[int], None] | None = None
) -> None:
    """Run on the kinematic plant, watched by the viewer at `url` and recorded into `path`, as the command does."""
    record(simulated(["flc", "comp-flc"], *overrides), path, url, after_frame)


def nobody() -> str:
    """The address of a viewer that is not there."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"rerun+http://127.0.0.1:{free.getsockname()[1]}/proxy"


def test_a_viewer_is_sent_what_is_recorded(
    listener: Listener, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(listener.url, tmp_path / "recording.rrd", SHORT)
    assert capsys.readouterr().err == ""
    written, path = Recorded(tmp_path / "recording.rrd"), tmp_path / "heard.rrd"
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and (
        not path.exists() or path.stat().st_size < written.path.stat().st_size
    ):
        time.sleep(0.1)
    time.sleep(0.5)
    listener.end(signal.SIGKILL)
    with pytest.warns(match="no footer"):
        heard = Recorded(path)
    assert heard.entities() == written.entities()
    for entity in written.entities():  # series begin with the block of their first number
        frames = sorted(heard.frames(entity))
        assert (
            entity.endswith("/shape") or frames == sorted(written.frames(entity))[-len(frames) :]
        ), entity


def test_a_viewer_that_is_not_there_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = nobody()
    run(url, tmp_path / "recording.rrd", SHORT)
    assert capsys.readouterr().err == f"warning: no viewer at {url}; the run goes on without it\n"
    assert rrd("verify", tmp_path / "recording.rrd").returncode == 0


def test_a_viewer_that_goes_away_is_one_line(
    listener: Listener, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It goes away in frame 200; the file has all 774 of the rectangle."""
    run(
        listener.url,
        tmp_path / "recording.rrd",
        after_frame=lambda frame: listener.end(signal.SIGKILL) if frame == 200 else None,
    )
    assert (
        capsys.readouterr().err
        == f"warning: no viewer at {listener.url}; the run goes on without it\n"
    )
    assert rrd("verify", tmp_path / "recording.rrd").returncode == 0
    assert max(Recorded(tmp_path / "recording.rrd").frames("/world/flc/robot")) == 773


@pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux says by its environment whether there is a display"
)
@pytest.mark.parametrize(
    ("display", "said"), [(None, "--view needs a display"), (":987", "viewer does not start: ")]
)
def test_a_window_needs_a_display(
    display: str | None, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(OmniError, match=said) as error:
        viewer.open_viewer()
    assert "\n" not in str(error.value)


def test_bad_input_is_said_before_the_run(tmp_path: Path) -> None:
    arguments = ["--scenario", "rect", "--connect", "", "--out", str(tmp_path / "run")]
    with pytest.raises(OmniError, match="--connect needs"):
        command.main(arguments, standalone_mode=False)
    assert not (tmp_path / "run").exists()

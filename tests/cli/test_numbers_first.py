"""What was computed is on the disk before anything is drawn, and whatever ends a run, its folder says what it holds."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import click
import pyarrow.parquet as pq
import pytest
from commands import invoke, strict

from omni_mj import files
from omni_mj.show import figures, report
from omni_mj.show.recording import scene

OMNI = [sys.executable, "-m", "omni_mj"]
SHORT = ("--set", "reference.waypoints=[[0, 0], [0.1, 0]]", "--set", "reference.settle_s=0.1", "--plant", "kinematic")
RUN = ("run", "--scenario", "rect", *SHORT, "--controller", "flc")


def whole(folder: Path) -> bool:
    """Whether a folder's summary says that all of the run is there, and it is."""
    summary = strict(folder / "summary.json")
    frames = summary["scenarios"]["rect"]["frames"]
    return summary["complete"] and pq.read_table(folder / "trajectory.parquet").num_rows == frames > 0


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (KeyboardInterrupt(), 130, "interrupted; the numbers are whole in"),
        (RuntimeError("no\nfont"), 1, "not all could be drawn: RuntimeError: no font; the numbers are whole in"),
        (OSError(28, "No space left on device"), 1, "not all could be drawn: No space left on device; the numbers"),
    ],
)
def test_drawing_costs_no_numbers(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: BaseException,
    code: int,
    says: str,
) -> None:
    """Whatever figures or report meet; the table is printed, and a line says where the numbers are."""

    def fails(*_: object) -> None:
        raise error

    for module, name in ((figures, "save_all"), (report, "write")):
        out = tmp_path / name
        with monkeypatch.context() as patch:
            patch.setattr(module, name, fails)
            assert invoke(*RUN, "--no-record", "--out", out) == code
        printed = capsys.readouterr()
        assert "plane, cm" in printed.out
        assert printed.err.startswith(f"error: {says}")
        assert printed.err.count("\n") == 1
        assert whole(out)


def test_sigterm_while_drawing_costs_no_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(figures, "save_all", lambda *_: os.kill(os.getpid(), signal.SIGTERM))
    assert invoke(*RUN, "--no-record", "--quiet", "--out", tmp_path / "out") == 143
    assert "terminated; the numbers are whole in" in capsys.readouterr().err
    assert whole(tmp_path / "out")


def test_a_recording_that_fails_costs_no_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the middle of a run: the rest is run, saved, and the program ends with a line about the recording."""

    def fails(*_: object) -> None:
        raise ValueError("refused")

    monkeypatch.setattr(scene, "send", fails)
    assert invoke(*RUN, "--quiet", "--no-figures", "--out", tmp_path / "out") == 1
    err = capsys.readouterr().err
    assert "the recording could not be written to its end: ValueError: refused" in err
    assert err.count("\n") == 1
    assert whole(tmp_path / "out")


def test_a_recording_leaves_the_disk_to_the_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where there is no more room than they will need, it ends, and that is said once."""
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(total=1e9, free=1e6))
    assert invoke(*RUN, "--quiet", "--no-figures", "--out", tmp_path / "out") == 1
    err = capsys.readouterr().err
    assert "the recording could not be written to its end: the 1.0 MB that are left on the disk are for the num" in err
    assert err.count("\n") == 1
    assert whole(tmp_path / "out")
    assert not (tmp_path / "out" / "recording.rrd").exists()


def test_a_killed_run_says_that_it_is_unfinished(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nobody is warned of SIGKILL: in the folder is a summary that says so, and nothing that looks whole."""
    out = tmp_path / "out"
    endless = (*RUN, "--set", "reference.laps=1000", "--no-record", "--no-figures", "--quiet", "--out", str(out))
    process = subprocess.Popen([*OMNI, *endless])
    deadline = time.monotonic() + 60
    while not (out / "scenario.toml").exists():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.kill()
    process.wait()
    summary = strict(out / "summary.json")
    assert (summary["complete"], summary["stopped"]) == (False, "unfinished (it goes on, or was killed)")
    assert summary["scenarios"]["rect"]["status"] == "not run"
    assert not (out / "trajectory.parquet").exists()
    assert invoke("verify", out) == 2
    assert "is unfinished (it goes on, or was killed); nothing to compare with" in capsys.readouterr().err
    assert invoke("report", out) == 0
    assert "unfinished (it goes on, or was killed)" in (out / "report.html").read_text()
    assert invoke(*RUN, "--no-record", "--no-figures", "--quiet", "--overwrite", "--out", out) == 0
    assert whole(out)


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its bytes are synced under another name before it takes its place, and then its folder; what fails leaves all."""
    path, synced = tmp_path / "file", list[set[str]]()

    def sync(handle: int, real=os.fsync) -> None:
        synced.append({entry.name for entry in tmp_path.iterdir()})
        real(handle)

    monkeypatch.setattr(files.os, "fsync", sync)
    files.write(path, "first")
    assert synced == [{"file.partial"}, {"file"}]

    def interrupted() -> None:
        with files.whole(path) as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("file", "first")]


@pytest.mark.parametrize(
    "error", [MemoryError(), ImportError("failed to map"), ValueError("Could not allocate memory")]
)
def test_little_memory_is_a_line(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    @click.command("any")
    def command() -> None:
        raise error

    assert invoke(command=command) == 1
    assert capsys.readouterr().err.startswith("error: there is too little memory, or a library cannot be loaded")

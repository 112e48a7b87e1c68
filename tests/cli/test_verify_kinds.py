"""What else `omni-mj verify` is asked to repeat: a run that was stopped, a comparison, and chance."""

import json
import shutil
import signal
from pathlib import Path

import pytest
from commands import invoke, strict

SHORT = ("--set", "reference.waypoints=[[0, 0, 0], [0.2, 0.1, 0.3]]", "--set", "reference.settle_s=0.1")
BARE = ("--no-record", "--no-figures", "--quiet")
DICE = """
import numpy as np

import omni_mj as om


class Dice(om.Controller):
    def command(self, frame, seen):
        return 0 * seen.pose + (1e-3 * np.random.default_rng().random() if frame > 4 else 0)  # less than limits change
"""
STOPPED = """
import os
import signal
from pathlib import Path

import omni_mj as om


class Stopped(om.Controller):
    def command(self, frame, seen):
        if frame == 20 and Path("press").exists():
            os.kill(os.getppid(), signal.SIGINT)
        return 0 * seen.pose
"""


def test_a_run_that_was_stopped_repeats_up_to_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C comes in frame 20, and is pressed by nobody when it is repeated."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job's would be ignored
    (tmp_path / "stopped.py").write_text(STOPPED)
    (tmp_path / "press").touch()
    monkeypatch.chdir(tmp_path)
    words = ("--scenario", "rect", "--plant", "kinematic", "--controller", "flc", "--controller", "stopped.py:Stopped")
    assert invoke("run", *words, *BARE, "--out", "out") == 130
    (tmp_path / "press").unlink()
    capsys.readouterr()
    assert invoke("verify", "out") == 0
    first, note = capsys.readouterr().out.splitlines()
    assert first == "repeats: 2 rows, 42 frames identical bit for bit"
    assert note == "note: the run was interrupted: it was repeated up to there"
    signal.signal(signal.SIGINT, before)


def test_a_comparison_repeats(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each scenario with the seeds that it was run with: its frames, or else the summary's numbers."""
    out = tmp_path / "out"
    words = ("--plant", "kinematic", "--scenario", "rect", "--scenario", "rect-noise", *SHORT, "--controller", "flc")
    assert invoke("compare", *words, "--seeds", 6, "--quiet", "--trajectories", "--out", out) == 0
    entries = strict(out / "summary.json")["scenarios"].values()
    rows, frames = (sum(len(e["seeds"]) * (e["frames"] if each else 1) for e in entries) for each in (False, True))
    assert invoke("verify", out) == 0
    assert capsys.readouterr().out == f"repeats: {rows} rows, {frames} frames identical bit for bit\n"
    shutil.rmtree(out / "trajectories")
    record = strict(out / "provenance.json") | {"frames_kept": False}
    (out / "provenance.json").write_text(json.dumps(record))
    assert invoke("verify", out) == 0
    printed = capsys.readouterr().out
    assert printed.startswith(f"repeats: {rows} rows, the summary's numbers identical\n")
    assert "rect: no frames were kept; the summary's numbers are compared" in printed


def test_what_drives_by_chance_does_not_repeat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "dice.py").write_text(DICE)
    monkeypatch.chdir(tmp_path)
    words = ("--scenario", "rect", "--plant", "kinematic", *SHORT, "--controller", "dice.py:Dice")
    assert invoke("run", *words, *BARE, "--out", "out") == 0
    assert invoke("verify", "out") == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[1].startswith("error: first in frame 5 (0.083 s) of Dice, seed 0: command_vx_m_s is ")
    assert "random numbers without a seed" in lines[-1]

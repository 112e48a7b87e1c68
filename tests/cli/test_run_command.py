"""`omni-mj run`: what it prints, what it leaves, what ends it."""

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from commands import appears, invoke, signalled, strict
from rerun.chunk import RrdReader

from omni_mj.cli import run

RUN = [sys.executable, "-m", "omni_mj.run"]
SHORT = ("--set", "reference.waypoints=[[0, 0], [0.1, 0]]", "--set", "reference.settle_s=0.1")
BARE = ("--quiet", "--no-record", "--no-figures")
FILES = {"summary.json", "trajectory.parquet", "recording.rrd", "scenario.toml", "figures", "report.html"}
FILES |= {"provenance.json", "sources"}
BAD = """
import omni_mj as om


class Bad(om.Controller):
    def command(self, frame, seen):
        if frame == 20:
            raise RuntimeError("out of\\nideas")
        return 0 * seen.pose
"""


def test_a_run_prints_the_table_and_where_its_files_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke("run", "--scenario", "rect", *SHORT) == 0
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.startswith("rect-")
    assert {p.name for p in folder.iterdir()} == FILES
    printed = capsys.readouterr()
    assert printed.err == ""
    for text in ("x, cm", "plane, cm", "heading", "comp-flc", f"rerun runs/{folder.name}/recording.rrd"):
        assert text in printed.out
    assert "paper's" not in printed.out, "this is not the paper's experiment"
    summary = strict(folder / "summary.json")
    assert (summary["format"], summary["complete"], summary["seeds"]) == (4, True, [0])
    entry = summary["scenarios"]["rect"]
    assert entry["simulated_s"] == pytest.approx(entry["frames"] / 60)
    assert entry["settings"]["radio"]["delay_frames"] == 6
    assert {"python", "omni-mj", "mujoco"} <= set(summary["versions"])


def test_the_effective_scenario_repeats_the_run_bit_for_bit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And quiet prints nothing, switches leave files out."""
    options = ("--seed", 7, "--seeds", 2, "--controller", "comp-flc", "--set", "radio.delay_frames=3")
    for plant in ("kinematic", "mujoco"):
        a, b = tmp_path / plant / "a", tmp_path / plant / "b"
        given = ("--scenario", "rect-noise", *SHORT, "--plant", plant, "--robot", "tigers-v2016", *options)
        assert invoke(*given, *BARE, "--out", a) == 0
        assert invoke("--scenario", a / "scenario.toml", *BARE, "--out", b) == 0
        assert {p.name for p in a.iterdir()} == FILES - {"recording.rrd", "figures"}
        first, second = (pq.read_table(folder / "trajectory.parquet") for folder in (a, b))
        assert first.num_rows > 0
        # Compared as bytes, since what is not a number is not equal to itself.
        assert [c.combine_chunks().buffers()[-1] for c in first.columns] == [
            c.combine_chunks().buffers()[-1] for c in second.columns
        ]
        assert (a / "scenario.toml").read_text() == (b / "scenario.toml").read_text()
    assert capsys.readouterr() == ("", "")


def test_what_happens_in_a_run_is_repeated_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """How controllers recover below the table; settings and events in report and recording; faults are no notes."""
    faults = '[[fault]]\nkind = "vision-out"\nat = 0.2\nfor = 0.1\n\n[[fault]]\nkind = "delay"\nat = 0.4\nto = 9\n'
    (tmp_path / "met.toml").write_text('plant = "kinematic"\n[reference]\nwaypoints = [[0, 0], [0.2, 0]]\n\n' + faults)
    a, b = tmp_path / "a", tmp_path / "b"
    assert invoke("run", "--scenario", tmp_path / "met.toml", "--controller", "flc", "--no-figures", "--out", a) == 0
    printed = capsys.readouterr().out
    assert "worst, cm" in printed
    assert "dead time of 9 frames, from 0.4 s on" in printed
    assert "note" not in printed
    assert invoke("run", "--scenario", a / "scenario.toml", *BARE, "--out", b) == 0
    assert (a / "scenario.toml").read_text() == (b / "scenario.toml").read_text()
    first, second = (strict(folder / "summary.json")["scenarios"]["met"] for folder in (a, b))
    assert first["results"] == second["results"]
    assert [fault["kind"] for fault in first["settings"]["fault"]] == ["vision-out", "delay"]
    told = [event["text"] for event in first["events"] if event["controller"] == "flc"]
    unseen, late = "camera that does not see the robot", "dead time of 9 frames"
    assert told == [f"begins: {unseen}", f"ends: {unseen}", f"begins: {late}"]
    report = (a / "report.html").read_text()
    assert "<code>fault</code>" in report
    assert f"begins: {late}" in report
    batches = [chunk.to_record_batch() for chunk in RrdReader(a / "recording.rrd").stream().to_chunks()]
    columns = [batch.column(name) for batch in batches for name in batch.schema.names if name.startswith("Text")]
    texts = [str(text) for column in columns for text in column.to_pylist()]
    assert any(f"- {late}, from 0.4 s on" in text for text in texts), "settings"
    assert any(f"flc: begins: {late}" in text for text in texts), "events"


def test_bad_input_is_a_line_each_that_says_what_is_allowed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, *says in (
        ("", "--scenario is missing"),
        ("--scenario rekt", "did you mean 'rect'"),
        ("--scenario missing.toml", "missing.toml"),
        ("--scenario rect --plant mujocco", "did you mean 'mujoco'"),
        ("--scenario rect --robot tigers-v201", "did you mean 'tigers-v2016'"),
        ("--scenario rect --controller comp-fcl", "did you mean 'comp-flc'"),
        ("--scenario rect --controller flc --controller flc", "named twice"),
        ("--scenario rect --seeds 0", "1 to 100000"),
        ("--scenario rect --seeds many", "not a valid integer"),
        ("--scenario rect --set radio.delay=3", "did you mean 'radio.delay_frames'"),
        ("--scenario rect --set radio.delay_frames=-1", "a whole number from 0 to 600 frames, not -1"),
        ("--scenario rect --set radio.delay_frames", "section.field=value"),
        ("--scenario rect --set vision.position_noise_m=nan", "a number from 0 to 1 m"),
        ("--scenario rect --set carpet.friction=9 --seeds 0 --plant x", "carpet.friction", "seeds", "plant"),
        ("--scenario rect --sead 3", "--seed"),
    ):
        assert invoke("run", *arguments.split(), "--out", tmp_path / "run") == 2
        printed = capsys.readouterr()
        lines = printed.err.splitlines()
        assert len(lines) == len(says), arguments
        assert all(line.startswith("error: ") for line in lines)
        assert all(any(text in line for line in lines) for text in says), printed.err
        assert printed.out == ""
        assert not (tmp_path / "run").exists(), "bad input must not leave a folder"


def test_a_row_that_fails_costs_a_line_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.py").write_text(BAD)
    out = tmp_path / "out"
    given = ("--scenario", "rect", "--plant", "kinematic", *SHORT, "--seeds", 2, "--no-figures", "--out", out)
    assert invoke(*given, "--controller", "flc", "--controller", f"{tmp_path / 'bad.py'}:Bad") == 1
    printed = capsys.readouterr()
    where = "Bad failed in frame 20 (bad.py, line 8): RuntimeError: out of ideas at 0.333 s"
    assert printed.err.splitlines() == [f"error: Bad, seed {seed}: {where}" for seed in (0, 1)]
    assert "Bad (failed 2 of 2)" in printed.out
    assert {p.name for p in out.iterdir()} == FILES - {"figures"}
    assert strict(out / "summary.json")["scenarios"]["rect"]["results"]["flc"]["failed"] == 0


def test_earlier_results_are_never_overwritten_unasked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    precious = tmp_path / "precious.txt"
    precious.write_text("keep")
    options = ("--scenario", "rect", "--plant", "kinematic", *SHORT, *BARE, "--out", tmp_path)
    assert invoke(*options) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["precious.txt"]
    assert invoke(*options, "--overwrite") == 2
    assert "was not left by a run" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["precious.txt"]


def test_programs_are_named_as_a_user_starts_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By name where the PATH has them, below the folder where it does not."""
    program = tmp_path / ".venv" / "bin" / "rerun"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program.with_name("python")))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(program.parent))
    assert shutil.which("rerun") == str(program)
    assert run._program("rerun") == "rerun"
    monkeypatch.setenv("PATH", "")
    assert run._program("rerun") == ".venv/bin/rerun"


ENDLESS = ("--scenario", "rect", "--plant", "kinematic", "--set", "reference.laps=60", "--no-figures")


def keeps_what_it_recorded(out: Path, stderr: str) -> None:
    """A run's folder and what it said, when it was stopped on its way."""
    assert "what was recorded until then" in stderr.splitlines()[-1]
    assert "Traceback" not in stderr
    summary = json.loads((out / "summary.json").read_text())
    entry = summary["scenarios"]["rect"]
    assert (summary["complete"], entry["status"]) == (False, "stopped")
    assert summary["stopped"] == entry["reason"] in ("interrupted", "terminated", "left by its terminal")
    assert pq.read_table(out / "trajectory.parquet").num_rows == 2 * entry["frames"] > 0


def test_an_interrupted_run_keeps_what_it_recorded(tmp_path: Path) -> None:
    """A process of its own, as in a terminal."""
    process = subprocess.Popen(
        [*RUN, *ENDLESS, "--out", str(tmp_path / "out")],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a background job ignores it
    )
    assert appears(tmp_path / "out" / "recording.rrd")
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    keeps_what_it_recorded(tmp_path / "out", stderr)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_other_signals_keep_it_as_well(
    number: int, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with signalled(number, tmp_path / "out" / "recording.rrd"):
        assert invoke("run", *ENDLESS, "--out", tmp_path / "out") == code
    keeps_what_it_recorded(tmp_path / "out", capsys.readouterr().err)


def test_a_full_disk_is_one_line_and_leaves_what_fits(tmp_path: Path) -> None:
    """A limit on file sizes stands in for a full disk: the recording, of 1.7 MB, does not fit."""
    options = ["--scenario", "rect", "--plant", "kinematic", "--quiet", "--no-figures", "--out", str(tmp_path / "run")]
    limited = 'ulimit -f 700; exec "$0" "$@"'  # units of 1 KiB
    done = subprocess.run(
        ["bash", "-c", limited, *RUN, *options], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    # rerun's own writer complains too, in lines that begin with a time.
    own = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(own) == 1
    assert own[0].startswith(f"error: cannot write to {tmp_path / 'run'}: ")
    assert (tmp_path / "run" / "scenario.toml").exists()
    # The file ends in the middle of a message; the README's command makes it whole.
    rerun, whole = Path(sys.executable).with_name("rerun"), tmp_path / "whole.rrd"
    command = [rerun, "rrd", "optimize", tmp_path / "run" / "recording.rrd", "-o", whole]
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    chunks = [c for c in RrdReader(whole).stream().to_chunks() if c.entity_path == "/world/flc/robot"]
    frames = [f for c in chunks if not c.is_static for f in c.to_record_batch()["frame"].to_pylist()]
    assert len(frames) > 60

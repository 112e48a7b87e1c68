"""The command line, as a user types it: real processes, real files."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from rerun.chunk import RrdReader

from omni_mj.scenarios.plants import PLANTS

RUN = [sys.executable, "-m", "omni_mj.run"]
SHORT = ["--set", "reference.waypoints=[[0, 0], [0.1, 0]]", "--set", "reference.settle_s=0.1"]
FILES = {"summary.json", "trajectory.parquet", "recording.rrd", "scenario.toml", "figures", "report.html"}


def run(*args: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*RUN, *map(str, args)], capture_output=True, text=True, timeout=120, check=False, cwd=cwd)


def test_a_run_prints_the_table_and_where_its_files_are(tmp_path: Path) -> None:
    done = run("--scenario", "rect", *SHORT, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.startswith("rect-")
    assert {p.name for p in folder.iterdir()} == FILES
    for text in ("x maximum", "y mean", "(-", "paper's flc", f"rerun runs/{folder.name}/recording.rrd"):
        assert text in done.stdout


def test_quiet_prints_nothing_and_switches_leave_files_out(tmp_path: Path) -> None:
    done = run("--scenario", "rect", *SHORT, "--quiet", "--no-record", "--no-figures", "--out", tmp_path / "a")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert {p.name for p in (tmp_path / "a").iterdir()} == FILES - {"recording.rrd", "figures"}


@pytest.mark.parametrize("plant", PLANTS)
def test_the_effective_scenario_repeats_the_run_bit_for_bit(tmp_path: Path, plant: str) -> None:
    options = ("--plant", plant, "--seed", 7, "--seeds", 2, "--controller", "comp-flc", "--set", "radio.delay_frames=3")
    plain = ("--quiet", "--no-record", "--no-figures", "--out")
    assert run("--scenario", "rect-noise", *SHORT, *options, *plain, tmp_path / "a").returncode == 0
    assert run("--scenario", tmp_path / "a" / "scenario.toml", *plain, tmp_path / "b").returncode == 0
    first, second = (pq.read_table(tmp_path / name / "trajectory.parquet") for name in "ab")
    assert first.num_rows > 0
    # Compared as bytes, since what is not a number is not equal to itself.
    assert [c.combine_chunks().buffers()[-1] for c in first.columns] == [
        c.combine_chunks().buffers()[-1] for c in second.columns
    ]
    assert (tmp_path / "a" / "scenario.toml").read_text() == (tmp_path / "b" / "scenario.toml").read_text()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "--scenario is missing"),
        (["--scenario", "rekt"], "did you mean 'rect'"),
        (["--scenario", "missing.toml"], "missing.toml"),
        (["--scenario", "rect", "--plant", "mujocco"], "did you mean 'mujoco'"),
        (["--scenario", "rect", "--controller", "comp-fcl"], "did you mean 'comp-flc'"),
        (["--scenario", "rect", "--controller", "flc", "--controller", "flc"], "named twice"),
        (["--scenario", "rect", "--seeds", "0"], "1 to 100000"),
        (["--scenario", "rect", "--seeds", "many"], "not a valid integer"),
        (["--scenario", "rect", "--set", "radio.delay=3"], "did you mean 'radio.delay_frames'"),
        (["--scenario", "rect", "--set", "radio.delay_frames=-1"], "a whole number from 0 to 600 frames, not -1"),
        (["--scenario", "rect", "--set", "radio.delay_frames"], "section.field=value"),
        (["--scenario", "rect", "--set", "vision.position_noise_m=nan"], "a number from 0 to 1 m"),
        (["--scenario", "rect", "--sead", "3"], "--seed"),
    ],
)
def test_bad_input_is_one_line_that_says_what_is_allowed(tmp_path: Path, arguments: list[str], says: str) -> None:
    done = run(*arguments, "--out", tmp_path / "run")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert says in done.stderr
    assert done.stdout == ""
    assert not (tmp_path / "run").exists(), "bad input must not leave a folder"


def test_earlier_results_are_never_overwritten_unasked(tmp_path: Path) -> None:
    precious = tmp_path / "precious.txt"
    precious.write_text("keep")
    options = ("--scenario", "rect", *SHORT, "--no-record", "--no-figures", "--out", tmp_path)
    refused = run(*options)
    assert refused.returncode == 2
    assert "--overwrite" in refused.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["precious.txt"]
    assert run(*options, "--overwrite").returncode == 0
    assert precious.read_text() == "keep"


def test_list_names_every_scenario_controller_and_setting() -> None:
    done = run("--list")
    assert done.returncode == 0
    for name in ("rect-noise", "comp-flc", "radio.delay_frames", "vision.position_noise_m", "V s/rad", "0.826"):
        assert name in done.stdout


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_keeps_what_it_recorded(tmp_path: Path, number: int, code: int) -> None:
    endless = ("--scenario", "rect", "--set", "reference.laps=60", "--out", str(tmp_path))
    process = subprocess.Popen(
        [*RUN, *endless],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # a background job's children ignore SIGINT
    )
    deadline = time.monotonic() + 60
    while not (tmp_path / "recording.rrd").exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(2)
    process.send_signal(number)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == code, stderr
    assert "what was recorded until then" in stderr.splitlines()[-1]
    assert "Traceback" not in stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert not summary["complete"]
    assert pq.read_table(tmp_path / "trajectory.parquet").num_rows == 2 * summary["frames"] > 0


def test_a_reader_that_goes_away_hears_no_complaint() -> None:
    command = f"{sys.executable} -m omni_mj.run --list | head -1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.startswith("scenarios")
    assert done.stderr == ""


def test_a_full_disk_is_one_line_and_leaves_what_fits(tmp_path: Path) -> None:
    """A limit on file sizes stands in for a full disk: the recording, of 1.5 MB, does not fit."""
    options = ["--scenario", "rect", "--quiet", "--no-figures", "--out", str(tmp_path / "run")]
    limited = 'ulimit -f 400; exec "$0" "$@"'  # units of 1 KiB
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


def test_the_console_script_runs_scenarios_with_or_without_the_word_run(tmp_path: Path) -> None:
    script = Path(sys.executable).with_name("omni-mj")
    for i, words in enumerate(([], ["run"])):
        args = [script, *words, "--scenario", "rect", *SHORT, "--quiet", "--no-record", "--no-figures"]
        assert subprocess.run([*args, "--out", tmp_path / str(i)], check=False, timeout=60).returncode == 0
        assert (tmp_path / str(i) / "summary.json").exists()

"""`omni-mj run`: printed text, files, signals, full disks and existing folders."""

import shutil
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pyarrow.parquet as pq
import pytest
from commands import BARE, SHORT, appears, invoke, signalled, strict
from rerun.chunk import RrdReader

PROGRAM = [sys.executable, "-m", "omni_mj.run"]
KINEMATIC = f"run --scenario rect --plant kinematic {SHORT} --controller flc"
FILES = {
    "summary.json",
    "trajectory.parquet",
    "recording.rrd",
    "scenario.toml",
    "figures",
    "report.html",
    "provenance.json",
    "sources",
}


def is_whole(folder: Path) -> bool:
    """Return whether a folder contains a complete run, as its summary says."""
    summary = strict(folder / "summary.json")
    entry = summary["scenarios"]["rect"]
    with (folder / "trajectory.parquet").open("rb") as file:
        rows = pq.read_table(file).num_rows
    return summary["complete"] and rows == entry["frames"] * len(entry["results"]) > 0


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_a_run_prints_the_table_and_where_its_files_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke("run --scenario rect --plant planar", SHORT) == 0
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.startswith("rect-")
    assert {p.name for p in folder.iterdir()} == FILES
    printed = capsys.readouterr()
    assert printed.err == ""
    for text in (
        "is best: its mean",
        "position",
        "heading",
        "comp-flc",
        f"runs/{folder.name}/recording.rrd",
    ):
        assert text in printed.out
    summary = strict(folder / "summary.json")
    assert (summary["complete"], summary["seeds"]) == (True, [0])
    entry = summary["scenarios"]["rect"]
    assert entry["simulated_s"] == pytest.approx(entry["frames"] / 60)
    assert entry["settings"]["radio"]["delay_frames"] == 6
    assert {"python", "omni-mj", "mujoco"} <= set(summary["versions"])
    assert is_whole(folder)


def test_the_effective_scenario_repeats_the_run_bit_for_bit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """--quiet prints nothing; --no-record and --no-figures leave files out."""
    options = "--seed 7 --seeds 2 --controller comp-flc --set radio.delay_frames=3"
    for plant in ("kinematic", "mujoco"):
        a, b = tmp_path / plant / "a", tmp_path / plant / "b"
        words = f"--scenario rect-noise {SHORT} --plant {plant} {options} {BARE} --out"
        assert invoke(words, a) == 0
        assert invoke("--scenario", a / "scenario.toml", BARE, "--out", b) == 0
        assert {p.name for p in a.iterdir()} == FILES - {"recording.rrd", "figures"}
        frames_a, frames_b = (pq.read_table(folder / "trajectory.parquet") for folder in (a, b))
        assert frames_a.num_rows > 0
        # Compared as bytes, since NaN is not equal to itself.
        bits = (
            [c.combine_chunks().buffers()[-1] for c in frames.columns]
            for frames in (frames_a, frames_b)
        )
        assert next(bits) == next(bits)
        assert (a / "scenario.toml").read_text() == (b / "scenario.toml").read_text()
    assert capsys.readouterr() == ("", "")


def test_faults_appear_in_table_summary_report_and_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    faults = (
        '[[fault]]\nkind = "vision-loss"\nstart_s = 0.2\nduration_s = 0.1\n\n'
        '[[fault]]\nkind = "radio-delay"\nstart_s = 0.4\ndelay_frames = 9\n'
    )
    (tmp_path / "met.toml").write_text(
        'plant = "kinematic"\n[reference]\nwaypoints = [[0, 0], [0.2, 0]]\n\n' + faults
    )
    out = tmp_path / "out"
    scenario = tmp_path / "met.toml"
    assert invoke("run --controller flc --no-figures --scenario", scenario, "--out", out) == 0
    printed = capsys.readouterr().out
    assert "largest error" in printed
    assert "radio-delay (delay_frames = 9), from 0.4 s on" in printed
    event_texts = [
        event["text"] for event in strict(out / "summary.json")["scenarios"]["met"]["events"]
    ]
    assert [text.split()[:2] for text in event_texts if "vision" in text or "delay" in text] == [
        ["begins:", "vision-loss"], ["ends:", "vision-loss"], ["begins:", "radio-delay"],
    ]  # fmt: skip
    assert "begins: radio-delay" in (out / "report.html").read_text()
    batches = [
        chunk.to_record_batch() for chunk in RrdReader(out / "recording.rrd").stream().to_chunks()
    ]
    columns = [
        batch.column(name)
        for batch in batches
        for name in batch.schema.names
        if name.startswith("Text")
    ]
    assert any(
        "begins: radio-delay" in str(text) for column in columns for text in column.to_pylist()
    )


def test_each_invalid_input_is_one_line_with_the_allowed_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, *expected_errors in (
        ("", "--scenario is missing"),
        ("--scenario rekt", "did you mean 'rect'"),
        ("--scenario missing.toml", "missing.toml"),
        ("--scenario rect --seeds many", "not a valid integer"),
        ("--scenario rect --set radio.delay_frames", "section.field=value"),
        (
            "--scenario rect --set carpet.friction=9 --seeds 0 --plant x",
            "carpet.friction",
            "seeds",
            "plant",
        ),
        ("--scenario rect --set fault.start_s=3", "fault"),
        ("--scenario rect --sead 3", "--seed"),
    ):
        assert invoke("run", arguments, "--out", tmp_path / "run") == 2
        printed = capsys.readouterr()
        lines = printed.err.splitlines()
        assert len(lines) == len(expected_errors), arguments
        assert all(line.startswith("error: ") for line in lines)
        assert all(any(text in line for line in lines) for text in expected_errors), printed.err
        assert printed.out == ""
        assert not (tmp_path / "run").exists(), "bad input must not leave a folder"


# What ends it.

ENDLESS = "--scenario rect --plant kinematic --set reference.laps=60 --no-figures --out"


def keeps_what_it_recorded(out: Path, stderr: str) -> None:
    assert "the frames so far are in" in stderr.splitlines()[-1]
    assert "Traceback" not in stderr
    summary = strict(out / "summary.json")
    entry = summary["scenarios"]["rect"]
    assert (summary["complete"], entry["status"]) == (False, "stopped")
    assert summary["stopped"] == entry["reason"]
    assert pq.read_table(out / "trajectory.parquet").num_rows == 2 * entry["frames"] > 0


def test_an_interrupted_run_keeps_what_it_recorded(tmp_path: Path) -> None:
    """In a separate process, as in a terminal."""
    process = subprocess.Popen(
        [*PROGRAM, *ENDLESS.split(), tmp_path / "out"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        # A background job ignores it.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert appears(tmp_path / "out" / "recording.rrd")
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    keeps_what_it_recorded(tmp_path / "out", stderr)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_other_signals_keep_the_recorded_frames_too(
    number: int, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with signalled(number, tmp_path / "out" / "recording.rrd"):
        assert invoke("run", ENDLESS, tmp_path / "out") == code
    keeps_what_it_recorded(tmp_path / "out", capsys.readouterr().err)


def test_a_killed_run_is_marked_unfinished_and_can_be_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """After SIGKILL, the folder has a summary that says so and no complete files."""
    out = tmp_path / "out"
    process = subprocess.Popen([*PROGRAM, "--no-record", "--quiet", *ENDLESS.split(), out])
    assert appears(out / "summary.json")
    process.kill()
    process.wait()
    summary = strict(out / "summary.json")
    assert (summary["complete"], summary["scenarios"]["rect"]["status"]) == (False, "not run")
    assert not (out / "trajectory.parquet").exists()
    assert invoke("verify", out) == 2
    assert "nothing to compare with" in capsys.readouterr().err
    assert invoke("report", out) == 0
    assert invoke(KINEMATIC, BARE, "--overwrite --out", out) == 0
    assert is_whole(out)


def test_a_full_disk_is_one_line_and_keeps_the_files_that_fit(tmp_path: Path) -> None:
    """A limit on file sizes stands in for a full disk: the recording does not fit."""
    options = "--scenario rect --plant kinematic --controller flc --quiet --no-figures"
    options += " --set reference.waypoints=[[0,0],[1,0],[0,0]] --out"
    limited = 'ulimit -f 150; exec "$0" "$@"'  # units of 1 KiB
    done = subprocess.run(
        ["bash", "-c", limited, *PROGRAM, *options.split(), tmp_path / "run"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    # rerun's own writer complains too, in lines that begin with a time.
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert line.startswith(f"error: cannot write to {tmp_path / 'run'}: ")
    assert (tmp_path / "run" / "scenario.toml").exists()


@pytest.mark.parametrize(
    ("error", "code", "expected_errors"),
    [
        (KeyboardInterrupt(), 130, "interrupted; the results so far"),
        (OSError(28, "no space"), 1, "cannot write to"),
    ],
)
def test_failing_to_draw_loses_no_numbers(
    error: BaseException,
    code: int,
    expected_errors: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The table is printed, and a line names the folder of the numbers."""

    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr("omni_mj.viz.run_figures.save_run_figures", fails)
    assert invoke(KINEMATIC, "--no-record --out", tmp_path / "out") == code
    printed = capsys.readouterr()
    assert "position" in printed.out
    assert printed.err.startswith(f"error: {expected_errors}")
    assert printed.err.count("\n") == 1
    assert is_whole(tmp_path / "out")


def test_a_recording_reserves_disk_space_for_the_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With too little disk space, the recording ends with one message."""
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(total=1e9, free=1e6))
    assert invoke(KINEMATIC, "--quiet --no-figures --out", tmp_path / "out") == 1
    err = capsys.readouterr().err
    assert "the recording could not be written to its end" in err
    assert err.count("\n") == 1
    assert is_whole(tmp_path / "out")


# Folders.


@pytest.mark.parametrize("mark", [None, "", "[1]", '{"format": 1}'])
def test_a_folder_of_other_files_is_never_overwritten(
    tmp_path: Path, mark: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not even if a file in it is called provenance.json."""
    (tmp_path / "figures").mkdir()
    for name in ("summary.json", "report.html", "figures/path.png"):
        (tmp_path / name).write_text("precious")
    if mark is not None:
        (tmp_path / "provenance.json").write_text(mark)
    old_contents = contents(tmp_path)
    for option, expected_errors in (
        ("", "--overwrite"),
        ("--overwrite", "was not created by a run"),
    ):
        assert invoke(KINEMATIC, BARE, option, "--out", tmp_path) == 2
        err = capsys.readouterr().err
        assert expected_errors in err
        assert err.count("\n") == 1
        assert contents(tmp_path) == old_contents


def test_overwriting_removes_the_files_of_the_earlier_run(tmp_path: Path) -> None:
    """Invalid input removes nothing, and the target of a link stays."""
    (tmp_path / "mine.py").write_text(
        "import omni_mj as om\n\n\nclass Mine(om.Controller):\n"
        "    def command(self, frame, observation):\n"
        "        return 0 * observation.pose\n"
    )
    out = tmp_path / "out"
    run = KINEMATIC, "--no-record --quiet --out", out
    assert invoke(*run, f"--controller {tmp_path}/mine.py:Mine") == 0
    old_contents = contents(out)
    assert {"figures/path.png", "sources/mine.py", "report.html"} <= set(old_contents)
    for wrong in ("--set radio.delay=3", "--controller fcl", "--connect nowhere"):
        assert invoke(*run, "--overwrite", wrong) == 2
        assert contents(out) == old_contents
    (out / "old").mkdir()
    precious = {"notes.txt", "summary.json.bak", "old/summary.json"}
    for name in precious:
        (out / name).write_text("precious")
    shutil.move(out / "sources", tmp_path / "elsewhere")
    (out / "sources").symlink_to(tmp_path / "elsewhere")
    assert invoke(*run, "--no-figures --overwrite") == 0
    new_contents = contents(out)
    assert {name: new_contents[name] for name in precious} == dict.fromkeys(precious, b"precious")
    assert set(new_contents) - precious == {
        n for n in old_contents if not n.startswith("figures/")
    } - {"sources/mine.py"}
    assert (tmp_path / "elsewhere/mine.py").exists()


@pytest.mark.parametrize("name", ["a:b", "hdfs:x", "s3:", "%2e", "a b", "ü\u2028"])
def test_folders_may_have_any_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """None is mistaken for a URL. Its files can be read, and the run repeats."""
    monkeypatch.chdir(tmp_path)
    assert invoke(KINEMATIC, BARE, "--out", Path(name)) == 0
    assert is_whole(Path(name))
    assert invoke("verify", Path(name), "--quiet") == 0

"""`omni-mj verify`: a run's folder says what it ran, wherever it is, and gives the same again or says why not."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import invoke, strict

from omni_mj.scenarios import robots

OMNI = [sys.executable, "-m", "omni_mj"]
SHORT = ("--set", "reference.waypoints=[[0, 0, 0], [0.2, 0.1, 0.3]]", "--set", "reference.settle_s=0.1")
BARE = ("--no-record", "--no-figures", "--quiet")
MINE = '''
import click
from shared.gains import GAIN

import omni_mj as om


class Mine(om.Controller):
    """Proportional control, with a gain from a module beside this file and a parameter."""

    share: float = 1.0

    def command(self, frame, seen):
        target, feed_forward = self.reference.at(frame, seen.pose)
        return feed_forward + GAIN * self.share * (target - seen.pose)
'''
TOY = """
import numpy as np

from omni_mj.plants import Telemetry


class Toy:
    geometry = None

    def __init__(self, rows, start):
        self._pose, self._twist = np.array(start), np.zeros_like(start)

    def pose(self):
        return self._pose

    def twist(self):
        return self._twist

    def advance(self, received):
        self._twist = 0.9 * received.command
        self._pose = self._pose + self._twist / 60
        return {}

    def telemetry(self):
        return Telemetry.of_no_wheels(len(self._pose))
"""


def program(*words: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """The program as a user starts it, in a folder."""
    return subprocess.run(
        [*OMNI, *map(str, words)], cwd=cwd, capture_output=True, text=True, timeout=60, check=False
    )  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of a user's controller, plant and robot, whose files have gone since."""
    there = tmp_path_factory.mktemp("there")
    (there / "mine.py").write_text(MINE)
    (there / "toy.py").write_text(TOY)
    (there / "shared").mkdir()
    (there / "shared" / "gains.py").write_text("GAIN = 4.0\n")
    text = robots.robot_path("tigers-v2016").read_text().replace("arm_m = ", "arm_m = 0.09 # was ", 1)
    (there / "robot.toml").write_text(text)
    given = ("--plant", "toy.py:Toy", "--robot", "robot.toml", "--controller", "flc", "--controller", "mine.py:Mine")
    more = ("--set", "controller.Mine.share=0.75", "--seeds", 2, "--out", "out")
    done = program("run", "--scenario", "rect-noise", *SHORT, *given, *more, *BARE, cwd=there)
    assert (done.returncode, done.stderr) == (0, "")
    folder = tmp_path_factory.mktemp("elsewhere") / "moved"
    shutil.move(there / "out", folder)
    shutil.rmtree(there)
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of that folder, to be spoilt."""
    return shutil.copytree(made, tmp_path / "copy")


def edited(file: Path, change: Callable[[Any], object]) -> None:
    """Change what a JSON file holds."""
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def test_a_folder_holds_what_was_run(made: Path) -> None:
    """Files and their hashes, the controllers' parameters, versions, processor; and no path but in the command line."""
    record = strict(made / "provenance.json")
    said = record["scenarios"]["rect-noise"]
    assert [each["name"] for each in said["controllers"]] == ["flc", "Mine"]
    assert said["controllers"][1]["parameters"] == {"share": 0.75}
    files = [said["plant"], said["robot"], said["controllers"][1], *record["modules"]]
    names = ["toy.py", "robot.toml", "mine.py", "modules/shared/gains.py"]
    assert [each["file"] for each in files] == [f"sources/{name}" for name in names]
    for each in files:
        assert sha256((made / each["file"]).read_bytes()).hexdigest() == each["sha256"]
    assert (made / "sources/mine.py").read_text() == MINE
    assert {"python", "mujoco", "numpy", "scipy", "rerun-sdk", "click"} <= set(record["versions"])
    assert set(record["source"]) == {"omni_mj", "omni_control", "models"}
    assert record["machine"]["CPU"]
    assert record["command"].startswith("omni-mj run --scenario rect-noise --set 'reference.waypoints=")
    for text in (os.path.expanduser("~"), os.uname().nodename, sys.prefix, str(Path.cwd())):
        assert text not in (made / "provenance.json").read_text()


def test_it_repeats_from_another_folder_without_the_users_files(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(made.rglob("*"))
    monkeypatch.chdir(tmp_path)
    assert invoke("verify", made) == 0
    rows, frames = 4, pq.read_table(made / "trajectory.parquet").num_rows
    assert capsys.readouterr() == (f"repeats: {rows} rows, {frames} frames identical bit for bit\n", "")
    assert sorted(made.rglob("*")) == before, "it leaves nothing"


def test_a_value_that_differs_is_named_with_frame_and_channel(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By its last bit, in the second seed of Mine; frame and row are found again by counting lines."""
    table = pq.read_table(folder / "trajectory.parquet")
    mine = np.array([str(each) == "Mine" for each in table["controller"]]) & (table["seed"].to_numpy() == 1)
    line = int(np.flatnonzero(mine)[7])
    for name, later in (("command_vy_m_s", 0), ("x_m", 2)):
        values = table[name].to_numpy().copy()
        values[line + later] = np.nextafter(values[line + later], np.inf)
        table = table.set_column(table.column_names.index(name), name, pa.array(values))
    pq.write_table(table, folder / "trajectory.parquet")
    assert invoke("verify", folder) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == f"error: {folder} does not repeat"
    assert lines[1].startswith("error: first in frame 7 (0.117 s) of Mine, seed 1: command_vy_m_s is ")
    assert f"in all, 2 of {table.num_rows} frames differ: " in lines[2]
    assert "command_vy_m_s by up to" in lines[2]
    assert "x_m by up to" in lines[2]
    assert lines[3].startswith("error: versions, source, commit and processor are the run's")


def test_other_sources_than_those_recorded_are_not_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All that is wrong with them is said at once."""
    (folder / "sources/mine.py").write_text(MINE.replace("GAIN *", "2 *"))
    (folder / "sources/modules/shared/gains.py").unlink()
    assert invoke("verify", folder) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert "sources/mine.py, the controller Mine, is not what was run: its SHA-256 was " in first
    assert second.endswith("gains.py, a module that a user's file imports, cannot be read: No such file or directory")


def test_what_is_not_as_it_was_is_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As a note where it decided nothing, and beside what it may have caused."""

    def older(record: Any) -> None:
        record["versions"] |= {"numpy": "1.99.0", "torch": "2.0"}
        record["machine"]["CPU"] = "8086"
        record["source"]["models"] = "0" * 64
        record["git"] = {"commit": "0123456789abcdef", "changed": True}

    edited(folder / "provenance.json", older)
    assert invoke("verify", folder) == 0
    out = capsys.readouterr().out
    says = [
        "numpy was 1.99.0 in the run, is ",
        "torch was 2.0 in the run, is not there here",
        "CPU was 8086 in the run",
    ]
    says += ["the source of models is another than in the run", "was of commit 0123456789ab, changed since, here is "]
    assert all(text in out for text in says), out
    edited(folder / "summary.json", lambda s: s["scenarios"]["rect-noise"]["results"]["flc"].update(effort_m_s2=None))
    assert invoke("verify", folder) == 1
    err = capsys.readouterr().err
    assert "results.flc.effort_m_s2" in err
    assert all(text in err for text in says), err


def test_what_cannot_be_repeated_is_one_line_that_says_why(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def put(name: str, old: str, new: str) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    cases: tuple[tuple[Callable[[], object], str], ...] = (
        (lambda: put("scenario.toml", "delay_frames = 6", "delay_frames = 5"), "another value of radio.delay_frames"),
        (lambda: put("provenance.json", '"format": 1', '"format": 9'), "is of format 9; this version of omni-mj reads"),
        (lambda: put("provenance.json", '"file": "sources/mine.py"', '"file": "../mine.py"'), "outside of sources/"),
        (
            lambda: put("provenance.json", '"study": "run"', '"study": "slip"'),
            "not say what omni-mj slip was asked for",
        ),
        (lambda: put("provenance.json", '"robot": {', '"rob": {'), "does not say what was run: rect-noise missing"),
        (lambda: put("summary.json", '"format": 4', '"format": 2'), "is of format 2"),
        (lambda: (folder / "trajectory.parquet").write_bytes(b"PAR1"), "trajectory.parquet cannot be read"),
        (lambda: (folder / "trajectory.parquet").unlink(), "trajectory.parquet is missing"),
        (lambda: (folder / "scenario.toml").unlink(), "scenario.toml cannot be read"),
        (lambda: (folder / "summary.json").unlink(), "left no summary.json: it was killed"),
        (lambda: (folder / "provenance.json").unlink(), "holds no run"),
    )
    kept = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for spoil, says in cases:
        spoil()
        assert invoke("verify", folder) == 2, says
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.count("\n") == 1, printed.err
        assert says in printed.err
        if says != "left no summary.json: it was killed":
            for path, data in kept.items():
                path.write_bytes(data)


def test_what_numpy_uses_of_the_processor_is_told(folder: Path) -> None:
    """Last bits may depend on it, and users may turn it off, on the same processor."""
    used = strict(folder / "provenance.json")["machine"]["CPU features"]
    if not used:
        pytest.skip("numpy uses nothing of this processor that it could do without")
    asks = "import json, sys; from omni_mj.provenance import here; print(here.differences(json.load(sys.stdin)))"
    env = os.environ | {"NPY_DISABLE_CPU_FEATURES": used.replace(" ", ",")}
    with (folder / "provenance.json").open() as record:
        told = subprocess.run([sys.executable, "-c", asks], stdin=record, env=env, capture_output=True, text=True)
    assert f"CPU features was {used} in the run, is not there here" in told.stdout, told

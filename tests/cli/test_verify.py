"""`omni-mj verify`: runs repeat bit for bit, wherever their folder is, or the reason is named."""

import json
import os
import shutil
import signal
import sys
from collections.abc import Callable
from functools import reduce
from hashlib import sha256
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import BARE, SHORT, invoke, run_python, strict
from own_robot import MESH, written

import omni_mj as om

MINE = '''
import omni_mj as om


class Mine(om.Controller):
    """Proportional control, with a parameter."""

    share: float = 1.0

    def command(self, frame, observation):
        target, feedforward = self.reference.at(frame, observation.pose)
        return feedforward + 4.0 * self.share * (target - observation.pose)
'''
TOY = """
import numpy as np

from omni_mj.plants.telemetry import Telemetry


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
        return Telemetry.without_wheels(len(self._pose), 4)
"""
ODD = """
import os
import signal
from pathlib import Path

import numpy as np

import omni_mj as om


class Dice(om.Controller):
    def command(self, frame, observation):
        # Less than the change that the limits allow.
        return 0 * observation.pose + (1e-3 * np.random.default_rng().random() if frame > 4 else 0)


class Stopped(om.Controller):
    def command(self, frame, observation):
        if frame == 20 and Path("press").exists():
            os.kill(os.getpid(), signal.SIGINT)
        return 0 * observation.pose
"""
MATERIALS = '<mujoco><asset><mesh name="cover" file="cover.obj"/></asset></mujoco>'


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run a user's controller, plant and robot, delete their files, and return the run's folder."""
    source_folder = tmp_path_factory.mktemp("there")
    (source_folder / "mine.py").write_text(MINE)
    (source_folder / "toy.py").write_text(TOY)
    text = (
        om.load_robot("tigers-v2016").path.read_text().replace("arm_m = ", "arm_m = 0.09 # was ", 1)
    )
    (source_folder / "robot.toml").write_text(text)
    own = "--plant toy.py:Toy --robot robot.toml --controller flc --controller mine.py:Mine"
    more = "--set controller.Mine.share=0.75 --seeds 2 --out out"
    command = "-m omni_mj run --scenario rect-noise"
    done = run_python(command, SHORT, own, more, BARE, cwd=source_folder)
    assert (done.returncode, done.stderr) == (0, "")
    folder = tmp_path_factory.mktemp("elsewhere") / "moved"
    shutil.move(source_folder / "out", folder)
    shutil.rmtree(source_folder)
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """Return a copy of that folder, for tests that change it."""
    return shutil.copytree(made, tmp_path / "copy")


def edited(file: Path, change: Callable[[Any], object]) -> None:
    """Change the content of a JSON file."""
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def test_a_run_repeats_from_its_folder_without_the_users_files(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """provenance.json contains no path, except for those in the command line."""
    record = strict(made / "provenance.json")
    description = record["scenarios"]["rect-noise"]
    assert description["controllers"][1]["parameters"] == {"share": 0.75}
    files = [description["plant"], description["robot"], description["controllers"][1]]
    names = ["toy.py", "robot.toml", "mine.py"]
    assert [copy["file"] for copy in files] == [f"sources/{name}" for name in names]
    for copy in files:
        assert sha256((made / copy["file"]).read_bytes()).hexdigest() == copy["sha256"]
    assert {"python", "mujoco", "numpy", "scipy", "rerun-sdk"} <= set(record["versions"])
    assert len(record["source"]) == 64
    assert record["machine"]["CPU"]
    for text in (os.path.expanduser("~"), os.uname().nodename, sys.prefix, str(Path.cwd())):
        assert text not in (made / "provenance.json").read_text()
    previous = sorted(made.rglob("*"))
    monkeypatch.chdir(tmp_path)
    assert invoke("verify", made, "--allow-code") == 0
    frames = pq.read_table(made / "trajectory.parquet").num_rows
    assert capsys.readouterr() == (f"repeats: 4 rows, {frames} frames identical bit for bit\n", "")
    assert sorted(made.rglob("*")) == previous, "it leaves nothing"


def test_a_value_that_differs_is_named_with_frame_and_channel(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Change last bits in the second seed of Mine."""
    frames = pq.read_table(folder / "trajectory.parquet")
    mine = np.array([str(name) == "Mine" for name in frames["controller"]]) & (
        frames["seed"].to_numpy() == 1
    )
    line = int(np.flatnonzero(mine)[7])
    for name, offset in (("command_vy_m_s", 0), ("x_m", 2)):
        values = frames[name].to_numpy().copy()
        values[line + offset] = np.nextafter(values[line + offset], np.inf)
        frames = frames.set_column(frames.column_names.index(name), name, pa.array(values))
    pq.write_table(frames, folder / "trajectory.parquet")
    assert invoke("verify", folder, "--allow-code") == 1
    lines = capsys.readouterr().err.splitlines()
    assert "first in frame 7, controller Mine, seed 1, slot 0: command_vy_m_s is " in lines[1]
    assert lines[1].endswith("2 different channels")


def replace_column(name: str, column: pa.Array) -> Callable[[pa.Table], pa.Table]:
    return lambda frames: frames.set_column(frames.column_names.index(name), name, column)


def test_frames_of_other_lengths_types_or_signs_differ(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = folder / "trajectory.parquet"
    frames = pq.read_table(file)
    zeros = frames["ref_x_m"].to_numpy().copy()
    assert zeros[0] == 0.0
    zeros[0] *= -1.0
    numbers = frames["frame"].cast("float64")
    cases: tuple[tuple[Callable[[pa.Table], pa.Table], str], ...] = (
        (lambda saved: saved.slice(0, saved.num_rows - 1), f"{frames.num_rows - 1} lines, its"),
        (
            lambda saved: pa.concat_tables([saved, saved.slice(0, 1)]),
            f"{frames.num_rows + 1} lines",
        ),
        (replace_column("x_m", frames["x_m"].cast("float32")), "x_m has the type float in the run"),
        (replace_column("frame", numbers), "frame has the type double in the run"),
        (lambda saved: saved.append_column("more", numbers), "repetition has no column more"),
        (replace_column("ref_x_m", pa.array(zeros)), "ref_x_m is -0.0 in the run, 0.0 here"),
    )
    for change, expected_difference in cases:
        pq.write_table(change(frames), file)
        assert invoke("verify", folder, "--allow-code") == 1
        assert expected_difference in capsys.readouterr().err


def test_numbers_of_other_types_or_signs_differ(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Even if the frames are the same."""
    file = folder / "summary.json"
    text = file.read_text()
    n_failed = '"n_failed": 0'
    assert text.count(n_failed) == 2
    for number in ("-0.0", "false", "null"):
        file.write_text(text.replace(n_failed, f'"n_failed": {number}', 1))
        assert invoke("verify", folder, "--allow-code") == 1
        err = capsys.readouterr().err
        assert f"results.flc.n_failed is {number} in the run, 0 here; 1 different number" in err


def test_changes_of_the_environment_are_reported(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are notes if the run repeats."""

    def older(record: Any) -> None:
        record["versions"] |= {"numpy": "1.99.0", "torch": "2.0"}
        record["machine"] |= {"CPU": "8086", "BLAS": "mkl"}
        record["git"] = "0123456789abcdef-dirty"

    edited(folder / "provenance.json", older)
    assert invoke("verify", folder, "--allow-code") == 0
    out = capsys.readouterr().out
    for text in (
        "numpy was 1.99.0 in the run",
        "CPU was 8086",
        "BLAS was mkl",
        "git was 0123456789abcdef-dirty",
    ):
        assert text in out


def test_runs_that_cannot_be_repeated_give_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    provenance, scenario, lost = "provenance.json", "scenario.toml", "is missing, or was changed"
    changes = (
        ("sources/mine.py", "4.0 *", "2 *", f"sources/mine.py {lost} after the run"),
        (provenance, '"format": 4', '"format": 9', "has format 9"),
        (provenance, '"study": "run"', '"study": "slip"', "repeat the study: omni-mj run"),
        (provenance, '"robot": {', '"rob": {', "were changed after the run"),
        (provenance, '"sources/mine.py"', '"sources/../../mine.py"', "which is not in sources/"),
        (provenance, '"sources/robot.toml"', '"scenario.toml"', "which is not in sources/"),
        (scenario, "\nfriction = ", "\nfriction = 1", "carpet.friction was "),
        (scenario, "dwell_s = 0.0", "dwell_s = -0.0", "dwell_s was 0.0 in the run, is -0."),
        (scenario, "dwell_s = 0.0", "dwell_s = 0", "dwell_s was 0.0 in the run, is 0 h"),
        (scenario, "[carpet]", "[carpet]\nadded = 1", "carpet.added was absent"),
        (scenario, "seed = 0", "seed = 0\nadded = 1", "added was absent"),
        (scenario, "settle_s = ", "settle_s = -", "reference.settle_s was 0.1"),
        ("sources/mine.py", "", None, f"sources/mine.py {lost} after the run"),
        ("trajectory.parquet", "", None, "trajectory.parquet cannot be read"),
        (scenario, "", None, "scenario.toml"),
        ("summary.json", "", None, "has no summary.json"),
        (provenance, "", None, "it has no provenance.json"),
    )
    contents = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for name, old, new, expected_error in changes:
        for path, data in contents.items():
            path.write_bytes(data)
        file = folder / name
        if new is None:
            file.unlink()
        else:
            assert old in file.read_text()
            file.write_text(file.read_text().replace(old, new, 1))
        assert invoke("verify", folder, "--allow-code") == 2, expected_error
        printed = capsys.readouterr()
        assert printed.out == ""
        assert expected_error in printed.err


def test_a_stopped_run_repeats_up_to_its_end_and_unseeded_noise_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C stops the run in frame 20, and not its repetition."""
    previous = signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a background job's would be ignored
    (tmp_path / "odd.py").write_text(ODD)
    (tmp_path / "press").touch()
    monkeypatch.chdir(tmp_path)
    run = f"run --scenario rect --plant kinematic {BARE} --controller"
    assert invoke(run, "odd.py:Stopped --controller flc --out stopped") == 130
    signal.signal(signal.SIGINT, previous)
    (tmp_path / "press").unlink()
    capsys.readouterr()
    assert invoke("verify stopped --allow-code") == 0
    assert capsys.readouterr().out == "repeats: 2 rows, 42 frames identical bit for bit\n"
    assert invoke(run, "odd.py:Dice", SHORT, "--out chance") == 0
    assert invoke("verify chance --allow-code") == 1
    lines = capsys.readouterr().err.splitlines()
    assert "first in frame 5, controller Dice, seed 0, slot 0: command_vx_m_s is " in lines[1]
    assert "random numbers without a seed" in lines[-1]


def test_a_comparison_repeats(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The frames of each scenario are compared, or else the summary's numbers."""
    out = tmp_path / "out"
    words = f"compare --plant kinematic --scenario rect --scenario rect-noise {SHORT}"
    assert invoke(words, "--controller flc --seeds 6 --quiet --trajectories --out", out) == 0
    entries = strict(out / "summary.json")["scenarios"].values()
    rows, frames = (
        sum(len(e["seeds"]) * (e["frames"] if per_frame else 1) for e in entries)
        for per_frame in (False, True)
    )
    assert invoke("verify", out) == 0
    assert (
        capsys.readouterr().out == f"repeats: {rows} rows, {frames} frames identical bit for bit\n"
    )
    shutil.rmtree(out / "trajectories")
    edited(out / "provenance.json", lambda record: record.update(frames_saved=False))
    assert invoke("verify", out) == 0
    assert capsys.readouterr().out == f"repeats: {rows} rows, the summary's numbers identical\n"
    edited(
        out / "summary.json",
        lambda s: s["scenarios"]["rect"]["results"]["flc"].update(effort_m_s2=None),
    )
    assert invoke("verify", out) == 1
    assert (
        "summary.json: scenarios.rect.results.flc.effort_m_s2 is null in the run"
        in capsys.readouterr().err
    )


def model(folder: Path) -> Path:
    """Write a model with a mesh in another folder and an included file; return its path."""
    more = '<geom type="mesh" mesh="cover" mass="0.01" pos="0 0 0.1"/>'
    text = written((60, 180, 300), more=more).replace(
        "<compiler ", '<include file="parts/materials.xml"/><compiler meshdir="meshes" '
    )
    for name, content in (
        ("robot/meshes/cover.obj", MESH),
        ("robot/parts/materials.xml", MATERIALS),
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
    file = folder / "robot" / "mine.xml"
    file.write_text(text)
    return file


def test_a_users_model_is_copied_with_all_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All three files of the model are copied."""
    source_folder, moved_folder = tmp_path / "there", tmp_path / "elsewhere"
    contents = {
        path.name: path.read_bytes() for path in (model(source_folder), *source_folder.rglob("*.*"))
    }
    words = f"run --scenario rect {SHORT} --controller comp-flc {BARE} --out out"
    monkeypatch.chdir(source_folder)
    assert invoke(words, "--model robot/mine.xml") == 0
    monkeypatch.chdir(tmp_path)
    shutil.move(source_folder / "out", moved_folder)
    shutil.rmtree(source_folder)
    description = strict(moved_folder / "provenance.json")["scenarios"]["rect"]["models"][0]
    for copy in [description, *description["included"]]:
        assert (moved_folder / copy["file"]).read_bytes() == contents.pop(Path(copy["file"]).name)
    assert not contents
    capsys.readouterr()
    assert invoke("verify", moved_folder) == 0
    assert capsys.readouterr().out.startswith("repeats: 1 row, ")
    for file, content in ((description["file"], None), (description["included"][0]["file"], b"")):
        copy = moved_folder / file
        copy.write_bytes(copy.read_bytes() + b"<!-- -->" if content is None else content)
        assert invoke("verify", moved_folder) == 2
        assert f"{copy} is missing, or was changed after the run" in capsys.readouterr().err


UNREPEATABLE = ("started", "command", "created", "wall_s", "repeat_command")
FOLDERS = {  # study -> its options, files that are changed, and changes of each file
    "run": (
        "--scenario rect-noise --controller mine.py:Mine --no-record --no-figures",
        ["provenance.json", "summary.json", "trajectory.parquet"],
        10,
    ),
    "compare": (
        "--scenario rect --scenario rect-noise --controller flc --controller p --subject p "
        "--seeds 1 --trajectories",
        ["provenance.json", "summary.json", "trajectories/rect.parquet"],
        5,
    ),
    "sweep": (
        "--scenario rect --controller p --vary radio.delay_frames=0,2",
        ["provenance.json", "sweep.json", "summary.json", "rows.parquet"],
        10,
    ),
}
STEP = "--set reference.waypoints=[[0, 0], [0.01, 0]] --set reference.settle_s=0.1"


def list_places(value: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the keys and indices that lead to each value in a JSON value."""
    items: Any = enumerate(value) if isinstance(value, list) else ()
    items = value.items() if isinstance(value, dict) else items
    return [place, *(more for key, item in items for more in list_places(item, (*place, key)))]


def other_value(value: Any) -> Any:
    """Return another value of the same type, or a container with one more value."""
    if isinstance(value, dict):
        return value | {"added": 1}
    if isinstance(value, list):
        return [*value, value[-1] if value else 1]
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + "x"
    return 7.5 if value is None or value != value else value + 1


def list_json_changes(file: Path) -> list[tuple[object, str]]:
    """Return the names and texts of a JSON file with each value removed, changed or extended."""
    changes: list[tuple[object, str]] = []
    for place in list_places(json.loads(file.read_text()))[1:]:
        for is_removed in (True, False):
            content = json.loads(file.read_text())
            parent = reduce(getitem, place[:-1], content)
            if is_removed:
                del parent[place[-1]]
            else:
                parent[place[-1]] = other_value(parent[place[-1]])
            if is_removed or place[-1] not in UNREPEATABLE:
                changes.append(((place, is_removed), json.dumps(content)))
    return changes


def list_table_changes(file: Path) -> list[tuple[object, pa.Table]]:
    """Return a table without each column, with another value in it, and with a further one."""
    table = pq.read_table(file)
    changes: list[tuple[object, pa.Table]] = []
    for i, name in enumerate(table.column_names):
        values = table[name].to_pylist()
        values[1] = other_value(values[1])
        kind = pa.string() if isinstance(values[1], str) else table[name].type
        changes += [
            (name, table.drop_columns(name)),
            (name, table.set_column(i, name, pa.array(values).cast(kind))),
            (name, table.append_column(name + "x", table[name])),
        ]
    return changes


@pytest.mark.parametrize("study", FOLDERS)
def test_any_single_change_of_what_a_study_wrote_is_noticed(
    study: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some of all changes of a file, at equal distances in it; of a run, all at the top level."""
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(MINE)
    options, files, n_changes = FOLDERS[study]
    assert invoke(study, options, "--plant kinematic", STEP, "--quiet --out out") == 0

    def is_noticed() -> bool:
        try:
            verified = om.verify("out", allow_code=True)
        except om.OmniError:
            return True
        return bool(verified.differences or verified.remarks)

    assert not is_noticed()
    for name in files:
        file = Path("out") / name
        data = file.read_bytes()
        is_table = file.suffix == ".parquet"
        changes: Any = list_table_changes(file) if is_table else list_json_changes(file)
        chosen = changes[:: 1 + len(changes) // n_changes]
        if study == "run" and not is_table:
            chosen += [change for change in changes if len(change[0][0]) == 1 and not change[0][1]]
        for place, content in chosen:
            if is_table:
                pq.write_table(content, file)
            else:
                file.write_text(content)
            assert is_noticed(), (name, place)
        file.write_bytes(data)


PROGRAM = """
from mine import Mine

import omni_mj as om


class Here(Mine):
    pass


reference = {"waypoints": [[0, 0], [0.2, 0.1]], "settle_s": 0.1}
short = om.load_scenario("rect", plant="kinematic", reference=reference)
om.run(short, ["flc", Mine], seeds=range(2)).save("good")
om.run(short, [Here]).save("bad")
"""


def test_results_from_python_repeat_or_say_what_is_missing(tmp_path: Path) -> None:
    """Mine is copied with its module; Here is in the program itself; exec has no file."""
    source_folder = tmp_path / "there"
    source_folder.mkdir()
    (source_folder / "mine.py").write_text(MINE)
    (source_folder / "program.py").write_text(PROGRAM)
    run_python("program.py", cwd=source_folder, check=True)
    for name in ("good", "bad"):
        shutil.move(source_folder / name, tmp_path / name)
    shutil.rmtree(source_folder)
    assert strict(tmp_path / "good" / "provenance.json")["command"] is None
    verified = om.verify(tmp_path / "good", allow_code=True)
    assert (verified.repeats, verified.rows) == (True, 4)
    assert str(verified).startswith(
        f"repeats: 4 rows, {verified.frames} frames identical bit for bit"
    )
    with pytest.raises(om.OmniError, match=r"^Here is not defined at the top level of a file"):
        om.verify(str(tmp_path / "bad"))
    short = om.load_scenario(
        "rect", plant="kinematic", reference={"waypoints": [[0, 0], [0.2, 0.1]], "settle_s": 0.1}
    )
    om.compare([short, short.replace(name="again")], ["flc", "p"], seeds=2).save(tmp_path / "both")
    assert om.verify(tmp_path / "both").repeats
    names: dict[str, type] = {"__name__": "nowhere"}  # type: ignore[dict-item]
    exec(MINE, names)
    om.run(short, [names["Mine"]]).save(tmp_path / "none")
    with pytest.raises(om.OmniError, match=r"^Mine is not defined at the top level of a file"):
        om.verify(tmp_path / "none")

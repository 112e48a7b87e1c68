"""Sweeps record what they are made of, as runs do; they are never continued with other things."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from benches import studies as bench
from commands import appears, invoke, run_python, split_words, strict
from own_robot import written

import omni_mj as om

MINE = """
import omni_mj as om


class Mine(om.Controller):
    def command(self, frame, observation):
        target, feedforward = self.reference.at(frame, observation.pose)
        return feedforward + 3.0 * (target - observation.pose)
"""
PARTS = "<mujoco><asset/></mujoco>"
SWEEP = (
    "sweep --scenario rect --plant kinematic --controller mine.py:Mine --robot robot.toml "
    "--model body.xml --vary radio.delay_frames=0,4 --seeds 2 --batch-size 2 "
    "--set reference.waypoints=[[0,0],[0.2,0.1]] --set reference.settle_s=0.1 --quiet --out out"
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run a sweep of a user's controller, robot and model, and return the folder of all files."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run_sweep_of_own_files()
    return folder


@pytest.fixture
def copied_sweep(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Change to a copy of that folder."""
    shutil.copytree(made, tmp_path / "copy")
    monkeypatch.chdir(tmp_path / "copy")


def run_sweep_of_own_files() -> None:
    Path("mine.py").write_text(MINE)
    Path("parts.xml").write_text(PARTS)
    model = written((60, 180, 300)).replace("<compiler ", '<include file="parts.xml"/><compiler ')
    Path("body.xml").write_text(model)
    Path("robot.toml").write_text(om.load_robot("tigers-v2016").path.read_text())
    assert invoke(SWEEP) == 0


def change_record(*keys: str) -> Callable[[], None]:
    """Return a function that changes a value in provenance.json."""

    def change() -> None:
        file = Path("out/provenance.json")
        content = json.loads(file.read_text())
        values: Any = content
        for key in keys[:-1]:
            values = values[key]
        values[keys[-1]] = "another"
        file.write_text(json.dumps(content))

    return change


def change_file(name: str) -> Callable[[], None]:
    """Return a function that changes a file without any effect on the settings."""
    comment = "<!-- changed -->" if name.endswith(".xml") else "# changed\n"
    return lambda: Path(name).write_text(Path(name).read_text() + comment)


def test_a_sweep_is_continued_only_if_nothing_has_changed(
    copied_sweep: None, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [path for path in Path().rglob("*") if path.is_file()]
    contents = {path: path.read_bytes() for path in files}
    cases = (
        (change_file("mine.py"), "controllers.0.sha256"),
        (change_file("robot.toml"), "robot.sha256"),
        (change_file("body.xml"), "models.0.sha256"),
        (change_file("parts.xml"), "models.0.included.0.sha256"),
        (change_record("versions", "numpy"), "numpy was another in the run"),
        (change_record("versions", "torch"), "torch was another in the run, is absent here"),
        (change_record("source"), "source was another"),
        (change_record("machine", "CPU"), "CPU was another"),
        (change_record("machine", "sample results"), "sample results was another"),
        (Path("out/provenance.json").unlink, "provenance.json cannot be read"),
    )
    for change, expected_error in cases:
        change()
        assert invoke(SWEEP) == 2
        err = capsys.readouterr().err
        assert expected_error in err
        assert err.count("\n") <= 2
        assert Path("out/rows.parquet").read_bytes() == contents[Path("out/rows.parquet")]
        for path, data in contents.items():
            if not path.exists() or path.read_bytes() != data:
                path.write_bytes(data)
    change_record("git")()
    assert invoke(SWEEP) == 0, "a commit with the same source changes nothing"


def test_a_sweep_is_not_continued_with_other_arithmetic(copied_sweep: None) -> None:
    """Of the same processor: these variables choose its oldest instructions."""
    _, features = strict(Path("out/provenance.json"))["machine"]["SIMD"].split(maxsplit=1)
    other = {"OPENBLAS_CORETYPE": "Nehalem", "NPY_DISABLE_CPU_FEATURES": features}
    done = run_python("-m omni_mj", SWEEP, env=os.environ | other)
    assert done.returncode == 2
    for name in ("SIMD", "BLAS", "sample results"):
        assert f"error: machine.{name} was " in done.stderr


def test_stored_rows_of_other_runs_are_found(tmp_path: Path) -> None:
    """A shard's file that was copied, renamed or swapped, or is one of another sweep."""

    def sweep(folder: Path, length_m: float, n_shards: int) -> bench.SweepResult:
        def after_frame(frame: int) -> None:
            if len([*folder.glob("shards/*.parquet")]) == n_shards:
                raise bench.StoppedError("enough")

        reference = {"waypoints": [[0, 0], [length_m, 0]], "settle_s": 0.1}
        rect = om.load_scenario("rect", plant="kinematic", reference=reference)
        vary = {"radio.delay_frames": [0, 2, 4]}
        options = {"batch_size": 1, "start_progress": lambda title, n_frames: after_frame}
        return om.sweep(rect, vary, ["p"], out=folder, **options)

    sweep(tmp_path / "other", 0.2, 9)
    sweep(tmp_path / "stopped", 0.1, 2)
    other_rows = tmp_path / "other" / "rows.parquet"

    def swap(shards: Path) -> None:
        (shards / "000000.parquet").rename(shards / "swapped")
        (shards / "000001.parquet").rename(shards / "000000.parquet")
        (shards / "swapped").rename(shards / "000001.parquet")

    cases: tuple[Callable[[Path], object], ...] = (
        swap,
        lambda shards: shutil.copy(shards / "000000.parquet", shards / "000001.parquet"),
        lambda shards: shutil.copy(shards / "000000.parquet", shards / "000002.parquet"),
        lambda shards: (shards / "000000.parquet").rename(shards / "000007.parquet"),
        lambda shards: shutil.copy(other_rows, shards / "000002.parquet"),
        lambda shards: shutil.copy(other_rows, shards.parent / "rows.parquet"),
    )
    for i, change in enumerate(cases):
        folder = shutil.copytree(tmp_path / "stopped", tmp_path / f"changed-{i}")
        change(folder / "shards")
        with pytest.raises(om.OmniError, match=r"parquet holds rows of other runs, or of another"):
            sweep(folder, 0.1, 9)
    assert sweep(tmp_path / "stopped", 0.1, 9).complete


def test_a_sweep_from_python_is_continued_by_the_same_rules(tmp_path: Path) -> None:
    """A file that changes during the sweep ends it, and the shards of both are never mixed."""
    mine = tmp_path / "mine.py"
    mine.write_text(MINE)
    folder = tmp_path / "out"

    def sweep(start_progress: Any = bench.no_progress) -> bench.SweepResult:
        scenario = om.load_scenario(
            "rect",
            plant="kinematic",
            reference={"waypoints": [[0, 0], [0.1, 0]], "settle_s": 0.1},
        )
        vary = {"radio.delay_frames": [0, 2, 4]}
        name = f"{mine}:Mine"
        return om.sweep(
            scenario, vary, [name], batch_size=1, out=folder, start_progress=start_progress
        )

    def change_after_a_shard(title: str, n_frames: int) -> Callable[[int], None]:
        def after_frame(frame: int) -> None:
            if (folder / "shards/000000.parquet").exists():
                mine.write_text(MINE.replace("3.0", "2.0"))

        return after_frame

    with pytest.raises(om.OmniError, match="changed during the sweep"):
        sweep(change_after_a_shard)
    assert len([*folder.glob("shards/*")]) == 1
    with pytest.raises(om.OmniError, match=r"controllers\.0\.sha256 was"):
        sweep()
    mine.write_text(MINE)
    assert sweep().complete
    assert om.verify(folder, allow_code=True).repeats


def test_a_sweep_repeats_and_changed_rows_are_named(
    copied_sweep: None, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("mine.py", "robot.toml", "body.xml", "parts.xml"):
        Path(name).unlink()
    assert invoke("verify out") == 2
    assert "not run without permission" in capsys.readouterr().err
    assert invoke("verify out --allow-code") == 0
    assert capsys.readouterr().out == "repeats: 4 rows, identical bit for bit\n"
    rows = pq.read_table("out/rows.parquet")
    column = rows.column_names.index("position_max_m")
    values = rows["position_max_m"].to_pylist()
    values[2] *= 1 + 2e-16
    changed_rows = rows.set_column(column, "position_max_m", pa.array(values))
    pq.write_table(changed_rows, "out/rows.parquet")
    assert invoke("verify out --allow-code") == 1
    assert "first in point 1, controller Mine, seed 0, slot 0: " in capsys.readouterr().err


def test_a_sweep_over_models_records_each_of_them(copied_sweep: None) -> None:
    Path("other.xml").write_text(Path("body.xml").read_text() + "<!-- other -->")
    sweep = SWEEP.replace(" --model body.xml", "").removesuffix("out")
    sweep = sweep.replace("radio.delay_frames=0,4", 'model.file="body.xml","other.xml"')
    assert invoke(sweep, "models") == 0
    change_file("other.xml")()
    assert invoke(sweep, "models") == 2
    assert om.verify("models", allow_code=True).repeats


def test_a_sweep_runs_no_code_that_only_a_folder_names(
    copied_sweep: None, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep = "sweep --scenario out/scenario.toml --vary radio.delay_frames=0,4 --quiet --out again"
    assert invoke(sweep) == 2
    assert "without permission" in capsys.readouterr().err
    assert invoke(sweep, "--allow-code") == 0


def list_children(parent: int) -> set[int]:
    files = Path(f"/proc/{parent}/task").glob("*/children")  # of each thread
    return {int(process) for file in files for process in file.read_text().split()}


def is_running(process: int) -> bool:
    """Return whether a process exists and is no zombie."""
    try:
        return ") Z" not in Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False


def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    """However it is killed, and with one line even if Ctrl-C reaches them while they start."""
    command = [sys.executable, *split_words(
        "-m omni_mj sweep --scenario rect --plant kinematic --controller p --quiet --batch-size 1 "
        "--set reference.laps=1000 --vary radio.delay_frames=0,4 --jobs 2 --out"
    )]  # fmt: skip
    for number in (signal.SIGINT, signal.SIGKILL, signal.SIGTERM):
        parent = subprocess.Popen(
            [*command, tmp_path / number.name],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        deadline = time.monotonic() + 60
        while len(list_children(parent.pid)) < 3 and time.monotonic() < deadline:
            time.sleep(0.05)
        workers = list_children(parent.pid)  # two, and a tracker of resources
        assert len(workers) == 3
        if number == signal.SIGKILL:
            parent.kill()
            parent.wait()
        else:
            os.killpg(parent.pid, number)
            _, err = parent.communicate(timeout=60)
            assert (parent.returncode, err.count("\n")) == (128 + number, 1), err
        while any(map(is_running, workers)) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not any(map(is_running, workers))


def test_two_programs_never_write_to_one_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """If the folder is deleted and made again, the first run writes nothing to the new one."""
    out = tmp_path / "out"
    rect = "--scenario rect --plant kinematic --quiet"
    run = f"run {rect} --no-figures"
    command = split_words("-m omni_mj", run, "--controller p --set reference.laps=1000 --out", out)
    running = subprocess.Popen([sys.executable, *command], stderr=subprocess.PIPE, text=True)
    assert appears(out / "scenario.toml")
    result = om.run(om.load_scenario("rect", plant="kinematic"), ["p"])
    for call in (
        lambda: invoke(run, "--overwrite --out", out),
        lambda: invoke("compare", rect, "--overwrite --out", out),
        lambda: result.save(out),
        lambda: om.sweep("rect", {"radio.delay_frames": [0, 4]}, ["p"], out=out),
    ):
        try:
            assert call() == 2
            err = capsys.readouterr().err
        except om.OmniError as error:
            err = f"{error}\n"
        assert "another run is writing its results to" in err
        assert err.count("\n") == 1
    out.rename(tmp_path / "moved")
    result.save(out)
    contents = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    running.send_signal(signal.SIGTERM)
    _, err = running.communicate(timeout=60)
    assert "was deleted or replaced while results were written to it" in err
    assert (running.returncode, err.count("\n")) == (2, 1)
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == contents
    assert strict(out / "summary.json")["complete"]
    assert invoke("compare", rect, "--controller p --overwrite --out", out) == 2
    assert "holds results of omni-mj run" in capsys.readouterr().err

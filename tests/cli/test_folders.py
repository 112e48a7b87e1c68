"""Folders for results: what is in them belongs to whoever put it there."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from commands import invoke, strict
from PIL import Image

from omni_mj.show.film import writing
from omni_mj.show.film.reel import Reel
from omni_mj.studies import sweep
from omni_mj.studies.identify import tables

SHORT = ("--set", "reference.waypoints=[[0, 0], [0.1, 0]]", "--set", "reference.settle_s=0.1", "--plant", "kinematic")
RUN = ("run", "--scenario", "rect", *SHORT, "--controller", "flc", "--no-record", "--quiet", "--out")


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    "mark", [None, "", "[1]", '{"format": 1}', "{" * 100_000, '{"provenance": true, "scenarios": {}}']
)
def test_a_folder_that_no_run_left_is_never_overwritten(
    tmp_path: Path, mark: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever its files are called, also if one is called as the one by which folders of runs are known."""
    (tmp_path / "figures").mkdir()
    for name in ("summary.json", "report.html", "figures/path.png", "figures/holiday.png"):
        (tmp_path / name).write_text("precious")
    if mark is not None:
        (tmp_path / "provenance.json").write_text(mark)
    before = contents(tmp_path)
    assert invoke(*RUN, tmp_path, "--overwrite") == 2
    err = capsys.readouterr().err
    assert "was not left by a run" in err
    assert err.count("\n") == 1
    assert contents(tmp_path) == before


def test_overwriting_removes_what_the_run_left_and_nothing_else(tmp_path: Path) -> None:
    """Also from folders that are the run's; what it left and the next does not is gone."""
    (tmp_path / "mine.py").write_text(
        "import omni_mj as om\n\n\nclass Mine(om.Controller):\n    def command(self, frame, seen):\n"
        "        return 0 * seen.pose\n"
    )
    out = tmp_path / "out"
    assert invoke(*RUN, out, "--controller", f"{tmp_path / 'mine.py'}:Mine") == 0
    ours = set(contents(out))
    assert {"figures/path.png", "sources/mine.py", "report.html"} <= ours
    precious = {"notes.txt", "figures/holiday.png", "sources/other.py", "summary.json.bak", "old/summary.json"}
    (out / "old").mkdir()
    for name in precious:
        (out / name).write_text("precious")
    (out / "trajectory.parquet.partial").write_text("of a run that was killed")
    assert invoke(*RUN, out, "--no-figures", "--overwrite") == 0
    left = contents(out)
    assert {name: left[name] for name in precious} == dict.fromkeys(precious, b"precious")
    assert set(left) - precious == {name for name in ours if not name.startswith("figures/")} - {"sources/mine.py"}


def test_only_what_is_checked_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bad input leaves the earlier run as it was; so does a folder that leads elsewhere."""
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    assert invoke(*RUN, out) == 0
    before = contents(out)
    for wrong in (("--set", "radio.delay=3"), ("--controller", "fcl"), ("--connect", "nowhere")):
        assert invoke(*RUN, out, "--overwrite", *wrong) == 2
        assert contents(out) == before
    (out / "figures").rename(elsewhere)
    (out / "figures").symlink_to(elsewhere)
    capsys.readouterr()
    assert invoke(*RUN, out, "--overwrite") == 2
    assert "figures is a link" in capsys.readouterr().err
    assert {f"figures/{name}" for name in contents(elsewhere)} == {n for n in before if n.startswith("figures/")}


def test_a_record_that_names_other_files_removes_none(tmp_path: Path) -> None:
    """Whoever writes the record, what it names outside of the folder of sources stays."""
    out = tmp_path / "out"
    assert invoke(*RUN, out, "--no-figures") == 0
    (tmp_path / "precious.py").write_text("precious")
    (out / "sources" / "link").symlink_to(tmp_path)
    places = ("../precious.py", "sources/../../precious.py", str(tmp_path / "precious.py"), "sources/link/precious.py")
    record = strict(out / "provenance.json")
    record["modules"] = [{"file": place, "sha256": ""} for place in places]
    (out / "provenance.json").write_text(json.dumps(record))
    assert invoke(*RUN, out, "--no-figures", "--overwrite") == 0
    assert (tmp_path / "precious.py").read_text() == "precious"


@pytest.mark.parametrize("name", ["a:b", "hdfs:x", "file:x", "s3:", "C:", "%2e", "a b", "ü\u2028"])
def test_a_folder_of_any_name_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """None is taken for an address; what is in it reads back and repeats."""
    monkeypatch.chdir(tmp_path)
    assert invoke(*RUN, name, "--no-figures") == 0
    assert {"summary.json", "trajectory.parquet", "report.html"} <= {path.name for path in Path(name).iterdir()}
    assert invoke("verify", name, "--quiet") == 0


def test_every_library_takes_such_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For a path, not for an address: tables, films, sweeps, what serve records, and logs."""
    monkeypatch.chdir(tmp_path)
    folder = Path("hdfs:x")
    assert invoke(*RUN, folder, "--no-figures") == 0
    assert len(Reel.of(folder).takes) == 1
    for kind in writing.KINDS:
        writing.write([Image.new("RGB", (64, 64), colour) for colour in ("red", "blue")], folder / f"film{kind}", 15)
        assert (folder / f"film{kind}").stat().st_size > 0

    varied = ("--scenario", "rect", *SHORT, "--controller", "flc", "--vary", "carpet.friction=0.3,0.5")
    assert invoke("sweep", *varied, "--quiet", "--out", folder / "sweep") == 0
    assert sweep.resume(folder / "sweep").rows().num_rows == 2

    ports = [word for port in ("control", "blue", "yellow") for word in (f"--{port}-port", 0)]
    served = ("serve", *ports, "--speed", 100, "--for", 0.1, "--no-record", "--quiet")
    assert invoke(*served, "--set", "physics.kernel=numpy", "--out", folder / "served") == 0
    assert pq.read_table((folder / "served" / "trajectory.parquet").open("rb")).num_rows == 6

    assert "x_m" in tables.read(folder / "trajectory.parquet")

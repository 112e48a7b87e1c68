"""A run of a user's model says what it ran, with all files of it, and repeats elsewhere."""

import shutil
from hashlib import sha256
from pathlib import Path

import pytest
from commands import invoke, strict
from own_robot import written

SHORT = ("--set", "reference.waypoints=[[0, 0, 0], [0.1, 0.05, 0.2]]", "--set", "reference.settle_s=0.1")
BARE = ("--no-record", "--no-figures", "--quiet")
# A tetrahedron of 2 cm.
MESH = "v 0 0 0\nv 0.02 0 0\nv 0 0.02 0\nv 0 0 0.02\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MATERIALS = '<mujoco><asset><mesh name="cover" file="cover.obj"/></asset></mujoco>'


def model(folder: Path, meshes: str = "../meshes") -> Path:
    """A model in a folder of its own, with a mesh beside that and an included file below it."""
    more = '<geom type="mesh" mesh="cover" mass="0.01" pos="0 0 0.1"/>'
    text = written((60, 180, 300), more=more).replace(
        "<compiler ", f'<include file="parts/materials.xml"/><compiler meshdir="{meshes}" '
    )
    for name, content in (("meshes/cover.obj", MESH), ("robot/parts/materials.xml", MATERIALS)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
    file = folder / "robot" / "mine.xml"
    file.write_text(text)
    return file


def test_it_repeats_from_another_folder_without_the_users_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All three of the robot's files are kept as they are to each other, byte for byte."""
    there, elsewhere = tmp_path / "there", tmp_path / "elsewhere"
    kept = {path.name: path.read_bytes() for path in (model(there), *there.rglob("*.*"))}
    words = ("run", "--scenario", "rect", *SHORT, "--model", "robot/mine.xml", "--controller", "comp-flc", *BARE)
    monkeypatch.chdir(there)
    assert invoke(*words, "--out", "out") == 0
    assert capsys.readouterr().err == ""
    monkeypatch.chdir(tmp_path)
    shutil.move(there / "out", elsewhere)
    shutil.rmtree(there)
    said = strict(elsewhere / "provenance.json")["scenarios"]["rect"]["model"]
    assert said["name"] == "mine.xml"
    assert any(line.startswith("body.mass_kg is 2.40") for line in said["differences"])
    files = [said, *said["parts"]]
    assert {Path(each["file"]).name for each in files} == {"mine.xml", "materials.xml", "cover.obj"}
    for each in files:
        data = (elsewhere / each["file"]).read_bytes()
        assert data == kept[Path(each["file"]).name]
        assert sha256(data).hexdigest() == each["sha256"]
    assert invoke("verify", elsewhere) == 0
    assert capsys.readouterr().out.startswith("repeats: 1 rows, ")
    (elsewhere / said["file"]).write_bytes(kept["mine.xml"].replace(b'mass="2.2"', b'mass="2.3"'))
    (elsewhere / said["parts"][0]["file"]).unlink()
    assert invoke("verify", elsewhere) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert "mine.xml, the model mine.xml, is not what was run: its SHA-256 was " in first
    assert "a part of the model mine.xml, cannot be read: No such file or directory" in second


def test_what_could_not_be_kept_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A mesh by its absolute path would not be found elsewhere: the run is made, and does not repeat."""
    monkeypatch.chdir(tmp_path)
    file = model(tmp_path, meshes=str(tmp_path / "meshes"))
    words = ("--scenario", "rect", *SHORT, "--plant", "kinematic", "--model", file, "--controller", "flc", *BARE)
    assert invoke("run", *words, "--out", "out") == 0
    capsys.readouterr()
    assert invoke("verify", "out") == 2
    assert "mine.xml could not be kept: it names " in (said := capsys.readouterr().err)
    assert "by an absolute path" in said
    assert said.count("\n") == 1

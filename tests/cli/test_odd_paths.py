"""Paths at which there is nothing, or nothing that is meant: one line, exit 2, nothing left behind."""

import os
from pathlib import Path

import pytest
from commands import invoke

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.cli import folders

RUN = ("run", "--scenario", "rect", "--plant", "kinematic", "--controller", "flc", "--quiet")
NEVER = 300 * "a"  # longer than any name of a file


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a link that leads to itself, a file and a named pipe that nobody writes to."""
    monkeypatch.chdir(tmp_path)
    os.symlink("loop", "loop")
    Path("file").write_text("x")
    os.mkfifo("pipe")
    return tmp_path


TAKE_PATHS = {  # what is called with a path, and a name's ending
    "a scenario": (("run", "--out", "out", "--scenario"), ".toml"),
    "a robot": ((*RUN, "--out", "out", "--robot"), ".toml"),
    "a controller": ((*RUN, "--out", "out", "--controller"), ".py:Mine"),
    "a plant": ((*RUN[:3], "--out", "out", "--plant"), ".py:Mine"),
    "a model": ((*RUN[:3], "--out", "out", "--model"), ".xml"),
    "a limit": (("compare", *RUN[1:], "--out", "out", "--limits"), ""),
    "a folder": ((*RUN, "--out"), ""),
    "a run": (("verify",), ""),
    "a run to report": (("report",), ""),
    "a run to film": (("film",), ""),
    "a sweep": (("sweep", "--resume"), ""),
    "a log": (("identify", "--out", "out"), ".csv"),
    "a new file": (("new", "scenario"), ".toml"),
    "a recording": (("picture",), ".rrd"),
}
ODD = (NEVER, "a/" * 3000 + "a", "loop/a", "file/a", "/dev/null/a", "\udcff")


@pytest.mark.parametrize("words", TAKE_PATHS.values(), ids=TAKE_PATHS)
def test_where_nothing_can_be_nothing_is(
    words: tuple[tuple[str, ...], str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names that are too long, links in a circle, files and devices in place of folders, bytes that are no text."""
    before = set(folder.rglob("*"))
    given, ending = words
    more = ("picture.png",) if given[0] in ("film", "picture") else ()
    for path in ODD:
        assert invoke(*given, path + ending, *more) == 2, path
        lines = capsys.readouterr().err.splitlines()
        assert lines
        assert all(line.startswith("error: ") for line in lines), lines
        assert set(folder.rglob("*")) == before


@pytest.mark.parametrize("given", [("compare", *RUN[1:], "--limits"), ("identify",), ("run", "--scenario")])
def test_a_device_is_no_file(given: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    """One that never ends does not take all memory."""
    assert invoke(*given, "/dev/zero") == 2
    assert capsys.readouterr().err.startswith("error: ")


def test_a_pipe_is_not_waited_for(capsys: pytest.CaptureFixture[str]) -> None:
    """Where a folder's own file is meant."""
    for name in ("summary.json", "provenance.json"):
        os.mkfifo(name)
    for words in (("verify", "."), ("report", "."), ("compare", *RUN[1:], "--limits", "pipe")):
        assert invoke(*words) == 2
        assert "it is not a regular file" in capsys.readouterr().err


def test_from_python_too() -> None:
    for name in (NEVER, f"{NEVER}.toml"):
        with pytest.raises(OmniError):
            om.scenario(name)
    with pytest.raises(OmniError):
        om.scenario("rect", robot=f"{NEVER}.toml")
    with pytest.raises(OmniError):
        om.scenario("rect", controllers=[f"{NEVER}.py:Mine"])


def test_what_cannot_be_written_is_named_as_it_was_given(capsys: pytest.CaptureFixture[str]) -> None:
    """Not by the name under which it is written until it is whole."""
    assert invoke(*RUN, "--no-figures", "--no-record", "--set", "reference.settle_s=0", "--out", "out") == 0
    Path("out.html").mkdir()
    assert invoke("report", "out", "--out", "out.html") == 2
    assert capsys.readouterr().err == "error: cannot write --out out.html: Is a directory\n"


def test_a_run_that_was_killed_in_its_first_moment_can_be_made_again(folder: Path) -> None:
    """Before its record was whole, by which folders of runs are known."""
    (out := folder / "out").mkdir()
    (out / "provenance.json.partial").write_text('{"form')
    assert folders.prepare(out, "rect", ["provenance.json"], overwrite=True) == out
    assert not any(out.iterdir())
    (out / "provenance.json.partial").write_text('{"form')
    (out / "mine").write_text("precious")
    with pytest.raises(OmniError, match="was not left by a run"):
        folders.prepare(out, "rect", ["provenance.json"], overwrite=True)
    assert len(list(out.iterdir())) == 2

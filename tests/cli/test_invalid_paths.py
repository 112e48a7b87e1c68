"""Missing and unsuitable paths give one line of error and leave no files."""

import os
from pathlib import Path

import pytest
from commands import invoke

import omni_mj as om

RECT = "--scenario rect --plant kinematic"
RUN = f"run {RECT} --controller flc --quiet --out"
# Longer than any name of a file, and than any path
TOO_LONG = (300 * "a", 5000 * "a", "a/" * 3000 + "a")
TAKE_PATHS = {  # what is called with a path, and a name's ending
    "a scenario": ("run --out out --scenario", ".toml"),
    "a robot": (f"{RUN} out --robot", ".toml"),
    "a controller": (f"{RUN} out --controller", ".py:Mine"),
    "a plant": ("run --scenario rect --out out --plant", ".py:Mine"),
    "a model": ("run --scenario rect --out out --model", ".xml"),
    "a folder": (RUN, ""),
    "a run": ("verify", ""),
    "a run to report": ("report", ""),
    "a run to film": ("film", ""),
    "a sweep": (f"sweep {RECT} --vary radio.delay_frames=1,2 --out", ""),
    "a log": ("identify --out out", ".csv"),
    "a new file": ("new scenario", ".toml"),
    "a recording": ("screenshot", ".rrd"),
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a circular link, a file and an unused named pipe."""
    monkeypatch.chdir(tmp_path)
    os.symlink("loop", "loop")
    Path("file").write_text("x")
    os.mkfifo("pipe")
    return tmp_path


@pytest.mark.parametrize("words", TAKE_PATHS.values(), ids=TAKE_PATHS)
def test_unusable_output_folders_are_refused(
    words: tuple[str, str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Too long names, circular links, files and devices in place of folders, invalid text."""
    old_paths = set(folder.rglob("*"))
    command, ending = words
    picture = "picture.png" if command in ("film", "screenshot") else ""
    for path in (*TOO_LONG, "loop/a", "file/a", "/dev/null/a", "\udcff"):
        code = invoke(command, path + ending, picture)
        lines = capsys.readouterr().err.splitlines()
        if path in TOO_LONG:
            assert (code, len(lines)) == (2, 1)
        assert code in (1, 2), path
        assert lines
        assert all(line.startswith("error: ") for line in lines), lines
        assert set(folder.rglob("*")) == old_paths


def test_results_are_not_saved_to_a_name_that_is_too_long() -> None:
    path = {"waypoints": [[0, 0], [0.1, 0]], "settle_s": 0.0}
    result = om.run(om.load_scenario("rect", plant="kinematic", reference=path), ["flc"])
    for name in TOO_LONG:
        with pytest.raises(om.OmniError, match="too long"):
            result.save(name)


def test_devices_are_refused_as_files(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("identify", "run --scenario"):
        assert invoke(command, "/dev/zero") == 2
        assert capsys.readouterr().err.startswith("error: ")

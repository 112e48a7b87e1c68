"""Runs that the tests of this folder share, made once by the commands."""

from pathlib import Path

import pytest
from benches.recording import RecordedRun, RecordingFile, record_run
from commands import invoke

TURNING = "reference.waypoints=[[0, 0], [0.5, 0], [0.5, 0.3, 0.4], [0, 0.3], [0, 0]]"
SHORT = "--plant kinematic --set reference.waypoints=[[0,0],[0.4,0.2],[0,0.4]] --quiet"


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of two short runs on the kinematic plant; the first has three seeds and figures."""
    folders = [tmp_path_factory.mktemp("runs") / name for name in ("rect", "rect-noise")]
    for folder, options in zip(folders, ("--seeds 3 --svg", "--no-figures"), strict=True):
        controllers = "--controller flc --controller comp-flc"
        run = f"run --scenario {folder.name} {SHORT} {controllers} {options} --no-record --out"
        assert invoke(run, folder) == 0
    return folders


@pytest.fixture(scope="session")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a comparison of three controllers on two short scenarios, with verdicts on p."""
    folder = tmp_path_factory.mktemp("comparison") / "compare"
    names = "--scenario rect --scenario rect-noise --controller flc --controller p"
    options = "--controller smith --seeds 3 --subject p --out"
    assert invoke("compare", names, SHORT, options, folder) == 0
    return folder


@pytest.fixture(scope="session")
def driven(tmp_path_factory: pytest.TempPathFactory) -> RecordedRun:
    """A small rectangle with a turn in it, on real wheels."""
    path = tmp_path_factory.mktemp("run") / "recording.rrd"
    fast = "wheels.model=two-rollers", "physics.backend=numpy"
    return record_run(path, ["flc", "comp-flc"], TURNING, *fast, plant="mujoco")


@pytest.fixture(scope="session")
def recorded(driven: RecordedRun) -> RecordingFile:
    return driven.recorded

"""What the tests of what is shown share: runs that are made once."""

from pathlib import Path

import pytest
from benches.recording import Driven, Recorded, driven_by

from omni_mj.scenarios import scenario
from omni_mj.show import figures
from omni_mj.studies.compare import compare
from omni_mj.studies.run import run

TURNING = "reference.waypoints=[[0, 0], [0.5, 0], [0.5, 0.3, 0.4], [0, 0.3], [0, 0]]"
WAY = "reference.waypoints=[[0, 0], [0.4, 0.2], [0, 0.4]]"


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of two short runs on the kinematic plant; the first has three seeds and figures."""
    base = tmp_path_factory.mktemp("runs")
    for name, seeds in {"rect": 3, "rect-noise": 1}.items():
        result = run(scenario.load(name, [WAY], {"plant": "kinematic", "seeds": seeds}), ["flc", "comp-flc"])
        result.save(base / name)
        if seeds > 1:
            figures.save_all(result["rect"], base / name / "figures", svg=True)
    return [base / "rect", base / "rect-noise"]


@pytest.fixture(scope="session")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a comparison of three controllers on two short scenarios, with verdicts on one of them."""
    folder = tmp_path_factory.mktemp("comparison") / "compare"
    scenarios = [scenario.load(name, [WAY], {"plant": "kinematic"}) for name in ("rect", "rect-noise")]
    compare(scenarios, ["flc", "p", "oracle"], seeds=3, subject="p").save(folder)
    return folder


@pytest.fixture(scope="session")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """A small rectangle with a turn in it, on real wheels."""
    path = tmp_path_factory.mktemp("run") / "recording.rrd"
    fast = "wheels.model=two-rollers", "physics.kernel=numpy"
    return driven_by(path, ["flc", "comp-flc"], TURNING, *fast, plant="mujoco")


@pytest.fixture(scope="session")
def recorded(driven: Driven) -> Recorded:
    return driven.recorded

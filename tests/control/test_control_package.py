"""The team's part: its own distribution, its README, and the example of a real robot."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from benches.control import make_controller
from closed_loop import T, make_empty_history, make_observation
from commands import run_python
from team_setup import TIMED

from omni_control import TeamModel

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "real_robot.py"
BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "control" / "README.md").read_text(), re.S)


def project(folder: Path) -> dict:
    return tomllib.loads((folder / "pyproject.toml").read_text())["project"]


def test_the_example_drives_a_robot_there_and_back_without_a_simulator() -> None:
    """As a script of at most 30 lines."""
    script = (
        f"import runpy, sys; runpy.run_path({str(EXAMPLE)!r}); assert 'omni_mj' not in sys.modules"
    )
    done = run_python(code=script)
    assert (done.returncode, done.stderr) == (0, "")
    match = re.fullmatch(r"arrived within (\d+) mm of the start, alpha is (.*)\n", done.stdout)
    assert match, done.stdout
    assert int(match[1]) <= 10, "some millimetres of noise"
    assert float(match[2]) == pytest.approx(0.9, abs=0.05)
    assert len(EXAMPLE.read_text().splitlines()) <= 30


def test_the_controller_of_the_readme_runs() -> None:
    names: dict = {}
    exec(BLOCKS[0], names)
    controller = make_controller(names["Bridged"], TeamModel(T, 2), TIMED, 1, {"gain": 3.0})
    sent = make_empty_history(controller)
    sent.append(np.array([[0.6, 0.0, 0.0]]))
    command = controller.command(0, make_observation(controller.model, np.zeros((1, 3)), sent))
    target, speed = TIMED.at(2, np.zeros((1, 3)))
    np.testing.assert_allclose(command, speed + 3.0 * (target - [[0.01, 0, 0]]), rtol=0, atol=1e-15)


def test_both_distributions_have_the_same_metadata() -> None:
    """Both have the same version, Python and license; this one needs numpy and scipy only."""
    control_project, project_settings = project(ROOT / "control"), project(ROOT)
    for key in ("version", "requires-python", "license"):
        assert control_project[key] == project_settings[key]
    assert [
        name for name in project_settings["dependencies"] if name.startswith(("numpy", "scipy"))
    ] == control_project["dependencies"]
    assert (ROOT / "control" / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    assert (ROOT / "control" / "omni_control" / "py.typed").exists()

"""Test the public Python interface."""

import importlib
import types
from pathlib import Path

import numpy as np
import pytest
from commands import run_python

import omni_mj as om

EXAMPLE = """
import omni_mj as om

class Mine(om.Controller):
    def command(self, frame, observation):  # observation.pose, observation.twist: arrays over rows
        target, speed = self.reference.at(frame, observation.pose)
        return speed + 3.0 * (target - observation.pose)

rect = om.load_scenario("rect", plant="kinematic", radio={"delay_frames": 9})
result = om.run(rect, ["comp-flc", Mine], seeds=range(5))
print(result.table())
result.save("runs/mine")
result.frames()  # an Arrow table
sim = om.Simulation(rect, ["comp-flc"])
sim.reset(seed=0)
sim.observe()
sim.step()
"""
SHORT = om.load_scenario("rect", plant="kinematic", reference={"waypoints": [[0, 0], [0.2, 0]]})


def test_documented_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Controllers share the noise of a seed."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "printed"}
    exec(EXAMPLE, names)
    printed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in printed[2:]] == ["comp-flc", "Mine"]
    result, sim = names["result"], names["sim"]
    assert isinstance(result, om.Result)
    assert isinstance(sim, om.Simulation)
    assert sim.frame == sim.log.length == 1
    frames = result.frames().to_pydict()
    assert set(frames["controller"]) == {"comp-flc", "Mine"}
    assert set(frames["seed"]) == set(range(5))
    vision_error = np.array(frames["vision_x_m"]) - np.array(frames["x_m"])
    half = len(vision_error) // 2
    np.testing.assert_allclose(vision_error[:half], vision_error[half:], atol=1e-12)


def test_public_names_are_not_replaced_by_modules() -> None:
    """Importing submodules replaces no public name; unknown names raise AttributeError."""
    assert len(dir(om)) <= 18
    for module in (
        "omni_mj.run",
        "omni_mj.config.scenario",
        "omni_mj.studies.run_scenario",
        "omni_mj.studies.compare_study",
    ):
        importlib.import_module(module)
    functions = "load_scenario load_robot run compare find_limit measure_alpha measure_slip"
    for name in f"{functions} verify identify".split():
        assert isinstance(getattr(om, name), types.FunctionType)
    for name in ("Controller", "OmniError", "Scenario", "Simulation", "Result"):
        assert isinstance(getattr(om, name), type)
    assert om.__version__
    with pytest.raises(AttributeError, match="'omni_mj' has no attribute 'simulate_all'"):
        om.simulate_all  # noqa: B018
    code = "import omni_mj.run; import omni_mj as om; print(om.run.__name__, om.run.__module__)"
    done = run_python(code=code, check=True)
    assert done.stdout.split() == ["run", "omni_mj.studies.run_scenario"]


def test_a_number_of_seeds_starts_at_zero() -> None:
    assert om.run(SHORT.replace(seed=5), ["flc"], 2).seeds == [0, 1]


def test_seeds_that_are_not_consecutive_are_rejected() -> None:
    for seeds in ([3, 7], [], [2, 1]):
        with pytest.raises(om.OmniError, match="must be consecutive"):
            om.run("rect", ["comp-flc"], seeds=seeds)


def test_one_controller_needs_no_list_and_a_subject_must_be_run() -> None:
    comparison = om.compare([SHORT], "flc", seeds=1)
    assert om.run(SHORT, "flc").controllers == comparison.controllers == ["flc"]
    with pytest.raises(
        om.OmniError, match="the subject 'p' is not among the controllers; choose from flc"
    ):
        om.run(SHORT, "flc", subject="p")
    with pytest.raises(om.OmniError, match=r"scenario must be Scenario \| str, got 5"):
        om.run(5)

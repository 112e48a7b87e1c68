"""Wrong types of arguments: every public function and class refuses them in words."""

import inspect
import itertools
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import omni_control
import omni_mj as om
from omni_control import CommandHistory, IteratedReference, Kinematics, MotionLimits, Team

WRONG = (None, "x", b"x", 2.5, True, np.nan, [], ["x"], {"a": 1}, 1j, object(), [[1, 2], [3]],
         np.zeros((2, 2)), np.float32(0.5), 10**30, -1, range(3), int, lambda: 0)  # fmt: skip
MODEL = omni_control.TeamModel(period=1 / 60, delay_frames=6)
LIMITS = MotionLimits()
POINTS = [[0, 0, 0], [0.1, 0, 0]]
REFERENCE = omni_control.TimedReference(POINTS, LIMITS, 1 / 60)
WHEELS = Kinematics(np.radians([60, 135, 225, 300]), 0.08, 0.03)
RECT = om.load_scenario("rect", plant="kinematic", reference={"waypoints": POINTS[:2]})


class Follower(om.Controller):
    """Stays where it is."""

    def command(self, frame: int, observation: om.Observation) -> np.ndarray:
        return 0 * observation.pose


# Public name -> arguments that are checked before anything else happens
STUDIES: dict[str, dict[str, Any]] = {
    "Scenario": {"seed": 1, "seeds": 1, "plant": "planar", "robot": RECT.robot, "settings": {}},
    "Simulation": {"scenario": RECT, "controllers": ["p"], "seeds": [0]},
    "add_robot": {
        "scene": mujoco.MjSpec(),
        "robot": "none",
        "prefix": "a",
        "pose": [0, 0, 0],
        "height": 0.0,
    },
    "compare": {"scenarios": [], "controllers": ["p"], "seeds": 1},
    "find_limit": {"scenario": RECT, "iterations": 1},
    "identify": {"logs": ["none.csv"], "robot": "tigers-v2016"},
    "load_robot": {"name_or_path": "none.toml"},
    "load_scenario": {"name_or_path": "rect", "seed": 1, "seeds": 1, "allow_code": False},
    "measure_alpha": {"scenario": RECT, "condition_values": {"speed_m_s": [1.0]}},
    "measure_slip": {"robots": ["none"], "moves": []},
    "run": {"scenario": "none", "controllers": ["p"], "seeds": 1, "subject": "p"},
    "sweep": {"scenario": "none", "vary": {"a.b": [1]}, "out": "none", "batch_size": 8},
    "verify": {"folder": "none"},
}
TEAM: dict[str, dict[str, Any]] = {
    "CommandHistory": {"n": 2, "length": 3},
    "Controller": {"model": MODEL, "n": 1},
    "CurveReference": {"curve": max, "limits": LIMITS, "period": 1 / 60, "laps": 1},
    "IteratedReference": {"waypoints": POINTS, "limits": LIMITS, "period": 1 / 60, "n": 1},
    "Kinematics": {"azimuths": WHEELS.azimuths, "arm": 0.08, "radius": 0.03},
    "MotionLimits": {"speed": 3.0, "jerk": None, "wheels": None},
    "SampledReference": {"poses": POINTS, "period": 1 / 60},
    "TargetReference": {"limits": LIMITS, "period": 1 / 60, "n": 1},
    "Team": {"controllers": Follower(MODEL, REFERENCE, 1), "start_poses": np.zeros((1, 3))},
    "TeamModel": {"period": 1 / 60, "delay_frames": 6, "alpha": None, "limits": LIMITS},
    "TimedReference": {"waypoints": POINTS, "limits": LIMITS, "period": 1 / 60, "dwell_frames": 0},
    "WheelLimits": {"kinematics": WHEELS, "friction": 0.8, "gyration_radius": 0.06},
}


@pytest.mark.parametrize("name", STUDIES)
def test_functions_of_omni_mj_refuse_wrong_types(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything happens, and each argument by its name or that of its first item."""
    monkeypatch.chdir(tmp_path)
    function, arguments = getattr(om, name), STUDIES[name]
    for argument in arguments:
        for value in (1j, object(), b"x", {"a", 1}, np.zeros((2, 2)), np.array(None), np.nan):
            with pytest.raises(om.OmniError, match=argument):
                function(**{**arguments, argument: value})
    assert not list(tmp_path.iterdir())


def test_names_of_settings_that_are_no_strings_are_unknown() -> None:
    replace = RECT.settings.replace
    for section in ("radio", "model", "carpet", "control"):
        for change in (
            lambda **sections: om.load_scenario("rect", **sections),
            lambda **sections: RECT.replace(settings=sections),
            replace,
        ):
            with pytest.raises(om.OmniError, match=f"unknown setting {section}.1"):
                change(**{section: {1: 2}})
    with pytest.raises(om.OmniError, match="unknown section 1"):
        RECT.replace(settings={1: {}})


def test_messages_have_no_control_characters() -> None:
    """Of paths and of names, which programs may have received from elsewhere."""
    calls = (om.identify, om.load_robot, om.verify, om.load_scenario, om.measure_slip)
    for name in ("\x1b[2J\x07\x9b\u202e", "\0", 5000 * "x"):
        for call, suffix in itertools.product(calls, ("", ".csv", ".toml", ".py:Mine", ".xml")):
            with pytest.raises(om.OmniError) as caught:
                call(name + suffix)
            assert str(caught.value).replace("\n", "").isprintable()


def test_a_robots_file_may_name_any_text_as_its_model(tmp_path: Path) -> None:
    for name in (r"\u0000", 5000 * "x", "/", ".."):
        (tmp_path / "robot.toml").write_text(f'[model]\nfile = "{name}"\n')
        with pytest.raises(om.OmniError, match=r"robot\.toml names|there is no model"):
            om.load_robot(tmp_path / "robot.toml")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", TEAM)
def test_classes_of_omni_control_refuse_wrong_types(name: str) -> None:
    """`OmniError` is the only exception, without a warning; most values are refused."""
    function = Follower if name == "Controller" else getattr(omni_control, name)
    valid = {"reference": REFERENCE} if name == "Controller" else {}
    for argument in TEAM[name]:
        n_refused = 0
        for value in WRONG:
            try:
                function(**valid, **{**TEAM[name], argument: value})
            except om.OmniError:
                n_refused += 1
        assert n_refused > len(WRONG) / 2, argument


def test_all_public_functions_are_tried() -> None:
    results = {"Observation", "Result", "Controller", "OmniError"}  # not made by users
    for package, tried in ((om, STUDIES), (omni_control, TEAM)):
        functions = {name for name in package.__all__ if callable(getattr(package, name))}
        untried = functions - set(tried) - results - {"Reference", "ControllerError"}
        assert not untried, untried


def test_methods_of_every_frame_refuse_wrong_types() -> None:
    team = Team(Follower(MODEL, REFERENCE, 1), np.zeros((1, 3)))
    simulation = om.Simulation(RECT, ["p"])
    replanned = IteratedReference(POINTS, LIMITS, 1 / 60, 1)
    history = CommandHistory(1, 3)
    for function in (
        team.observe, team.step, team.stop, simulation.step, simulation.reset, simulation.run,
        history.append, history.get_latest, history.get_delayed, WHEELS.wheel_speeds,
        WHEELS.body_twist, LIMITS.compute_time_scale,
        *(reference.at for reference in (REFERENCE, replanned)),
        *(reference.preview for reference in (REFERENCE, replanned)),
    ):  # fmt: skip
        n_arguments = len(inspect.signature(function).parameters)
        for value in ("x", object(), [[1, 2], [3]], {"a": 1}):
            with pytest.raises(om.OmniError):
                function(*[value] * min(n_arguments, 3))


def test_numpy_scalars_are_numbers() -> None:
    """Of any integer or float type; iterators and tuples are lists."""
    run = {"reference": {"waypoints": POINTS}, "plant": "kinematic"}
    scenario = om.load_scenario("rect", seed=np.int64(3), seeds=np.int16(2), **run)
    result = om.run(scenario, ("p",), np.uint8(2))
    assert result.seeds == [0, 1]
    assert om.Simulation(scenario, iter(["p"]), np.arange(2)).rows[1].seed == 1
    assert MotionLimits(np.float32(2), np.int8(3)).speed == 2

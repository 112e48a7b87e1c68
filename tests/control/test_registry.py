"""Controllers by name, imported when used, and their parameters."""

from typing import ClassVar

import numpy as np
import pytest
from benches.control import (
    CONTROLLERS,
    get_parameters,
    load_controller_class,
    make_controller,
    validate_parameters,
)
from closed_loop import T
from commands import run_python
from team_setup import TIMED

from omni_control import Controller, ControllerError, Kinematics, MotionLimits, OmniError, TeamModel

MODEL = TeamModel(T, 6)


class Gains(Controller):
    gain: float = 3.0
    window: int = 5
    bold: bool = False
    law: str = "pd"
    quoted: "float" = 1
    _hidden: float = 1.0
    shared: ClassVar[float] = 2.0
    names: tuple[float, ...] = (1.0,)
    plain = 7.0

    def __init__(self, *known: object) -> None:
        super().__init__(*known)  # type: ignore[arg-type]
        self.at_once = 2 * self.gain


class More(Gains):
    gain: float = 4.0
    speed: float = 0.5


def test_every_name_makes_its_controller() -> None:
    for name in CONTROLLERS:
        controller = make_controller(name, MODEL, TIMED, 2)
        assert type(controller) is load_controller_class(name)
        assert controller.memory_frames >= MODEL.delay_frames
        assert (load_controller_class(name).__doc__ or "").lower().startswith(f"{name}:")
    with pytest.raises(OmniError, match="unknown controller 'com-flc'; did you mean 'comp-flc'"):
        load_controller_class("com-flc")


def test_parameters_are_annotated_numbers_strings_and_bools() -> None:
    assert get_parameters(Gains) == {
        "gain": 3.0,
        "window": 5,
        "bold": False,
        "law": "pd",
        "quoted": 1,
    }
    assert get_parameters(More) == {**get_parameters(Gains), "gain": 4.0, "speed": 0.5}
    assert get_parameters(load_controller_class("inverse-flc")) == {"learns": "nothing"}


def test_parameters_are_set_before_the_constructor_runs_and_for_one_controller_only() -> None:
    values = {"gain": 5, "window": np.int64(9), "bold": True, "law": "p", "quoted": np.float64(0.5)}
    controller = make_controller(More, MODEL, TIMED, 1, values)
    assert isinstance(controller, More)
    assert {name: getattr(controller, name) for name in values} == {**values, "gain": 5.0}
    assert type(controller.gain) is type(controller.quoted) is float
    assert type(controller.window) is int
    assert (controller.speed, controller.at_once) == (0.5, 10.0)
    assert make_controller(More, MODEL, TIMED, 1).gain == 4.0  # type: ignore[attr-defined]


def test_all_wrong_parameters_are_listed() -> None:
    wrong = {"gian": 5.0, "gain": "high", "window": 2.5, "bold": 1, "law": True, "speed": False}
    with pytest.raises(OmniError) as error:
        make_controller(More, MODEL, TIMED, 1, wrong)
    assert str(error.value).split("\n") == [
        "More has no parameter 'gian'; did you mean 'gain'? "
        "choose from gain, window, bold, law, quoted, speed",
        "parameter gain of More must be a number, not 'high'",
        "parameter window of More must be a whole number, not 2.5",
        "parameter bold of More must be true or false, not 1",
        "parameter law of More must be a string, not True",
        "parameter speed of More must be a number, not False",
    ]
    with pytest.raises(OmniError, match="Flc has no parameter 'gain'; it has no parameters"):
        validate_parameters(load_controller_class("flc"), {"gain": 1.0})


def test_constructor_errors_name_file_and_line() -> None:
    class Forgetful(Controller):
        def __init__(self, *known: object) -> None:
            pass

    class Broken(Controller):
        def __init__(self, *known: object) -> None:
            raise KeyError("gain")

    with pytest.raises(
        ControllerError,
        match=r"Broken cannot be made \(test_registry.py, line \d+\): KeyError: 'gain'",
    ):
        make_controller(Broken, MODEL, TIMED, 1)
    with pytest.raises(ControllerError, match="Forgetful cannot be made"):
        make_controller(Forgetful, MODEL, TIMED, 1)


def test_team_models_are_checked_and_comparable() -> None:
    """Equality is by content, including wheels: robots with equal models share a controller."""
    four, three = (
        Kinematics(np.radians(angles), 0.08, 0.03)
        for angles in ([60, 135, 225, 300], [0, 120, 240])
    )
    again = Kinematics(np.radians([60.0, 135, 225, 300]), 0.08, 0.03)
    models = [TeamModel(T, 6, geometry=geometry) for geometry in (four, again, three, None)]
    assert models[0] == models[1]
    assert len(set(models)) == 3
    assert MODEL.limits == MotionLimits(3.7, 4.7, 26.0, 50.8)
    with pytest.raises(ValueError, match="read-only"):
        four.azimuths += 1
    with pytest.raises(OmniError) as error:
        TeamModel(0.0, -1, lag_s=np.nan, alpha=(0.9, 0.0), alpha_window_frames=1.5)
    assert [line.split()[0] for line in str(error.value).split("\n")] == [
        "period", "delay_frames", "lag_s", "alpha_window_frames", "alpha",
    ]  # fmt: skip
    with pytest.raises(OmniError, match="delay_frames"):
        TeamModel(T, np.int64(-1))  # type: ignore[arg-type]
    for wrong in (-1.0, np.int64(0), np.float32(-1), np.float32(np.nan)):
        with pytest.raises(OmniError, match=r"MotionLimits\.jerk must be a positive number"):
            MotionLimits(jerk=wrong)  # type: ignore[arg-type]


def test_the_package_needs_no_simulator_and_scipy_only_when_it_must() -> None:
    """Importing a controller by name loads numpy only, and never omni_mj."""
    script = """
import sys
from omni_control import *
import omni_control, omni_control.errors
assert set(omni_control.__all__) <= set(dir(omni_control)) and "Team" in globals()
from omni_control.controllers.registry import load_controller_class
from omni_control.controllers.registry import CONTROLLERS
for name in CONTROLLERS: load_controller_class(name)
heavy = {name.split(".")[0] for name in sys.modules} & {"scipy", "mujoco", "omni_mj", "matplotlib"}
assert not heavy, heavy
"""
    done = run_python(code=script)
    assert (done.returncode, done.stderr) == (0, "")
    lazy = "import sys, omni_control.errors; assert 'numpy' not in sys.modules"
    assert run_python(code=lazy).returncode == 0

"""Parameters of controllers: read from files, overrides and Python, and checked against what the controllers have."""

from pathlib import Path

import pytest
from scenario_texts import load, refusal

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_mj.scenarios import scenario

MINE = """
from typing import ClassVar
from omni_control.controllers.base import Controller

class Mine(Controller):
    gain: float = 3
    window: int = 15
    fast: bool = False
    law: str = "linear"
    shape: tuple = (1, 2)
    count: ClassVar[int] = 3
    _hidden: float = 1.0
"""


@pytest.fixture
def mine(tmp_path: Path) -> str:
    (tmp_path / "mine.py").write_text(MINE)
    return f"{tmp_path / 'mine.py'}:Mine"


def test_parameters_come_from_the_file_overrides_and_python(tmp_path: Path, mine: str) -> None:
    toml = f'controllers = ["flc", "{mine}"]\n\n[controller.Mine]\ngain = 4\nlaw = "cubic"\n'
    loaded = load(tmp_path, toml, "controller.Mine.window=9", "controller.Mine.fast=true")
    expected = {"Mine": {"gain": 4.0, "law": "cubic", "window": 9, "fast": True}}
    assert loaded.settings.controller == expected
    assert type(loaded.settings.controller["Mine"]["gain"]) is float  # a whole number serves where one is wanted
    assert load(tmp_path, loaded.to_toml()) == loaded
    load(tmp_path, toml)
    changes = {"window": 9, "fast": True}
    assert (
        scenario.scenario(tmp_path / "given.toml", code=True, controller={"Mine": changes}).settings.controller
        == expected
    )


def test_wrong_parameters_are_refused(tmp_path: Path, mine: str) -> None:
    for override, says in {
        "controller.Mien.gain=3": "unknown controller 'Mien' in [controller.Mien]; did you mean 'Mine'?",
        "controller.Mine.gian=3": "controller.Mine.gian: Mine has no parameter 'gian'; did you mean 'gain'?",
        "controller.Mine.shape=3": "controller.Mine.shape: Mine has no parameter",
        "controller.Mine.count=3": "controller.Mine.count: Mine has no parameter",
        "controller.Mine._hidden=3": "controller.Mine._hidden: Mine has no parameter",
        "controller.Mine.gain=true": "controller.Mine.gain: parameter gain of Mine must be a number, not True",
        "controller.Mine.gain=x": "controller.Mine.gain: parameter gain of Mine must be a number, not 'x'",
        "controller.Mine.gain=nan": "controller.Mine.gain must be a number, true or false, or a string, not nan",
        "controller.Mine.gain=[1]": "controller.Mine.gain must be a number, true or false, or a string, not [1]",
        "controller.Mine.window=1.0": "controller.Mine.window: parameter window of Mine must be a whole",
        "controller.Mine.fast=1": "controller.Mine.fast: parameter fast of Mine must be ",
        "controller.Mine.law=1": "controller.Mine.law: parameter law of Mine must be ",
    }.items():
        assert refusal(tmp_path, "", override, controllers=[mine]).startswith(says)


def test_all_wrong_parameters_are_said_at_once() -> None:
    class Own(Controller):
        gain: float = 3.0

    with pytest.raises(OmniError) as error:
        scenario.scenario(
            "rect",
            controllers=[Own],
            radio={"delay_frames": -1},
            controller={"Own": {"gain": "x", "gian": 3}, "flc": {"gain": 1}},
        )
    assert [line.split(";")[0] for line in str(error.value).splitlines()] == [
        "radio.delay_frames must be a whole number from 0 to 600 frames, not -1",
        "controller.Own.gain: parameter gain of Own must be a number, not 'x'",
        "controller.Own.gian: Own has no parameter 'gian'",
        "unknown controller 'flc' in [controller.flc]",
    ]

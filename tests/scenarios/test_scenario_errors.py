"""Scenarios: what is refused, and with which words."""

from pathlib import Path

import pytest
from scenario_texts import assign, load, refusal

from omni_control.errors import OmniError
from omni_mj.scenarios import scenario
from omni_mj.scenarios.scenario import Scenario

# What is given: words the message must contain.
HEAD_ERRORS = {
    'plant = "mujco"': ["mujco", "did you mean 'mujoco'", "kinematic", "file.py:Class"],
    "plant = 3": ["plant", "string", "3"],
    'plant = "mine.py:Plant"': ["no file", "mine.py"],
    'robot = "tigers-v201"': ["tigers-v201'", "did you mean 'tigers-v2016'", "robot.toml"],
    'robot = "scene"': ["unknown robot 'scene'"],
    'robot = "mine.toml"': ["no robot's file mine.toml"],
    'robot = "mine.xml"': ["a robot is a .toml file of settings, not 'mine.xml'", "tigers-v2020", "robot.toml"],
    "robot = true": ["robot", "string", "True"],
    'controllers = ["comp-fcl"]': ["comp-fcl", "did you mean 'comp-flc'", "flc"],
    "controllers = []": ["controllers", "at least one"],
    'controllers = "flc"': ["controllers", "list"],
    "controllers = [3]": ["[3]", "list of at least one name"],
    'controllers = ["mine.py"]': ["mine.py", "comp-flc", "file.py:Class"],
    'controllers = ["flc", "flc"]': ["'flc'", "twice"],
    "seed = -1": ["seed", "from 0", "-1"],
    "seed = 1.5": ["seed", "whole number", "1.5"],
    "seed = true": ["seed", "whole number", "True"],
    'seed = "1"': ["seed", "whole number", "'1'"],
    "seed = 9223372036854775808": ["seed", "to 9223372036854775807"],
    "seeds = 0": ["seeds", "1 to 100000", "0"],
    "seeds = 100001": ["seeds", "1 to 100000", "100001"],
    "seeds = false": ["seeds", "whole number", "False"],
    "paper_table = 2": ["paper_table", "3, 4 or 0", "2"],
    "paper_table = true": ["paper_table", "whole number", "True"],
    "name = 3": ["name", "string", "3"],
    'name = "a/b"': ["name", "letters, digits", "'a/b'"],
    "description = true": ["description", "string", "True"],
    "sead = 3": ["sead", "did you mean 'seed'", "seeds"],
    "settings = 3": ["unknown section settings"],
    "radio = 3": ["radio", "section", "[radio]"],
    "controller = 3": ["controller", "section", "[controller]"],
    "[rado]\ndelay_frames = 3": ["rado", "did you mean 'radio'", "vision"],
    "[radio]\ndelay_frame = 3": ["radio.delay_frame", "did you mean 'radio.delay_frames'"],
    "[radio]\njitter_frames = 7": ["jitter_frames", "not be above", "delay_frames"],
    "seed = = 3": ["given.toml", "not valid TOML", "line 1"],
    "seed = 1\nseed = 2": ["given.toml", "not valid TOML", "overwrite"],
}
OVERRIDE_ERRORS = {
    "radio.delay_frames": ["radio.delay_frames", "section.field=value"],
    "delay_frames=3": ["delay_frames=3", "section.field=value"],
    "": ["section.field=value"],
    "radio.delay_frames=x": ["radio.delay_frames", "whole number", "'x'"],
    "radio.delay_frames=": ["radio.delay_frames", "whole number"],
    "radio.delay_frames=1979-05-27": ["radio.delay_frames", "whole number", "date"],
    "radio.delay_framse=3": ["did you mean 'radio.delay_frames'"],
    "raido.delay_frames=3": ["did you mean 'radio'"],
    "radio.delay.frames=3": ["radio.delay.frames", "radio.delay_frames"],
    "seeds.x=3": ["cannot set seeds.x", "not a section"],
    "controller.flc=3": ["controller.flc is a section"],
}


def test_a_wrong_file_is_refused_in_one_line(tmp_path: Path) -> None:
    for toml, says in HEAD_ERRORS.items():
        message = refusal(tmp_path, toml)
        assert [words for words in says if words not in message] == [], message


def test_wrong_overrides_are_refused_in_one_line(tmp_path: Path) -> None:
    for override, says in OVERRIDE_ERRORS.items():
        message = refusal(tmp_path, "seeds = 2", override)
        assert [words for words in says if words not in message] == [], message


def test_all_that_is_wrong_is_said_at_once(tmp_path: Path) -> None:
    """The file's mistakes, those of overrides and those of the caller's head: a line each, from Python the same."""
    toml = 'seeds = 0\nsead = 3\nplant = "mujco"\n\n[radio]\ndelay_frames = -1\n\n[controller.fcl]\ngain = 3\n'
    with pytest.raises(OmniError) as error:
        load(tmp_path, toml, "nonsense", "vision.miss_frames=0.5", controllers=("flc", "comp-flc", "flc"), robot="x")
    lines = str(error.value).splitlines()
    starts = ["cannot read --set nonsense", "unknown name sead", "unknown plant 'mujco'", "unknown robot 'x'"]
    starts += ["controller 'flc' is named twice", "seeds must be ", "radio.delay_frames must be "]
    starts += ["vision.miss_frames must be "]
    assert sorted(start for line in lines for start in starts if line.startswith(start)) == sorted(starts)
    assert len(lines) == len(starts)

    with pytest.raises(OmniError) as error:
        scenario.scenario("rect", plant="mujco", seeds=0, radio={"delay_frames": -1}, controllers=["fcl"])
    assert [line.split()[:2] for line in str(error.value).splitlines()] == [
        ["unknown", "plant"],
        ["unknown", "controller"],
        ["seeds", "must"],
        ["radio.delay_frames", "must"],
    ]
    with pytest.raises(OmniError, match=r"^seeds must be .*\nsettings must be Settings, or sections by name, not 3$"):
        Scenario(seeds=0, settings=3)


@pytest.mark.parametrize(
    ("name", "value"),
    [("radio.delay_frames", "{}"), ("battery.cut_off_v", "{}"), ("reference.waypoints", "[[0, 0], [{}, 0]]")],
)
@pytest.mark.parametrize("digits", [400, 5000], ids=["beyond float", "beyond Python's own limit of digits"])
def test_numbers_of_absurd_length_are_refused(tmp_path: Path, name: str, value: str, digits: int) -> None:
    huge = value.format("1" + "0" * digits)
    assert len(refusal(tmp_path, assign(name, huge))) < 1000
    assert len(refusal(tmp_path, "", f"{name}={huge}")) < 1000


def test_unknown_scenarios_are_refused_with_those_there_are() -> None:
    for make in (scenario.load, scenario.scenario):
        with pytest.raises(OmniError, match=r"unknown scenario 'rct'; did you mean 'rect'\? choose from .*rect-noise"):
            make("rct")


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OmniError, match=r"cannot read scenario .*nowhere\.toml: No such file"):
        scenario.load(str(tmp_path / "nowhere.toml"))
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(OmniError, match=r"cannot read scenario .*folder\.toml"):
        scenario.load(str(tmp_path / "folder.toml"))
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(OmniError, match="not valid TOML"):
        scenario.load(str(tmp_path / "binary.toml"))


def test_seeds_beyond_63_bits_are_refused(tmp_path: Path) -> None:
    # Each seed becomes a 64-bit column of the trajectory, the last one too.
    assert "below 2^63" in refusal(tmp_path, f"seed = {2**63 - 2}\nseeds = 3")
    assert load(tmp_path, f"seed = {2**63 - 3}\nseeds = 3").seed_list[-1] == 2**63 - 1

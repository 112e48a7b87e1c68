"""Scenarios: what is refused, and with which words."""

import json
import math
from pathlib import Path

import pytest
from scenario_texts import NUMBERS, SWITCHES, WHOLE, assign, load, refusal

from omni_control.errors import OmniError
from omni_mj.scenarios import scenario

# What is given: words the message must contain.
HEAD_ERRORS = {
    'plant = "mujco"': ["mujco", "did you mean 'mujoco'", "kinematic"],
    "plant = 3": ["plant", "string", "3"],
    'controllers = ["comp-fcl"]': ["comp-fcl", "did you mean 'comp-flc'", "flc"],
    "controllers = []": ["controllers", "at least one"],
    'controllers = "flc"': ["controllers", "list"],
    "controllers = [3]": ["[3]", "list of at least one name"],
    'controllers = ["mine.py"]': ["mine.py", "comp-flc", "file.py:Class"],
    'controllers = ["flc", "flc"]': ["twice"],
    "seed = -1": ["seed", "at least 0", "-1"],
    "seed = 1.5": ["seed", "whole number", "1.5"],
    "seed = true": ["seed", "whole number", "True"],
    'seed = "1"': ["seed", "whole number", "'1'"],
    "seed = 9223372036854775808": ["seed", "2^63"],
    "seeds = 0": ["seeds", "1 to 100000", "0"],
    "seeds = 100001": ["seeds", "1 to 100000", "100001"],
    "seeds = false": ["seeds", "whole number", "False"],
    "paper_table = 5": ["paper_table", "3, 4 or 0", "5"],
    "paper_table = true": ["paper_table", "whole number", "True"],
    "name = 3": ["name", "string", "3"],
    "description = true": ["description", "string", "True"],
    "sead = 3": ["sead", "did you mean 'seed'", "seeds"],
    "radio = 3": ["radio", "section", "[radio]"],
    "[rado]\ndelay_frames = 3": ["rado", "did you mean 'radio'", "vision"],
    "[radio]\ndelay_frame = 3": ["radio.delay_frame", "did you mean 'radio.delay_frames'"],
    "[vision]\nposition_nois_m = 0.1": ["did you mean 'vision.position_noise_m'", "vision.miss_probability"],
    "[kinematic]\nalpha_low = 0.9\nalpha_high = 0.8": ["alpha_low", "not be above", "alpha_high"],
    "[radio]\njitter_frames = 7": ["jitter_frames", "not be above", "delay_frames"],
    "seed = = 3": ["given.toml", "not valid TOML", "line 1"],
    "seed = 1\nseed = 2": ["given.toml", "not valid TOML", "overwrite"],
}


@pytest.mark.parametrize("toml", HEAD_ERRORS)
def test_a_wrong_file_is_refused(tmp_path: Path, toml: str) -> None:
    message = refusal(tmp_path, toml)
    for words in HEAD_ERRORS[toml]:
        assert words in message


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "true", '"1"', "[1]", "{}", "1979-05-27"])
def test_what_is_not_a_finite_number_is_refused(tmp_path: Path, value: str) -> None:
    for name, (field, _) in NUMBERS.items():
        message = refusal(tmp_path, assign(name, value))
        meta = field.metadata
        for words in (name, f"{meta['low']:g} to {meta['high']:g}", meta["unit"]):
            assert words in message


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_out_of_bounds_are_refused(tmp_path: Path, name: str) -> None:
    meta = NUMBERS[name][0].metadata
    low, high = meta["low"], meta["high"]
    below, above = (
        (low - 1, high + 1) if name in WHOLE else (math.nextafter(low, -math.inf), math.nextafter(high, math.inf))
    )
    for value in (below, above):
        message = refusal(tmp_path, assign(name, repr(value)))
        assert name in message
        assert f"{low:g} to {high:g}" in message


@pytest.mark.parametrize("name", WHOLE)
@pytest.mark.parametrize("value", ["2.0", "2.5"])
def test_whole_numbers_are_whole(tmp_path: Path, name: str, value: str) -> None:
    message = refusal(tmp_path, assign(name, value))
    assert "whole number" in message
    assert value in message


@pytest.mark.parametrize(
    ("name", "value"),
    [("radio.delay_frames", "{}"), ("battery.cut_off_v", "{}"), ("reference.waypoints", "[[0, 0], [{}, 0]]")],
)
@pytest.mark.parametrize("digits", [400, 5000], ids=["beyond float", "beyond Python's own limit of digits"])
def test_numbers_of_absurd_length_are_refused(tmp_path: Path, name: str, value: str, digits: int) -> None:
    huge = value.format("1" + "0" * digits)
    refusal(tmp_path, assign(name, huge))
    refusal(tmp_path, "", f"{name}={huge}")


@pytest.mark.parametrize(
    "value",
    [
        "[]",
        "3",
        '"here"',
        "[[0, 0]]",
        "[[0, 0], 1]",
        "[[0, 0], [1]]",
        "[[0, 0], [1, 2, 3, 4]]",
        "[[0, 0], [true, 1]]",
        "[[0, 0], [nan, 1]]",
        "[[0, 0], [1, inf]]",
        "[[0, 0], [100.1, 0]]",
        '[[0, 0], ["1", 0]]',
    ],
)
def test_wrong_way_points_are_refused(tmp_path: Path, value: str) -> None:
    message = refusal(tmp_path, assign("reference.waypoints", value))
    for words in ("reference.waypoints", "at least two", "[x, y]", "m and rad", "100 m"):
        assert words in message


@pytest.mark.parametrize("value", ['"iterate"', "3", "true", '["timed"]', "{}"])
def test_wrong_choices_are_refused(tmp_path: Path, value: str) -> None:
    message = refusal(tmp_path, assign("reference.mode", value))
    for words in ("reference.mode", "timed or iterated"):
        assert words in message


@pytest.mark.parametrize("value", ['"yes"', "3", "0", "1.5", "[true]", "{}"])
def test_switches_are_true_or_false(tmp_path: Path, value: str) -> None:
    assert SWITCHES
    for name in SWITCHES:
        message = refusal(tmp_path, assign(name, value))
        for words in (name, "true or false"):
            assert words in message
        for setting in (True, False):
            section, field = name.split(".")
            loaded = load(tmp_path, "", f"{name}={json.dumps(setting)}")
            assert getattr(getattr(loaded.settings, section), field) is setting


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("radio.delay_frames", ["radio.delay_frames", "section.field=value"]),
        ("delay_frames=3", ["delay_frames=3", "section.field=value"]),
        ("", ["section.field=value"]),
        ("radio.delay_frames=x", ["radio.delay_frames", "whole number", "'x'"]),
        ("radio.delay_frames=", ["radio.delay_frames", "whole number"]),
        ("radio.delay_framse=3", ["did you mean 'radio.delay_frames'"]),
        ("raido.delay_frames=3", ["did you mean 'radio'"]),
        ("radio.delay.frames=3", ["radio.delay.frames", "radio.delay_frames"]),
        ("seeds.x=3", ["seeds"]),
    ],
)
def test_wrong_overrides_are_refused(tmp_path: Path, override: str, words: list[str]) -> None:
    message = refusal(tmp_path, "seeds = 2", override)
    for word in words:
        assert word in message


def test_a_wrong_head_from_the_caller_is_refused(tmp_path: Path) -> None:
    assert "did you mean 'mujoco'" in refusal(tmp_path, "", plant="mujocoo")
    assert "seeds" in refusal(tmp_path, "", seeds=0)


def test_unknown_scenarios_are_refused_with_those_there_are() -> None:
    with pytest.raises(OmniError, match=r"unknown scenario 'rct'; did you mean 'rect'\? choose from .*rect-noise"):
        scenario.load("rct")


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
    refusal(tmp_path, f"seed = {2**63 - 2}\nseeds = 3")
    assert load(tmp_path, f"seed = {2**63 - 3}\nseeds = 3").seed_list[-1] == 2**63 - 1

"""Scenarios: what is read, what is refused and how, and that writing and reading them again changes nothing."""

import dataclasses
import json
import math
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from omni_control.errors import OmniError
from omni_control.tracker import TRACKERS
from omni_mj import scenario
from omni_mj.scenario import Scenario
from omni_mj.settings import Settings


def every_setting() -> Iterator[tuple[str, dataclasses.Field[Any], Any]]:
    """Name, field and default of every setting."""
    defaults = Settings()
    for section in dataclasses.fields(defaults):
        values = getattr(defaults, section.name)
        for field in dataclasses.fields(values):
            yield f"{section.name}.{field.name}", field, getattr(values, field.name)


SETTINGS = {name: (field, default) for name, field, default in every_setting()}
NUMBERS = {name: both for name, both in SETTINGS.items() if both[0].metadata["low"] is not None}
SWITCHES = [name for name, (field, _) in SETTINGS.items() if field.type is bool]
WHOLE = [name for name, (field, _) in NUMBERS.items() if field.type is int]


def load(tmp_path: Path, toml: str, *overrides: str, **head: Any) -> Scenario:
    path = tmp_path / "given.toml"
    path.write_text(toml, encoding="utf-8")
    return scenario.load(str(path), overrides, head)


def refusal(tmp_path: Path, toml: str, *overrides: str, **head: Any) -> str:
    """The message with which a scenario is refused: one line."""
    with pytest.raises(OmniError) as error:
        load(tmp_path, toml, *overrides, **head)
    message = str(error.value)
    assert message
    assert "\n" not in message
    return message


def assign(name: str, toml_value: str) -> str:
    section, field = name.split(".")
    return f"[{section}]\n{field} = {toml_value}\n"


# --- what is read ---


def test_the_papers_scenarios_come_with_the_package() -> None:
    assert {"rect", "rect-noise"} <= set(scenario.builtin())


@pytest.mark.parametrize("name", scenario.builtin())
def test_built_in_scenarios_load(name: str) -> None:
    loaded = scenario.load(name)
    assert loaded.name == name
    assert loaded.description
    assert set(loaded.controllers) <= set(TRACKERS)


def test_the_papers_rectangle() -> None:
    rect = scenario.load("rect")
    assert rect.paper_table == 3
    corners = [waypoint[:2] for waypoint in rect.settings.reference.waypoints]
    assert corners[0] == corners[-1]
    sides = [math.dist(a, b) for a, b in pairwise(corners)]
    assert sides == [2.0, 1.5, 2.0, 1.5]
    assert rect.settings.radio.delay_frames / 60 == pytest.approx(0.1)  # the paper's dead time, s
    assert rect.settings.reference.max_acceleration_m_s2 == 0.826
    noise = scenario.load("rect-noise")
    assert noise.paper_table == 4
    assert noise.settings.disturbance.velocity_m_s == 0.1
    assert noise.settings.reference == rect.settings.reference


def test_an_empty_file_is_the_defaults_under_the_files_name(tmp_path: Path) -> None:
    assert load(tmp_path, "") == Scenario("given")


@pytest.mark.parametrize("name", NUMBERS)
def test_every_default_is_within_its_own_bounds(name: str) -> None:
    field, default = NUMBERS[name]
    assert field.metadata["low"] <= default <= field.metadata["high"]
    assert type(default) is field.type


@pytest.mark.parametrize("name", SETTINGS)
def test_every_setting_says_what_it_means_and_in_what_unit(name: str) -> None:
    field, default = SETTINGS[name]
    meta = field.metadata
    assert meta["doc"]
    assert isinstance(meta["unit"], str)
    if meta["choices"]:
        assert default in meta["choices"]
    # A unit in the field's name and the unit shown must be the same.
    for suffix, unit in {
        "_rad_s2": "rad/s^2",
        "_nm_s": "N m s/rad",
        "_rad_s": "rad/s",
        "_m_s2": "m/s^2",
        "_m_s": "m/s",
        "_rad": "rad",
        "_ohm_s": "ohm s/rad",
        "_ohm": "ohm",
        "_per_k": "1/K",
        "_j_k": "J/K",
        "_k_w": "K/W",
        "_nm": "N m",
        "_ah": "Ah",
        "_c": "deg C",
        "_v": "V",
        "_n": "N",
        "_m": "m",
        "_s": "s",
    }.items():
        if name.endswith(suffix):
            assert meta["unit"] == unit
            break


def test_every_default_is_accepted_when_written_out(tmp_path: Path) -> None:
    for name, (_, default) in SETTINGS.items():
        assert load(tmp_path, assign(name, json.dumps(default))) == Scenario("given"), name


@pytest.mark.parametrize("name", NUMBERS)
def test_both_bounds_of_a_setting_are_allowed(tmp_path: Path, name: str) -> None:
    section, field = name.split(".")
    companion = ["kinematic.alpha_high=2"] if name == "kinematic.alpha_low" else []
    companion += ["kinematic.alpha_low=0"] if name == "kinematic.alpha_high" else []
    for bound in (NUMBERS[name][0].metadata["low"], NUMBERS[name][0].metadata["high"]):
        loaded = load(tmp_path, "", f"{name}={bound!r}" if name not in WHOLE else f"{name}={bound:d}", *companion)
        assert getattr(getattr(loaded.settings, section), field) == bound


def test_head_fields_are_read(tmp_path: Path) -> None:
    toml = (
        'name = "mine"\ndescription = "what it is"\npaper_table = 4\nplant = "kinematic"\n'
        'controllers = ["comp-flc"]\nseed = 7\nseeds = 3\n'
    )
    loaded = load(tmp_path, toml)
    assert loaded == Scenario("mine", "what it is", 4, "kinematic", ("comp-flc",), 7, 3)
    assert loaded.seed_list == [7, 8, 9]


def test_whole_numbers_serve_where_a_number_is_wanted(tmp_path: Path) -> None:
    value = load(tmp_path, assign("battery.cut_off_v", "20")).settings.battery.cut_off_v
    assert value == 20.0
    assert isinstance(value, float)


def test_way_points_without_a_heading_have_heading_zero(tmp_path: Path) -> None:
    loaded = load(tmp_path, assign("reference.waypoints", "[[0, 1], [2.5, 3, 0.5]]"))
    assert loaded.settings.reference.waypoints == [[0.0, 1.0, 0.0], [2.5, 3.0, 0.5]]


# --- overrides ---


def test_overrides_go_before_the_file_and_later_ones_before_earlier(tmp_path: Path) -> None:
    toml = assign("radio.delay_frames", "1")
    assert load(tmp_path, toml).settings.radio.delay_frames == 1
    assert load(tmp_path, toml, "radio.delay_frames=2").settings.radio.delay_frames == 2
    assert load(tmp_path, toml, "radio.delay_frames=2", " radio.delay_frames = 3").settings.radio.delay_frames == 3


def test_overrides_leave_their_sections_other_fields_alone(tmp_path: Path) -> None:
    loaded = load(tmp_path, assign("firmware.kp", "0.5"), "firmware.ki=2")
    assert (loaded.settings.firmware.kp, loaded.settings.firmware.ki) == (0.5, 2.0)


def test_overrides_take_lists_and_bare_words(tmp_path: Path) -> None:
    loaded = load(tmp_path, "", "reference.waypoints=[[0,0],[0.5,0]]", "reference.mode=iterated")
    assert loaded.settings.reference.waypoints == [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]
    assert loaded.settings.reference.mode == "iterated"


def test_the_callers_head_goes_before_the_file(tmp_path: Path) -> None:
    loaded = load(tmp_path, 'plant = "mujoco"\nseeds = 2', plant="kinematic", controllers=("flc",))
    assert (loaded.plant, loaded.seeds, loaded.controllers) == ("kinematic", 2, ("flc",))


# --- what is refused: (what is given, words the message must contain) ---

HEAD_ERRORS = {
    'plant = "mujco"': ["mujco", "did you mean 'mujoco'", "kinematic"],
    "plant = 3": ["plant", "string", "3"],
    'controllers = ["comp-fcl"]': ["comp-fcl", "did you mean 'comp-flc'", "flc"],
    "controllers = []": ["controllers", "at least one"],
    'controllers = "flc"': ["controllers", "list"],
    "controllers = [3]": ["3", "comp-flc"],
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


# --- writing and reading again ---


@pytest.mark.parametrize("name", scenario.builtin())
def test_what_is_written_is_read_as_the_same(tmp_path: Path, name: str) -> None:
    loaded = scenario.load(name, ["firmware.ki=0.1", "reference.mode=iterated"], {"seed": 5, "seeds": 2})
    assert load(tmp_path, loaded.to_toml()) == loaded


def test_every_setting_is_written_out() -> None:
    data = tomllib.loads(scenario.load("rect").to_toml())
    written = {f"{section}.{name}" for section, values in data.items() if isinstance(values, dict) for name in values}
    assert written == set(SETTINGS)


def value_of(field: dataclasses.Field[Any]) -> st.SearchStrategy[Any]:
    meta = field.metadata
    if meta["choices"]:
        return st.sampled_from(meta["choices"])
    if field.type is bool:
        return st.booleans()
    if meta["low"] is None:
        coordinate = st.floats(-100, 100)
        return st.lists(st.tuples(coordinate, coordinate, coordinate).map(list), min_size=2, max_size=5)
    return (st.integers if field.type is int else st.floats)(meta["low"], meta["high"])


sections = {
    section.name: st.builds(
        section.default_factory,  # type: ignore[arg-type]
        **{field.name: value_of(field) for field in dataclasses.fields(section.default_factory)},  # type: ignore[arg-type]
    )
    for section in dataclasses.fields(Settings)
}
scenarios = st.builds(
    Scenario,
    name=st.from_regex(r"[\w.-]{1,20}", fullmatch=True),
    description=st.text(max_size=40),
    paper_table=st.sampled_from([0, 3, 4]),
    plant=st.sampled_from(scenario.PLANTS),
    controllers=st.lists(st.sampled_from(list(TRACKERS)), min_size=1, unique=True).map(tuple),
    seed=st.integers(0, 2**62),
    seeds=st.integers(1, 100_000),
    settings=st.builds(Settings, **sections).filter(lambda s: s.kinematic.alpha_low <= s.kinematic.alpha_high),
)


@hypothesis_settings(
    deadline=None,
    max_examples=60,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(original=scenarios)
def test_any_scenario_survives_writing_and_reading(tmp_path: Path, original: Scenario) -> None:
    # The folder is shared between examples, each of which replaces the file.
    assert load(tmp_path, original.to_toml()) == original

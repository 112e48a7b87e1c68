"""Scenarios: what is read, and that writing and reading it again changes nothing."""

import dataclasses
import json
import math
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scenario_texts import NUMBERS, SETTINGS, WHOLE, assign, load

from omni_control.controllers import CONTROLLERS
from omni_control.reference.curves import CURVES
from omni_mj.scenarios import scenario
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import Settings

# --- what is read ---


def test_the_papers_scenarios_come_with_the_package() -> None:
    assert {"rect", "rect-noise"} <= set(scenario.builtin())


@pytest.mark.parametrize("name", scenario.builtin())
def test_built_in_scenarios_load(name: str) -> None:
    loaded = scenario.load(name)
    assert loaded.name == name
    assert loaded.description
    assert set(loaded.controllers) <= set(CONTROLLERS)


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


# What a setting at its bounds needs of another.
COMPANIONS = {
    "kinematic.alpha_low": ["kinematic.alpha_high=2"],
    "kinematic.alpha_high": ["kinematic.alpha_low=0"],
    "radio.jitter_frames": ["radio.delay_frames=600"],
}


@pytest.mark.parametrize("name", NUMBERS)
def test_both_bounds_of_a_setting_are_allowed(tmp_path: Path, name: str) -> None:
    section, field = name.split(".")
    companion = COMPANIONS.get(name, [])
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


# --- writing and reading again ---


@pytest.mark.parametrize("name", scenario.builtin())
def test_what_is_written_is_read_as_the_same(tmp_path: Path, name: str) -> None:
    loaded = scenario.load(name, ["firmware.ki=0.1", "wheels.model=contact-roller"], {"seed": 5, "seeds": 2})
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


def agreed(settings: Settings) -> Settings:
    """The same with those values changed that other values forbid."""
    low, high = sorted([settings.kinematic.alpha_low, settings.kinematic.alpha_high])
    jitter, delay = sorted([settings.radio.jitter_frames, settings.radio.delay_frames])
    mode = "timed" if settings.reference.shape in CURVES else settings.reference.mode
    return dataclasses.replace(
        settings,
        reference=dataclasses.replace(settings.reference, mode=mode),
        kinematic=dataclasses.replace(settings.kinematic, alpha_low=low, alpha_high=high),
        radio=dataclasses.replace(settings.radio, jitter_frames=jitter, delay_frames=delay),
    )


scenarios = st.builds(
    Scenario,
    name=st.from_regex(r"[\w.-]{1,20}", fullmatch=True),
    description=st.text(max_size=40),
    paper_table=st.sampled_from([0, 3, 4]),
    plant=st.sampled_from(scenario.PLANTS),
    controllers=st.lists(st.sampled_from(list(CONTROLLERS)), min_size=1, unique=True).map(tuple),
    seed=st.integers(0, 2**62),
    seeds=st.integers(1, 100_000),
    settings=st.builds(Settings, **sections).map(agreed),
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

"""Scenarios: what is read, and that writing and reading it again changes nothing."""

import inspect
import math
import subprocess
import sys
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scenario_texts import SETTINGS, SHEET, assign, load
from scenario_texts import given as sections_of

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_control.reference.curves import CURVES
from omni_control.registry import CONTROLLERS
from omni_mj.scenarios import scenario
from omni_mj.scenarios.checking import Setting
from omni_mj.scenarios.library import builtin
from omni_mj.scenarios.plants import PLANTS
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import Settings

# --- what is read ---


def test_built_in_scenarios_load() -> None:
    assert {"rect", "rect-noise"} <= set(builtin())
    for name in builtin():
        loaded = scenario.load(name)
        assert loaded == scenario.scenario(name)
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
    assert load(tmp_path, "") == Scenario(name="given")
    assert Scenario(name="given").settings == Settings()


def test_head_fields_are_read(tmp_path: Path) -> None:
    toml = (
        'name = "mine"\ndescription = "what it is"\npaper_table = 4\nplant = "kinematic"\nrobot = "tigers-v2016"\n'
        'controllers = ["comp-flc"]\nseed = 7\nseeds = 3\n'
    )
    loaded = load(tmp_path, toml)
    assert loaded == Scenario(
        name="mine", description="what it is", paper_table=4, plant="kinematic", controllers=["comp-flc"], seed=7,
        seeds=3,
    )  # fmt: skip
    assert loaded.seed_list == [7, 8, 9]


def test_whole_numbers_serve_where_a_number_is_wanted(tmp_path: Path) -> None:
    value = load(tmp_path, assign("battery.cut_off_v", "13")).settings.battery.cut_off_v
    assert value == 13.0
    assert isinstance(value, float)


# --- overrides ---


def test_overrides_go_before_the_file_and_later_ones_before_earlier(tmp_path: Path) -> None:
    toml = assign("radio.delay_frames", "1")
    assert load(tmp_path, toml).settings.radio.delay_frames == 1
    assert load(tmp_path, toml, "radio.delay_frames=2").settings.radio.delay_frames == 2
    assert load(tmp_path, toml, "radio.delay_frames=2", " radio.delay_frames = 3").settings.radio.delay_frames == 3


def test_overrides_leave_their_sections_other_fields_alone(tmp_path: Path) -> None:
    loaded = load(tmp_path, assign("firmware.kp", "0.5"), "firmware.ki=2")
    assert (loaded.settings.firmware.kp, loaded.settings.firmware.ki) == (0.5, 2.0)
    changed = scenario.scenario(tmp_path / "given.toml", firmware={"ki": 2.0})
    assert changed == loaded


def test_overrides_take_lists_and_bare_words(tmp_path: Path) -> None:
    loaded = load(tmp_path, "", "reference.waypoints=[[0,0],[0.5,0]]", "reference.mode=iterated")
    assert loaded.settings.reference.waypoints == ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
    assert loaded.settings.reference.mode == "iterated"


def test_the_callers_head_goes_before_the_file(tmp_path: Path) -> None:
    loaded = load(tmp_path, 'plant = "mujoco"\nseeds = 2', plant="kinematic", controllers=("flc",))
    assert (loaded.plant, loaded.seeds, loaded.controllers) == ("kinematic", 2, ("flc",))
    made = scenario.scenario(tmp_path / "given.toml", plant="kinematic", controllers=["flc"])
    assert made == loaded
    assert loaded.replace(seeds=3) == made.replace(seeds=3)
    with pytest.raises(OmniError, match="seeds must be"):
        loaded.replace(seeds=0)


# --- writing and reading again ---


def test_what_is_written_is_read_as_the_same(tmp_path: Path) -> None:
    for name in builtin():
        loaded = scenario.load(name, ["firmware.ki=0.1", "wheels.model=two-rollers"], {"seed": 5, "seeds": 2})
        assert load(tmp_path, loaded.to_toml()) == loaded


def test_every_setting_is_written_out() -> None:
    data = tomllib.loads(scenario.load("rect").to_toml())
    written = {f"{section}.{name}" for section, values in data.items() if isinstance(values, dict) for name in values}
    assert written == set(SETTINGS)


class Mine(Controller):
    """Of a user."""

    gain: float = 3.0


def test_a_class_is_written_as_the_file_it_is_in() -> None:
    made = scenario.scenario("rect", controllers=["flc", Mine], controller={"Mine": {"gain": 4}})
    assert made.labels == ("flc", "Mine")
    data = tomllib.loads(made.to_toml())
    assert data["controllers"] == ["flc", f"{inspect.getfile(Mine)}:Mine"]
    assert data["controller"] == {"Mine": {"gain": 4.0}}
    with pytest.raises(OmniError, match="'Mine' is named twice"):
        made.replace(controllers=[Mine, "x.py:Mine"])


def value_of(setting: Setting) -> st.SearchStrategy[Any]:
    if setting.choices:
        return st.sampled_from(setting.choices)
    if setting.kind is bool:
        return st.booleans()
    if setting.kind is tuple and setting.unit == "deg":
        return st.lists(st.floats(-360, 360), min_size=3, max_size=8)
    if setting.kind is tuple:
        coordinate = st.floats(-100, 100)
        if setting.numbers == 4:
            patch = st.tuples(coordinate, coordinate, st.floats(0.001, 100), st.floats(0.01, 5))
            return st.lists(patch, max_size=5)
        return st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=2, max_size=5)
    return (st.integers if setting.kind is int else st.floats)(setting.low, setting.high)


def agreed(values: dict[str, Any]) -> dict[str, Any]:
    """The same with those values changed that other values forbid."""
    values["kinematic.alpha_low"], values["kinematic.alpha_high"] = sorted(
        [values["kinematic.alpha_low"], values["kinematic.alpha_high"]]
    )
    values["radio.jitter_frames"], values["radio.delay_frames"] = sorted(
        [values["radio.jitter_frames"], values["radio.delay_frames"]]
    )
    if values["reference.shape"] in CURVES:
        values["reference.mode"] = "timed"
    if values["reference.max_side_acceleration_m_s2"] < 0.01:
        values["reference.max_side_acceleration_m_s2"] = 0.0
    for jerk in ("reference.max_jerk_m_s3", "reference.max_turn_jerk_rad_s3"):
        if values[jerk] < 0.1 or values["reference.mode"] == "iterated":
            values[jerk] = 0.0
    kept = ("model.", "body.", "wheels.", "battery.cells", "battery.cut_off_v", "firmware.rate_hz")
    kept += ("sensors.encoder_counts",)
    values |= {name: each.default for name, each in SETTINGS.items() if name.startswith(kept)}
    temperatures = [values[f"motor.{name}_c"] for name in ("limit", "winding", "housing", "ambient")]
    least = -0.5 / max(1, *(abs(each - 25) for each in temperatures))  # of what is left at the coldest and hottest
    for name in ("motor.copper_per_k", "motor.magnet_per_k"):
        values[name] = min(max(values[name], least), -least)
    share = min(max(values["motor.nominal_voltage_v"] / 24, 0.1), 10)
    values |= {name: SETTINGS[name].default * (share if name in SHEET[:4] else 1) for name in SHEET}
    return sections_of(values)


scenarios = st.builds(
    Scenario,
    name=st.from_regex(r"[\w.-]{1,20}", fullmatch=True),
    description=st.text(st.characters(categories=["L", "M", "N", "P", "S"]), max_size=40),
    paper_table=st.sampled_from([0, 3, 4]),
    plant=st.sampled_from(list(PLANTS)),
    controllers=st.lists(st.sampled_from(list(CONTROLLERS)), min_size=1, unique=True).map(tuple),
    seed=st.integers(0, 2**62),
    seeds=st.integers(1, 100_000),
    settings=st.fixed_dictionaries({name: value_of(setting) for name, setting in SETTINGS.items()}).map(agreed),
)


@hypothesis_settings(
    deadline=None,
    max_examples=25,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(original=scenarios)
def test_any_scenario_survives_writing_and_reading(tmp_path: Path, original: Scenario) -> None:
    # The folder is shared between examples, each of which replaces the file.
    assert load(tmp_path, original.to_toml()) == original


def test_settings_need_neither_mujoco_nor_scipy() -> None:
    """They are imported by whoever lists them."""
    code = "import sys, omni_mj.scenarios.settings; print({'mujoco', 'scipy'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "set()"

"""All settings of the JSON schema: bounds, error messages, and files that read back."""

import io
import json
import math
from contextlib import redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import invoke
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import omni_mj as om

MAX_LINE_LENGTH = 4000  # longest line of a message
# Other settings that a setting at its bounds needs.
COMPANIONS = {
    "kinematic.alpha_low": {"kinematic": {"alpha_high": 2.0}},
    "kinematic.alpha_high": {"kinematic": {"alpha_low": 0.0}},
    "radio.jitter_frames": {"radio": {"delay_frames": 600}},
    "battery.series_cells": {"battery": {"cut_off_v": 3.0}},
    "motor.torque_constant_per_k": {"motor": {"max_winding_c": 100.0}},
}
# Settings whose bounds contradict others: the rows of a motor's datasheet, body and wheels.
CONTRADICTORY = "body.", "wheels.", "battery.cut_off_v", "sensors.encoder_counts"
DATASHEET = (
    "nominal_voltage_v",
    "torque_constant_nm_a",
    "nominal_torque_nm",
    "resistance_ohm",
    "no_load_rpm",
    "no_load_current_a",
    "nominal_rpm",
    "nominal_current_a",
)


@cache
def schema() -> dict[str, Any]:
    out = io.StringIO()
    with redirect_stdout(out):
        assert invoke("schema") == 0
    return json.loads(out.getvalue())


def setting_schemas() -> dict[str, dict[str, Any]]:
    """Return the schema of every setting by `section.field`."""
    json_schema, properties = schema(), {}
    for section, node in json_schema["properties"].items():
        if "$ref" in node:
            fields = json_schema["$defs"][node["$ref"].rpartition("/")[2]]["properties"]
            properties |= {f"{section}.{name}": field for name, field in fields.items()}
    return properties


def number_schemas() -> dict[str, dict[str, Any]]:
    """Return the schema of every number."""
    fields = {
        name: field
        for name, field in setting_schemas().items()
        if isinstance(field.get("type"), list)
    }
    return {name: field | {"type": field["type"][0]} for name, field in fields.items()}


def group_by_section(values: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return a mapping section -> field -> value for values by `section.field`."""
    result: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        section, field = name.split(".")
        result.setdefault(section, {})[field] = value
    return result


def error_lines(**changes: Any) -> list[str]:
    """Return the lines of the error message of a scenario with these sections."""
    with pytest.raises(om.OmniError) as error:
        om.load_scenario("rect", **changes)
    return str(error.value).splitlines()


def test_every_setting_has_a_meaning_and_the_unit_in_its_name() -> None:
    units = {
        "_m_s2": "m/s^2",
        "_m_s": "m/s",
        "_rad_s": "rad/s",
        "_frames": "frames",
        "_kg": "kg",
        "_v": "V",
        "_c": "deg C",
    }
    fields = setting_schemas()
    assert len(fields) > 110
    for name, field in fields.items():
        assert field["description"], name
        suffix = next((suffix for suffix in units if name.endswith(suffix)), None)
        assert suffix is None or field["unit"] == units[suffix], name


def test_bounds_are_allowed_and_values_beyond_are_rejected() -> None:
    """Check bounds and the next values beyond them. Messages give range and unit."""
    for name, field in number_schemas().items():
        section, _, key = name.partition(".")
        is_integer = field["type"] == "integer"
        for bound, sign in ((field["minimum"], -1), (field["maximum"], 1)):
            if not name.startswith(CONTRADICTORY) and key not in DATASHEET:
                changes = COMPANIONS.get(name, {}).get(section, {}) | {key: bound}
                scenario = om.load_scenario("rect", **{section: changes}).settings
                assert getattr(getattr(scenario, section), key) == bound, name
            wrong = bound + sign if is_integer else math.nextafter(bound, sign * math.inf)
            (line,) = error_lines(**{section: {key: wrong}})
            for word in (
                name,
                f"({field['minimum']:.15g} to {field['maximum']:.15g}",
                field["unit"],
                repr(wrong),
            ):
                assert word in line, name


@pytest.mark.parametrize(
    "wrong",
    [math.nan, math.inf, True, "1", [1], None, 10**400, 10**5000, np.array([1, 2])],
    ids=lambda v: type(v).__name__,
)
def test_all_wrong_types_are_reported_at_once(wrong: Any) -> None:
    names = [
        line.split(" ")[0]
        for line in error_lines(**group_by_section(dict.fromkeys(number_schemas(), wrong)))
    ]
    assert sorted(names) == sorted(number_schemas())


def test_numpy_numbers_and_ints_are_converted() -> None:
    scenario = om.load_scenario(
        "rect", radio={"delay_frames": np.int64(3)}, battery={"cut_off_v": np.float32(13)}
    ).settings
    assert (type(scenario.radio.delay_frames), type(scenario.battery.cut_off_v)) == (int, float)
    assert (
        scenario
        == om.load_scenario("rect", radio={"delay_frames": 3}, battery={"cut_off_v": 13}).settings
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"radio": {"delay": 3}}, ["radio.delay", "did you mean 'radio.delay_frames'"]),
        ({"radoi": {"delay_frames": 3}}, ["radoi", "did you mean 'radio'"]),
        ({"radio": 3}, ["radio", "[radio]"]),
        ({"firmware": {"thermal_derating": 1}}, ["firmware.thermal_derating", "boolean"]),
        (
            {"reference": {"mode": "iterate"}},
            ["reference.mode", "'timed' or 'iterated'", "'iterate'"],
        ),
        ({"reference": {"waypoints": [[0, 0]]}}, ["reference.waypoints", "at least 2"]),
        ({"reference": {"waypoints": [[0, 0], [1]]}}, ["reference.waypoints[1]"]),
        (
            {"reference": {"waypoints": [[0, 0], [100.1, 0]]}},
            ["reference.waypoints[1][0]", "100.1"],
        ),
        (
            {"reference": {"waypoints": [[0, 0], [1, 0, 90], [0, 0]]}},
            ["reference.waypoints", "in rad", "got 90", "degrees"],
        ),
        ({"reference": {"waypoints": [[0, 0, -45], [1, 0, -45]]}}, ["in rad", "got -45"]),
        ({"world": {"start_poses": [[0, 0, 180]]}}, ["world.start_poses", "in rad", "got 180"]),
        ({"world": {"start_poses": [[0, 0]] * 13}}, ["world.start_poses", "at most 12 items"]),
        ({"carpet": {"patches": [[0, 0, 0, 1]]}}, ["carpet.patches[0][2]", "greater than 0"]),
        ({"carpet": {"patches": [[0, 0, 1, 5.1]]}}, ["carpet.patches[0][3]", "5"]),
        ({"kinematic": {"alpha_low": 1.5}}, ["kinematic.alpha_low", "alpha_high"]),
        ({"radio": {"jitter_frames": 9}}, ["radio.jitter_frames", "radio.delay_frames"]),
        (
            {"reference": {"shape": "figure-eight", "mode": "iterated"}},
            ["reference.shape = figure-eight needs"],
        ),
        *(
            ({"reference": {name: 1e-6}}, [f"reference.{name}", "0 or at least 0.01"])
            for name in (
                "max_jerk_m_s3",
                "max_turn_jerk_rad_s3",
                "max_sideways_acceleration_m_s2",
            )
        ),
        ({"firmware": {"rate_hz": 200}}, ["firmware.rate_hz", "960, 480, 320"]),
        ({"controller": {"flc": {"gain": 3}}}, ["controller.flc", "no parameter 'gain'"]),
        ({"controller": {"fcl": {"gain": 3}}}, ["controller.fcl", "did you mean 'flc'"]),
        ({"seeds": 0}, ["seeds", "1 to 100000"]),
        ({"plant": "mujocco"}, ["did you mean 'mujoco'"]),
        ({"robot": "tigers-v201"}, ["did you mean 'tigers-v2016'"]),
        ({"controllers": ["comp-fcl"]}, ["did you mean 'comp-flc'"]),
        ({"controllers": ["flc", "flc"]}, ["named twice"]),
        ({"model": "nowhere.xml"}, ["nowhere.xml"]),
    ],
    ids=str,
)
def test_messages_give_allowed_values_or_the_nearest_name(
    changes: dict[str, Any], words: list[str]
) -> None:
    lines = error_lines(**changes)
    assert any(all(word in line for word in words) for line in lines), lines


def test_scenarios_are_immutable_and_can_be_copied() -> None:
    rect = om.load_scenario("rect")
    with pytest.raises(ValueError, match="frozen"):
        rect.settings.radio.delay_frames = 3  # type: ignore[misc]
    changed = rect.replace(settings=rect.settings.replace(radio={"delay_frames": 3}))
    assert changed.settings.radio.jitter_frames == rect.settings.radio.jitter_frames
    assert changed == om.load_scenario("rect", radio={"delay_frames": 3})
    assert hash(changed.settings) == hash(
        om.load_scenario("rect", radio={"delay_frames": 3}).settings
    )
    with pytest.raises(om.OmniError, match="another robot has other settings"):
        rect.replace(robot="tigers-v2020")


# Files.


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 50_000 + "]" * 50_000, "nested too deeply"),
        ("seed = " + "9" * 5000, "not valid TOML"),
        ("[body", "not valid TOML"),
        ("description = '" + "a" * 3_000_000 + "'", "more than 2 MB"),
        (f"description = '{'a' * 1000}'", "at most 500"),
        ('description = "\\u001b[31mred\\u0007"', "description"),
        ("name = '../x'", "name"),
        ('"\\u001b[31m\\n\\u2028" = 1', "unknown name"),
        ('[radio]\n"\\u001b[31m\\nloss" = 1', "unknown setting radio"),
        ("[radio]\ndelay_frames = " + "[" * 90 + "]" * 90, "radio.delay_frames"),
    ],
    ids=lambda text: text[:20],
)
def test_errors_of_malicious_files_are_printable_lines(
    tmp_path: Path, text: str, words: str
) -> None:
    file = tmp_path / "scenario.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(om.OmniError) as error:
        om.load_scenario(file)
    assert words in str(error.value)
    assert all(
        line.isprintable() and len(line) < MAX_LINE_LENGTH for line in str(error.value).split("\n")
    )


VALUES = st.one_of(
    st.floats(), st.integers(), st.booleans(), st.text(max_size=20),
    st.sampled_from([0, 1, -1, 1e-300, 1e300, "on"]),
    st.lists(st.lists(st.floats(), max_size=4), max_size=4),
)  # fmt: skip


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.dictionaries(
        st.deferred(lambda: st.sampled_from(sorted(setting_schemas()))),
        VALUES,
        min_size=1,
        max_size=4,
    )
)
@example(values={"model.file": "\U00018cd6"})
def test_random_settings_read_back_or_give_printable_errors(
    tmp_path: Path, values: dict[str, object]
) -> None:
    scenario, error = None, ""
    try:
        scenario = om.load_scenario("rect", **group_by_section(values))
    except om.OmniError as omni_error:
        error = str(omni_error)
    assert all(line.isprintable() and len(line) < MAX_LINE_LENGTH for line in error.split("\n"))
    if scenario is None:
        assert error
        return
    (tmp_path / "scenario.toml").write_text(scenario.to_toml(), encoding="utf-8")
    assert om.load_scenario(tmp_path / "scenario.toml") == scenario

"""Settings as the schema lists them: their bounds, what is refused and how, all at once, and files that read back."""

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

LINE = 4000  # longest line of a message
# What a setting at its bounds needs of another.
COMPANIONS = {
    "kinematic.alpha_low": {"kinematic": {"alpha_high": 2.0}},
    "kinematic.alpha_high": {"kinematic": {"alpha_low": 0.0}},
    "radio.jitter_frames": {"radio": {"delay_frames": 600}},
    "battery.series_cells": {"battery": {"cut_off_v": 3.0}},
    "motor.torque_constant_per_k": {"motor": {"max_winding_c": 100.0}},
}
# Which other numbers bound as well: the rows of a motor's datasheet, a body on its wheels.
BOUND = "body.", "wheels.", "battery.cut_off_v", "sensors.encoder_counts"
SHEET = (
    "nominal_voltage_v",
    "torque_constant_nm_a",
    "nominal_torque_nm",
    "resistance_ohm",
    "no_load_rpm",
    "no_load_current_a",
)
SHEET += ("nominal_rpm", "nominal_current_a")


@cache
def schema() -> dict[str, Any]:
    out = io.StringIO()
    with redirect_stdout(out):
        assert invoke("schema") == 0
    return json.loads(out.getvalue())


def declared() -> dict[str, dict[str, Any]]:
    """Return the schema of every setting by `section.field`."""
    whole, found = schema(), {}
    for section, node in whole["properties"].items():
        if "$ref" in node:
            fields = whole["$defs"][node["$ref"].rpartition("/")[2]]["properties"]
            found |= {f"{section}.{name}": field for name, field in fields.items()}
    return found


def numbers() -> dict[str, dict[str, Any]]:
    """Return the schema of every number."""
    fields = {
        name: field for name, field in declared().items() if isinstance(field.get("type"), list)
    }
    return {name: field | {"type": field["type"][0]} for name, field in fields.items()}


def sections(values: dict[str, Any]) -> dict[str, dict[str, Any]]:
    result: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        section, field = name.split(".")
        result.setdefault(section, {})[field] = value
    return result


def lines(**changes: Any) -> list[str]:
    """Return the lines of the message with which these sections are refused."""
    with pytest.raises(om.OmniError) as error:
        om.load_scenario("rect", **changes)
    return str(error.value).splitlines()


def test_every_setting_has_a_meaning_and_a_unit_that_its_name_does_not_contradict() -> None:
    units = {
        "_m_s2": "m/s^2",
        "_m_s": "m/s",
        "_rad_s": "rad/s",
        "_frames": "frames",
        "_kg": "kg",
        "_v": "V",
        "_c": "deg C",
    }
    fields = declared()
    assert len(fields) > 110
    for name, field in fields.items():
        assert field["description"], name
        suffix = next((suffix for suffix in units if name.endswith(suffix)), None)
        assert suffix is None or field["unit"] == units[suffix], name


def test_both_bounds_are_allowed_and_what_is_beyond_is_refused() -> None:
    """The message says what is allowed and in what unit."""
    for name, field in numbers().items():
        section, _, key = name.partition(".")
        whole = field["type"] == "integer"
        for bound, sign in ((field["minimum"], -1), (field["maximum"], 1)):
            if not name.startswith(BOUND) and key not in SHEET:
                changes = COMPANIONS.get(name, {}).get(section, {}) | {key: bound}
                made = om.load_scenario("rect", **{section: changes}).settings
                assert getattr(getattr(made, section), key) == bound, name
            wrong = bound + sign if whole else math.nextafter(bound, sign * math.inf)
            (line,) = lines(**{section: {key: wrong}})
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
def test_what_is_no_number_is_refused_for_all_settings_at_once(wrong: Any) -> None:
    refused = [line.split(" ")[0] for line in lines(**sections(dict.fromkeys(numbers(), wrong)))]
    assert sorted(refused) == sorted(numbers())


def test_numbers_of_numpy_and_whole_numbers_serve_where_a_number_is_needed() -> None:
    made = om.load_scenario(
        "rect", radio={"delay_frames": np.int64(3)}, battery={"cut_off_v": np.float32(13)}
    ).settings
    assert (type(made.radio.delay_frames), type(made.battery.cut_off_v)) == (int, float)
    assert (
        made
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
        ({"world": {"start_poses": [[0, 0]] * 13}}, ["world.start_poses", "at most 12 items"]),
        ({"carpet": {"patches": [[0, 0, 0, 1]]}}, ["carpet.patches[0][2]", "greater than 0"]),
        ({"carpet": {"patches": [[0, 0, 1, 5.1]]}}, ["carpet.patches[0][3]", "5"]),
        ({"kinematic": {"alpha_low": 1.5}}, ["kinematic.alpha_low", "alpha_high"]),
        ({"radio": {"jitter_frames": 9}}, ["radio.jitter_frames", "radio.delay_frames"]),
        (
            {"reference": {"shape": "figure-eight", "mode": "iterated"}},
            ["reference.shape = figure-eight needs"],
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
def test_what_is_wrong_is_a_line_with_the_allowed_values_or_the_nearest_name(
    changes: dict[str, Any], words: list[str]
) -> None:
    found = lines(**changes)
    assert any(all(word in line for word in words) for line in found), found


def test_a_scenario_cannot_be_changed_but_copied() -> None:
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
def test_absurd_files_are_lines_that_can_be_printed(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "given.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(om.OmniError) as error:
        om.load_scenario(file)
    assert words in str(error.value)
    assert all(line.isprintable() and len(line) < LINE for line in str(error.value).split("\n"))


VALUES = st.one_of(
    st.floats(), st.integers(), st.booleans(), st.text(max_size=20), st.sampled_from([0, 1, -1, 1e-300, 1e300, "on"]),
    st.lists(st.lists(st.floats(), max_size=4), max_size=4),
)  # fmt: skip


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.dictionaries(
        st.deferred(lambda: st.sampled_from(sorted(declared()))), VALUES, min_size=1, max_size=4
    )
)
@example(values={"model.file": "\U00018cd6"})
def test_any_settings_are_a_scenario_that_reads_back_or_lines(
    tmp_path: Path, values: dict[str, object]
) -> None:
    made, error = None, ""
    try:
        made = om.load_scenario("rect", **sections(values))
    except om.OmniError as refusal:
        error = str(refusal)
    assert all(line.isprintable() and len(line) < LINE for line in error.split("\n"))
    if made is None:
        assert error
        return
    (tmp_path / "made.toml").write_text(made.to_toml(), encoding="utf-8")
    assert om.load_scenario(tmp_path / "made.toml") == made

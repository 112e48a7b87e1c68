"""The JSON Schema of scenarios: what editors are told is what is checked."""

import json
import tomllib
from typing import Any

from scenario_texts import SETTINGS

from omni_mj.scenarios.library import builtin
from omni_mj.scenarios.schema import PATH, schema, text


def test_the_file_is_up_to_date() -> None:
    """Otherwise: python -m omni_mj.scenarios.schema."""
    assert PATH.read_text(encoding="utf-8") == text()


def test_every_setting_is_in_it_with_its_unit_range_and_default() -> None:
    properties = json.loads(text())["properties"]
    for name, each in SETTINGS.items():
        section, field = name.split(".")
        told = properties[section]["properties"][field]
        assert told["description"].startswith(each.doc)
        assert each.unit in told["description"]
        assert told["default"] == json.loads(json.dumps(each.default))
        if each.number:
            assert (told["minimum"], told["maximum"]) == (each.low, each.high)
            assert told["type"] == ("integer" if each.kind is int else "number")
        if each.choices:
            assert told["enum"] == list(each.choices)


def fits(value: Any, told: dict[str, Any]) -> bool:
    """Whether a value is what a schema allows, as far as ours use JSON Schema."""
    kinds = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "boolean": bool}
    if not isinstance(value, kinds[told["type"]]) or value not in told.get("enum", [value]):
        return False
    if isinstance(value, dict):
        known = told.get("properties", {})
        return value.keys() <= known.keys() and all(fits(each, known[name]) for name, each in value.items())
    if isinstance(value, list):
        count = told.get("minItems", 0) <= len(value) <= told.get("maxItems", len(value))
        return count and all(fits(each, told["items"]) for each in value)
    return isinstance(value, str) or told.get("minimum", value) <= value <= told.get("maximum", value)


def test_the_library_fits_it_and_names_it() -> None:
    """In its first line, as editors understand."""
    for path in builtin().values():
        lines = path.read_text(encoding="utf-8").splitlines()
        assert (path.parent / lines[0].removeprefix("#:schema ")).resolve() == PATH.resolve()
        assert fits(tomllib.loads("\n".join(lines)), schema()), path
    for wrong in (
        "[radio]\ndelay_frames = 601",
        "[radio]\ndelay = 1",
        'seeds = "1"',
        "[reference]\nwaypoints = [[0, 0]]",
    ):
        assert not fits(tomllib.loads(wrong), schema())

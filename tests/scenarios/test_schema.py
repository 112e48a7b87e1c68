"""The JSON Schema of scenarios: what editors are told is what is checked."""

import json
import tomllib

from scenario_texts import SETTINGS, fits

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
            assert told["type"] == ["integer" if each.kind is int else "number", "object"]  # or a distribution
        if each.choices:
            assert told["enum"] == list(each.choices)


def test_the_library_fits_it_and_names_it() -> None:
    """In its first line, as editors understand."""
    for path in builtin().values():
        lines = path.read_text(encoding="utf-8").splitlines()
        assert (path.parent / lines[0].removeprefix("#:schema ")).resolve() == PATH.resolve()
        assert fits(tomllib.loads("\n".join(lines)), schema()), path
    assert fits(
        {"radio": {"delay_frames": {"uniform": [1, 3]}}, "carpet": {"friction": {"choice": [0.5, 0.8]}}}, schema()
    )
    for wrong in (
        "[radio]\ndelay_frames = 601",
        "[radio]\ndelay = 1",
        "[radio]\ndelay_frames = {uniform = [1]}",
        "[radio]\ndelay_frames = {poisson = [1, 2]}",
        'seeds = "1"',
        "[reference]\nwaypoints = [[0, 0]]",
        "[fault]\nkind = 'vision-out'\nat = 1",
        "[[fault]]\nkind = 'vision'\nat = 1",
        "[[fault]]\nkind = 'push'\nat = 1",
        "[[fault]]\nkind = 'delay'\nat = 1\nto = 601",
    ):
        assert not fits(tomllib.loads(wrong), schema())

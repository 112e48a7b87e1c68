"""The JSON Schema of scenarios, with which editors of TOML complete, explain and check them.

`python -m omni_mj.scenarios.schema` writes it to scenario.schema.json, to which the library's files refer.
"""

import json
from pathlib import Path
from typing import Any

from omni_mj.scenarios import distributions, faults
from omni_mj.scenarios.checking import Checked, Setting
from omni_mj.scenarios.faults.base import HIGHEST
from omni_mj.scenarios.nested import plain
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import Settings

PATH = Path(__file__).with_name("scenario.schema.json")
_TYPES = {int: "integer", float: "number", bool: "boolean", str: "string"}
UNIT = "x-unit"  # a keyword of our own, which others ignore
_DRAWN = {
    "properties": {
        name: {"type": "array", "items": {"type": "number"}, "minItems": min(counts), "maxItems": max(counts)}
        for name, counts in distributions.KINDS.items()
    },
    "additionalProperties": False,
}
_NAME = r"^[\w.-]+$"


def schema() -> dict[str, Any]:
    """The schema of a scenario's file: fields, sections, units, ranges, choices and defaults.

    Plants, robots and controllers are open, since they may be a user's own.
    """
    head = {each.name: _field(each) for each in Scenario.declared()}
    del head["name"]["default"]  # it is the file's
    head["name"]["pattern"] = _NAME
    head["paper_table"]["enum"] = [0, 3, 4]
    head["controllers"] |= {"items": {"type": "string"}, "uniqueItems": True}
    sections = {name: _section(field.annotation) for name, field in Settings.model_fields.items() if name != "fault"}
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "a scenario of omni-mj",
        "type": "object",
        "additionalProperties": False,
        "properties": {**head, **sections, "fault": _faults()},
    }


def _section(kind: Any) -> dict[str, Any]:
    if not issubclass(kind, Checked):  # the parameters of controllers, which nobody knows but they
        values = {"type": "object", "additionalProperties": {"type": ["number", "boolean", "string"]}}
        return {"description": "parameters of each controller", "type": "object", "additionalProperties": values}
    return {
        "description": " ".join((kind.__doc__ or "").split()),
        "type": "object",
        "additionalProperties": False,
        "properties": {each.name: _field(each) for each in kind.declared()},
    }


def _faults() -> dict[str, Any]:
    kinds = []
    for name, kind in faults.KINDS.items():
        told = _section(kind)
        fields = told["properties"]
        fields["kind"]["enum"] = [name]
        kinds.append(told | {"required": [each for each in fields if each == "kind" or "default" not in fields[each]]})
    return {"description": "what happens while a run goes on", "type": "array", "items": {"oneOf": kinds}}


def _field(setting: Setting) -> dict[str, Any]:
    limits: dict[str, Any] = {"minimum": setting.low, "maximum": setting.high}
    kind: dict[str, Any] = {"type": _TYPES.get(setting.kind, "array")}
    if setting.kind is tuple:
        item: dict[str, Any] = {"type": "number", "minimum": -360, "maximum": 360}
        if not setting.unit:
            item = {"type": "integer", "minimum": 0, "maximum": HIGHEST}
        if setting.numbers > 1:  # a pose may do without its heading
            least = 2 if setting.numbers == 3 else setting.numbers
            item = {"type": "array", "items": {"type": "number"}, "minItems": least, "maxItems": setting.numbers}
        limits = {"items": item, "minItems": setting.low, "maxItems": setting.high}
    if setting.choices:
        limits = {"enum": list(setting.choices)}
    if setting.number and setting.section:  # or drawn
        kind = {"type": [_TYPES[setting.kind], "object"]} | _DRAWN
    return {
        "description": setting.doc + (f" [{setting.unit}]" if setting.unit else ""),
        **kind,
        **{name: limit for name, limit in limits.items() if limit is not None},
        UNIT: setting.unit,
        **({} if setting.default is None else {"default": plain(setting.default)}),
    }


def text() -> str:
    """The schema as its file holds it."""
    return json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")

"""The JSON Schema of scenario files, with which editors of TOML complete, explain and check them."""

from typing import Any

from omni_mj.scenarios.distributions import KINDS
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import Settings, every_setting


def schema() -> dict[str, Any]:
    """Return the schema of a scenario's file: fields, sections, units, ranges, choices and defaults.

    Plants, robots and controllers are open, since they may be a user's own; numbers may be drawn.
    """
    scenario = Scenario.model_json_schema()
    definitions = scenario.pop("$defs")
    settings = definitions.pop("Settings")
    for each in every_setting():
        if each.number:
            section = definitions[Settings.model_fields[each.section].annotation.__name__]  # type: ignore[union-attr]
            number = section["properties"][each.name]
            rest = {key: number.pop(key) for key in ("description", "default", "unit", "title") if key in number}
            section["properties"][each.name] = rest | {"anyOf": [number.copy(), {"$ref": "#/$defs/Distribution"}]}
    definitions["Distribution"] = {
        "type": "object",
        "properties": {kind: {"type": "array", "description": form} for kind, form in KINDS.items()},
        "additionalProperties": False,
    }
    head = scenario["properties"]
    del head["settings"], head["distributions"]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "a scenario of omni-mj",
        "type": "object",
        "additionalProperties": False,
        "properties": head | settings["properties"],
        "$defs": definitions,
    }

"""What the tests of scenarios share: every setting, and scenarios given as text."""

from pathlib import Path
from typing import Any

import pytest

from omni_control.errors import OmniError
from omni_mj.scenarios import scenario
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import Settings, every_setting

SETTINGS = {each.full: each for each in every_setting()}
NUMBERS = {name: each for name, each in SETTINGS.items() if each.number}
SWITCHES = [name for name, each in SETTINGS.items() if each.kind is bool]
# Rows of a motor's datasheet that no motor has one without the other; the first four scale together at one current.
SHEET = [
    *("motor.nominal_voltage_v", "motor.constant_nm_a", "motor.nominal_torque_nm", "motor.resistance_ohm"),
    *("motor.no_load_rpm", "motor.no_load_current_a", "motor.nominal_rpm", "motor.nominal_current_a"),
]
WHOLE = [name for name, each in NUMBERS.items() if each.kind is int]


def load(tmp_path: Path, toml: str, *overrides: str, **head: Any) -> Scenario:
    path = tmp_path / "given.toml"
    path.write_text(toml, encoding="utf-8")
    return scenario.load(str(path), overrides, head, code=True)


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


def value_of(settings: Settings, name: str) -> Any:
    section, field = name.split(".")
    return getattr(getattr(settings, section), field)


def given(values: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Sections of settings from values by full name."""
    sections: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        section, field = name.split(".")
        sections.setdefault(section, {})[field] = value
    return sections


def errors(**sections: Any) -> list[str]:
    """The lines of the error that settings made of these sections raise."""
    with pytest.raises(OmniError) as error:
        Settings(**sections)
    return str(error.value).splitlines()


def fits(value: Any, told: dict[str, Any]) -> bool:
    """Whether a value is what a schema allows, as far as ours use JSON Schema."""
    if "oneOf" in told:
        return sum(fits(value, each) for each in told["oneOf"]) == 1
    if isinstance(told["type"], list):
        return any(fits(value, told | {"type": kind}) for kind in told["type"])
    kinds = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "boolean": bool}
    if not isinstance(value, kinds[told["type"]]) or value not in told.get("enum", [value]):
        return False
    if isinstance(value, dict):
        known = told.get("properties", {})
        return {*told.get("required", ())} <= value.keys() <= known.keys() and all(
            fits(each, known[name]) for name, each in value.items()
        )
    if isinstance(value, list):
        count = told.get("minItems", 0) <= len(value) <= told.get("maxItems", len(value))
        return count and all(fits(each, told["items"]) for each in value)
    return isinstance(value, str) or told.get("minimum", value) <= value <= told.get("maximum", value)

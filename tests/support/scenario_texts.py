"""What the tests of scenarios share: every setting, and scenarios given as text."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from omni_control.errors import OmniError
from omni_mj.scenarios import scenario
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import Settings


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

"""The numbers that a robot's model gives for settings.

A number under <custom> whose name is that of a setting, such as carpet.lint, is that setting's default for the robot.
What the default robot gives depends on the robot, so that every other must give it too. Numbers whose names have no dot
are for whoever reads the compiled model. The file alone is read, not what it includes.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from omni_control.errors import OmniError
from omni_mj.scenarios.checking import in_one
from omni_mj.scenarios.models import DEFAULT, model_path
from omni_mj.scenarios.nested import merged


def numbers(robot: str) -> Mapping[str, float]:
    """The numbers that a robot's model holds under <custom>, by name; see `model_path` for what a robot is.

    Raises:
        OmniError: there is no such robot, its file is no XML, or a setting has something else than one number.
    """
    path = model_path(robot)
    return _read(path, path.stat().st_mtime_ns)


def completed(sections: Mapping[str, Any], robot: str) -> dict[str, Any]:
    """Sections of settings, and below them those values that the robot's model gives.

    Raises:
        OmniError: neither gives what depends on the robot; a line for each such setting.
    """
    base: dict[str, Any] = {}
    for name, value in numbers(robot).items():
        section, dot, field = name.partition(".")
        if dot:
            base.setdefault(section, {})[field] = value
    whole = merged(base, sections)
    in_one(
        [
            f"{name} depends on the robot; give it in the scenario, or under <custom> in {model_path(robot)}"
            for name in numbers(DEFAULT)
            if "." in name and not _given(whole, *name.split("."))
        ]
    )
    return whole


def _given(sections: Mapping[str, Any], section: str, field: str) -> bool:
    values = sections.get(section, {})
    return field in values if isinstance(values, Mapping) else True  # a whole section, or what is none at all


@lru_cache
def _read(path: Path, changed: int) -> Mapping[str, float]:
    try:
        custom = ElementTree.parse(path).getroot().iterfind("custom/numeric")
    except (OSError, ElementTree.ParseError) as error:
        raise OmniError(f"cannot read the robot's model {path}: {error}") from None
    found = {}
    for numeric in custom:
        name, text = numeric.get("name", ""), numeric.get("data", "")
        try:
            found[name] = float(text) if any(c in text for c in ".eE") else int(text)
        except ValueError:
            if "." in name:  # what is no setting may be several numbers, or none
                raise OmniError(f"{name} in {path} must be one number, not {text!r}") from None
    return MappingProxyType(found)

"""Links with the state of a session: names of scenario and robots, and settings that differ."""

from collections.abc import Iterable, Mapping
from typing import Any
from urllib.parse import parse_qsl, urlencode

from omni_control.controllers.registry import CONTROLLERS
from omni_control.errors import OmniError, suggest_names
from omni_mj.config.plugins import PLANTS, format_controller_spec
from omni_mj.config.scenario import Scenario, load_with_overrides
from omni_mj.config.settings import Settings
from omni_mj.config.toml_files import find_builtin_files, format_toml_value

Sections = dict[str, Any]

NOT_IN_LINKS = ("fault", "model")  # sections with files and tables
MAX_SEED_DIGITS = 30


def format_link(scenario: Scenario) -> str:
    """Return the query of a link, such as `scenario=rect&radio.delay_frames=9`.

    Raises:
        OmniError: The scenario, the robot or a controller is not of this package, or faults differ.
    """
    names = {
        "scenario": scenario.name,
        "plant": scenario.plant,
        "robot": scenario.robot,
        "seed": str(scenario.seed),
        "controllers": ",".join(map(format_controller_spec, scenario.controllers)),
    }
    overrides: dict[str, str] = {}
    for _ in range(2):  # the second time for settings that depend on others
        base = _load_builtin(names | overrides)
        overrides |= _find_differences(scenario.settings.to_dict(), base.settings.to_dict())
    return urlencode(names | overrides, safe=",/")


def _find_differences(sections: Sections, base: Sections) -> dict[str, str]:
    """Return the settings that differ from those of a base, as text of TOML.

    Raises:
        OmniError: They differ in a section that links do not have.
    """
    differences = {}
    for section, fields in sections.items():
        if section in NOT_IN_LINKS and fields != base[section]:
            raise OmniError(f"a link has no {section} of its own")
        for field, value in fields.items() if section not in NOT_IN_LINKS else ():
            if value != base[section].get(field) and field != "backend":  # chosen at the start
                differences[f"{section}.{field}"] = format_toml_value(value)
    return differences


def load_link(query: str) -> Scenario:
    """Return the scenario of a link's query.

    Raises:
        OmniError: A name is not one of this package, or a value is not allowed.
    """
    values = dict(parse_qsl(query, keep_blank_values=True))
    return _load_builtin(values)


def _load_builtin(values: Mapping[str, str]) -> Scenario:
    """Return a scenario of this package with other values. A link must not name files."""
    known_names: dict[str, Iterable[str]] = {
        "scenario": find_builtin_files("scenarios"),
        "robot": find_builtin_files("robots"),
        "plant": PLANTS,
        "controllers": CONTROLLERS,
    }
    sections = [section for section in Settings.model_fields if section not in NOT_IN_LINKS]
    overrides, top_level = list[str](), dict[str, Any]()
    for key, value in values.items():
        section, dot, _ = key.partition(".")
        if dot and section in sections:
            overrides.append(f"{key}={value}")
        elif key == "seed":
            is_number = value.isdecimal() and len(value) < MAX_SEED_DIGITS
            top_level[key] = int(value) if is_number else value
        elif known := known_names.get(key):
            names = value.split(",")
            for name in names:
                if name not in known:
                    hint = suggest_names(name, known)
                    raise OmniError(f"unknown {key} {name!r} in a link; {hint}")
            top_level[key] = names if key == "controllers" else value
        else:
            names = [f"{name}." for name in sections] if dot else [*known_names, "seed"]
            raise OmniError(f"a link has no {key!r}; {suggest_names(key, names)}")
    return load_with_overrides(top_level.pop("scenario", "rect"), overrides, top_level)

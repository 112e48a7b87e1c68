"""Catalog of scenarios, controllers, plants, robots, settings and faults: lists and contents."""

import inspect
import json
import re
import shutil
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError, suggest_names
from omni_mj.config import robot_files, toml_files

if TYPE_CHECKING:
    from omni_mj.config.settings import Settings
    from omni_mj.config.validation import SettingInfo

PROPERTY_LABELS = ("default", "in", "allowed:")  # of default, unit and allowed values
TITLES = {  # title of a list -> option or section that uses its names
    "scenarios": "--scenario",
    "controllers": "--controller",
    "plants": "--plant",
    "robots": "--robot",
    "settings": "--set section.field=value",
    "faults": "[[fault]] in a scenario's file",
}
PIPE_WIDTH = 140  # columns if the output is no terminal
COMMENT_COLUMN = 40  # column in which the comments of settings start, if there is room
Entries = list[list[str]]  # name, properties and meaning of each entry


def print_lists(title: str | None, word: str) -> None:
    """Print the lists.

    Args:
        title: Title of the list to print, or None for all.
        word: Text that entries must contain, upper or lower case.

    Raises:
        OmniError: No entry contains the word.
    """
    lists = {name: list_entries(name) for name in ([title] if title else TITLES)}
    matches = {
        name: [entry for entry in entries if word.casefold() in " ".join(entry).casefold()]
        for name, entries in lists.items()
    }
    if not any(matches.values()):
        names = [entry[0] for entries in lists.values() for entry in entries]
        suggestion = suggest_names(
            word, sorted({segment for name in names for segment in name.split(".")})
        )
        raise OmniError(f"there is no {word!r} in the {title or 'lists'}; {suggestion}")
    for name, entries in matches.items():
        if entries:
            print(f"{name} ({TITLES[name]})")
            _print_entries(entries)


def list_entries(title: str) -> Entries:
    """Return the entries of a list. Each starts with the name and ends with the meaning."""
    match title:
        case "scenarios" | "robots":
            files = toml_files.find_builtin_files(title).items()
            return [
                [name, toml_files.read_toml(path).get("description", "")] for name, path in files
            ]
        case "controllers":
            from omni_control.controllers.registry import CONTROLLERS, find_missing_package
            from omni_control.install_hints import describe_installation

            entries = []
            for name, reference in CONTROLLERS.items():
                package = find_missing_package(name)
                hint = f" (needs {package}: {describe_installation(name)})" if package else ""
                entries.append([name, _docstring_summary(reference) + hint])
            return entries
        case "plants":
            from omni_mj.config.plugins import PLANTS

            return [[name, _docstring_summary(reference)] for name, reference in PLANTS.items()]
        case "settings":
            from omni_mj.config.settings import list_settings

            return [_setting_entry(setting.full_name, setting) for setting in list_settings()]
        case _:
            return list_faults()


def list_faults() -> Entries:
    """Return the fields of all faults, then each kind of fault with its other fields."""
    from omni_mj.config.faults import FAULT_KINDS, Fault

    entries = [_setting_entry(name, info) for name, info in Fault.describe_fields().items()]
    for name, kind in FAULT_KINDS.items():
        plants = f"plants {', '.join(kind.plants)}: " if kind.plants else ""
        meaning = plants + (kind.__doc__ or "").split("\n")[0]
        entries.append([f"kind = {name}", "", "", "", meaning])
        kind_fields = list(kind.describe_fields().items())[len(Fault.model_fields) :]
        entries += [_setting_entry(f"{name}.{field}", info) for field, info in kind_fields]
    return entries


def describe(name: str, overrides: Sequence[str] = (), robot: str | None = None) -> str:
    """Return the contents of a scenario, a robot or a controller as text.

    Those of a scenario or a robot are a TOML file that can be used.

    Args:
        name: Name, .toml file or file.py:Class.
        overrides: Settings to change in a scenario, as for `--set`.
        robot: Robot of the scenario. Default: its own.

    Raises:
        OmniError: The name is unknown, the file is invalid, or `overrides` or `robot` are given for
            anything but a scenario.
    """
    from omni_control.controllers.registry import CONTROLLERS
    from omni_mj.config.plugins import is_class_path

    scenarios, robots = map(toml_files.find_builtin_files, ("scenarios", "robots"))
    is_file = name.endswith(".toml")
    if name in robots or (is_file and _is_robot(name)):
        kind, describe_entry = "robot", _describe_robot
    elif name in scenarios or is_file:
        return _describe_scenario(name, overrides, robot)
    elif name in CONTROLLERS or is_class_path(name):
        kind, describe_entry = "controller", _describe_controller
    else:
        suggestion = suggest_names(name, [*scenarios, *robots, *CONTROLLERS])
        raise OmniError(
            f"there is nothing called {name!r}; {suggestion}, or a file: .toml, or file.py:Class"
        )
    if overrides or robot:
        raise OmniError(f"--set and --robot change a scenario; {name} is a {kind}")
    return describe_entry(name)


def format_sections(settings: "Settings", fields: Mapping[str, Iterable[str]]) -> str:
    """Return settings as TOML with units and meanings.

    Args:
        settings: The settings.
        fields: Section -> names of the fields to include.
    """
    values = settings.to_dict()
    lines = []
    for section, names in fields.items():
        lines += ["", f"[{section}]"]
        lines += [
            f"{name} = {toml_files.format_toml_value(values[section][name])}" for name in names
        ]
    return "\n".join(_add_comments(lines)) + "\n"


def _describe_scenario(name: str, overrides: Sequence[str], robot: str | None) -> str:
    """Return a scenario as TOML. Comments name the defaults of settings that differ from them."""
    from omni_mj.config.resolve import resolve_settings
    from omni_mj.config.scenario import load_with_overrides

    scenario = load_with_overrides(name, overrides, {"robot": robot} if robot else {})
    defaults = resolve_settings({}, scenario.robot).to_dict()
    return "\n".join(_add_comments(scenario.to_toml().splitlines(), defaults)) + "\n"


def _describe_robot(name: str) -> str:
    """Return a robot's file with all settings of its sections, and quantities derived from them."""
    from omni_mj.robot.robot_facts import load_robot

    robot = load_robot(name)
    head = [
        "# Derived from the numbers below:",
        *(f"#   {fact} = {value:.3g}" for fact, value in robot.facts.items()),
        "",
        f"description = {toml_files.format_toml_value(robot.description)}",
    ]
    sections = robot_files.read_robot_sections(name)
    fields = {section: dict(getattr(robot.settings, section)) for section in sections}
    return "\n".join([*head, format_sections(robot.settings, fields)])


def _describe_controller(name: str) -> str:
    """Return the docstring, the parameters and the source file of a controller."""
    from omni_control.controllers.registry import get_parameters
    from omni_mj.config import plugins

    controller_class, label = plugins.find_controller(name), plugins.label_controller(name)
    parameters = get_parameters(controller_class)
    lines = [
        inspect.getdoc(controller_class) or f"{label}: its class has no docstring",
        "",
        "parameters:" if parameters else "no parameters",
        *(f"  --set controller.{label}.{key}={json.dumps(v)}" for key, v in parameters.items()),
        "",
        f"source: {inspect.getsourcefile(controller_class)}",
    ]
    return "\n".join(lines) + "\n"


def _is_robot(file: str) -> bool:
    """Return whether a TOML file contains sections of robots only, and is no scenario."""
    sections = set(toml_files.read_toml(Path(file))) - {"model", "control", robot_files.DESCRIPTION}
    default_sections = robot_files.read_robot_sections(robot_files.DEFAULT_ROBOT)
    return bool(sections) and sections <= default_sections.keys()


def _add_comments(lines: Iterable[str], defaults: Mapping[str, Any] | None = None) -> Iterator[str]:
    """Yield lines of TOML with comments: unit, meaning, and the default of a changed setting.

    Args:
        lines: Lines of TOML with sections of settings.
        defaults: Section -> field -> value. Default: comments without defaults.
    """
    from omni_mj.config.settings import list_settings

    settings = {setting.full_name: setting for setting in list_settings()}
    section = ""
    for line in lines:
        section = line.strip("[]") if line.startswith("[") else section
        name, equals, _ = line.partition(" = ")
        setting = settings.get(f"{section}.{name}") if equals else None
        if setting is None:
            yield line
            continue
        comment = f"[{setting.unit}] {setting.doc}" if setting.unit else setting.doc
        if defaults is not None and defaults[section][name] != tomllib.loads(line)[name]:
            comment = f"(default {json.dumps(defaults[section][name])}) {comment}"
        yield f"{line.ljust(COMMENT_COLUMN)} # {comment}"


def _setting_entry(name: str, setting: "SettingInfo") -> list[str]:
    """Return name, default, unit, allowed values and meaning of a setting."""
    value = setting.default
    default = "" if value is None else value if isinstance(value, str) else json.dumps(value)
    return [name, default, setting.unit, setting.allowed, setting.doc]


def _print_entries(entries: Entries) -> None:
    """Print names and, next to them, meanings and properties, wrapped."""
    indent = 4 + max(len(name) for name, *_ in entries)
    width = shutil.get_terminal_size((PIPE_WIDTH, 0)).columns
    for name, *properties, meaning in entries:
        labels = zip(PROPERTY_LABELS, properties, strict=False)
        remark = "; ".join(f"{label} {text}" for label, text in labels if text)
        line = f"  {name.ljust(indent - 2)}{meaning}{remark and f' ({remark})'}"
        print(fill(line, width, subsequent_indent=" " * indent))
    print()


def _docstring_summary(reference: str) -> str:
    """Return the first line of the docstring of a class without importing it.

    Args:
        reference: Class as `module:Class`.
    """
    module, _, name = reference.partition(":")
    package, *path = module.split(".")
    file = Path(import_module(package).__path__[0], *path).with_suffix(".py")
    match = re.search(rf'^class {name}\b.*\n +"""(.*?)(?:"""|\n)', file.read_text("utf-8"), re.M)
    return match[1] if match else ""

"""Everything that can be named, as lists and in full: scenarios, controllers, plants, robots, settings and faults."""

import inspect
import json
import re
import shutil
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError, suggest_names
from omni_mj.config import robot_files, toml_files

if TYPE_CHECKING:
    from omni_mj.config.scenario import Scenario
    from omni_mj.config.settings import Settings
    from omni_mj.config.validation import SettingInfo

FACTS = ("default", "in", "allowed:")  # before the default, the unit and what is allowed
TITLES = {  # of the lists, and how each is used
    "scenarios": "--scenario",
    "controllers": "--controller",
    "plants": "--plant",
    "robots": "--robot",
    "settings": "--set section.field=value",
    "faults": "what happens in a run: [[fault]] in a scenario's file",
}
PIPE_WIDTH = 140  # columns if the output is no terminal
COMMENT_AT = 40  # column where the comments of settings begin, if there is room
Rows = list[list[str]]


def print_lists(only: str | None = None, word: str = "") -> None:
    """Print the lists.

    Args:
        only: Title of one of them. [all]
        word: Text that lines must contain, in any case.

    Raises:
        OmniError: No line contains the word.
    """
    lists = {title: list_entries(title) for title in ([only] if only else TITLES)}
    matching = {
        title: [row for row in lines if any(word.casefold() in cell.casefold() for cell in row)]
        for title, lines in lists.items()
    }
    if not any(matching.values()):
        names = {part for lines in lists.values() for row in lines for part in row[0].split(".")}
        raise OmniError(
            f"there is no {word!r} in the {only or 'lists'}; {suggest_names(word, sorted(names))}"
        )
    for title, lines in matching.items():
        if lines:
            print(f"{title} ({TITLES[title]})")
            _print(lines)


def list_entries(title: str) -> Rows:
    """Return the lines of the list called `title`: a name first, its meaning last."""
    match title:
        case "scenarios" | "robots":
            return _descriptions(
                toml_files.find_builtin_scenarios()
                if title == "scenarios"
                else robot_files.find_builtin_robots()
            )
        case "controllers":
            from omni_control.controllers import CONTROLLERS

            return [
                [name, _first_line(where) + _remark(name)] for name, where in CONTROLLERS.items()
            ]
        case "plants":
            from omni_mj.config.plugins import PLANTS

            return [[name, _first_line(where)] for name, where in PLANTS.items()]
        case "settings":
            from omni_mj.config.settings import list_settings

            return [_row(setting.full_name, setting) for setting in list_settings()]
        case _:
            return list_faults()


def list_faults() -> Rows:
    """Return the fields of all faults, then each kind of fault and its further fields."""
    from omni_mj.config.faults import FAULT_KINDS, Fault

    lines = [_row(name, setting) for name, setting in Fault.describe_fields().items()]
    for name, kind in FAULT_KINDS.items():
        plants = f"plants {', '.join(kind.plants)}: " if kind.plants else ""
        lines.append([f"kind = {name}", "", "", "", plants + (kind.__doc__ or "").split("\n")[0]])
        own = list(kind.describe_fields().items())[len(Fault.model_fields) :]
        lines += [_row(f"{name}.{field}", setting) for field, setting in own]
    return lines


def describe(name: str, overrides: Sequence[str] = (), robot: str | None = None) -> str:
    """Return a scenario, a robot or a controller in full, as text: the first two are files that can be used.

    Args:
        name: Its name, or a file with one: .toml, or file.py:Class.
        overrides: Settings of a scenario, as for `--set`.
        robot: The scenario's, in place of its own.

    Raises:
        OmniError: There is nothing of that name, it is not what it should be, or has no settings to
            change.
    """
    from omni_control.controllers import CONTROLLERS
    from omni_mj.config.plugins import is_class_reference
    from omni_mj.config.scenario import load_with_overrides

    if name in toml_files.find_builtin_scenarios() or (
        name.endswith(".toml") and not _is_robot(name)
    ):
        return describe_scenario(
            load_with_overrides(name, overrides, {"robot": robot} if robot else {})
        )
    if name in robot_files.find_builtin_robots() or name.endswith(".toml"):
        kind, describe_entry = "robot", _robot
    elif name in CONTROLLERS or is_class_reference(name):
        kind, describe_entry = "controller", _controller
    else:
        names = [
            *toml_files.find_builtin_scenarios(),
            *robot_files.find_builtin_robots(),
            *CONTROLLERS,
        ]
        raise OmniError(
            f"there is nothing called {name!r}; {suggest_names(name, names)}, or a file: .toml, or file.py:Class"
        )
    if overrides or robot:
        raise OmniError(f"--set and --robot change a scenario; {name} is a {kind}")
    return describe_entry(name)


def describe_scenario(scenario: "Scenario") -> str:
    """Return the effective scenario; a setting that is not as the robot drives with by default says so."""
    from omni_mj.config.resolve import resolve_settings

    usual = resolve_settings({}, scenario.robot).to_dict()
    return "\n".join(_explained(scenario.to_toml().splitlines(), usual)) + "\n"


def format_sections(settings: "Settings", fields: Mapping[str, Iterable[str]]) -> str:
    """Return settings as TOML with units and meanings, those of the given sections and fields."""
    values = settings.to_dict()
    lines = []
    for section, names in fields.items():
        lines += [
            "",
            f"[{section}]",
            *(f"{name} = {json.dumps(values[section][name])}" for name in names),
        ]
    return "\n".join(_explained(lines)) + "\n"


def _robot(name: str) -> str:
    """Return a robot's file, with all settings of its sections, and what follows from them."""
    from omni_mj.studies.robot_facts import load_robot

    chosen = load_robot(name)
    facts = [f"#   {fact} = {value:.3g}" for fact, value in chosen.facts.items()]
    head = [
        "# What follows from the numbers below:",
        *facts,
        "",
        f"description = {json.dumps(chosen.description)}",
    ]
    fields = {
        section: getattr(chosen.settings, section).values()
        for section in robot_files.read_robot_sections(name)
    }
    return "\n".join([*head, format_sections(chosen.settings, fields)])


def _controller(name: str) -> str:
    """Return what a controller does, by its docstring, and its parameters."""
    from omni_control.controllers import get_parameters
    from omni_mj.config import plugins

    kind, label = plugins.find_controller(name), plugins.label_controller(name)
    lines = [
        inspect.getdoc(kind) or f"{label}: its class has no docstring",
        "",
        "parameters:" if get_parameters(kind) else "no parameters",
    ]
    lines += [
        f"  --set controller.{label}.{key}={json.dumps(value)}"
        for key, value in get_parameters(kind).items()
    ]
    return "\n".join([*lines, "", f"source: {inspect.getsourcefile(kind)}"]) + "\n"


def _is_robot(file: str) -> bool:
    """Return whether a TOML file is a robot's rather than a scenario's: it has nothing that robots do not have."""
    if not Path(file).is_file():
        raise OmniError(f"there is no file {file}")
    data = toml_files.read_toml(Path(file), "the file")
    return bool(data) and data.keys() <= {
        *robot_files.read_robot_sections(robot_files.DEFAULT_ROBOT),
        robot_files.DESCRIPTION,
    }


def _explained(lines: Iterable[str], usual: Mapping[str, Any] | None = None) -> Iterator[str]:
    """Yield TOML lines, those of settings with unit and meaning behind, and their default where they differ from it."""
    from omni_mj.config.settings import list_settings

    declared = {setting.full_name: setting for setting in list_settings()}
    section = ""
    for line in lines:
        section = line.strip("[]") if line.startswith("[") else section
        name, equals, _ = line.partition(" = ")
        setting = declared.get(f"{section}.{name}") if equals else None
        if setting is None:
            yield line
            continue
        note = f"[{setting.unit}] {setting.doc}" if setting.unit else setting.doc
        if usual is not None and usual[section][name] != tomllib.loads(line)[name]:
            note = f"(default {json.dumps(usual[section][name])}) {note}"
        yield f"{line.ljust(COMMENT_AT)} # {note}"


def _row(name: str, setting: "SettingInfo") -> list[str]:
    value = setting.default
    default = "" if value is None else value if isinstance(value, str) else json.dumps(value)
    return [name, default, setting.unit, setting.allowed, setting.doc]


def _print(lines: Rows) -> None:
    """Print names and, next to them, meanings and what is allowed, wrapped."""
    indent = 4 + max(len(name) for name, *_ in lines)
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else PIPE_WIDTH
    for name, *facts, meaning in lines:
        notes = "; ".join(
            f"{what} {fact}" for what, fact in zip(FACTS, facts, strict=False) if fact
        )
        text = f"  {name.ljust(indent - 2)}{meaning}{notes and f' ({notes})'}"
        print(fill(text, width, subsequent_indent=" " * indent))
    print()


def _remark(controller: str) -> str:
    from omni_control.controllers import find_missing_package

    package = find_missing_package(controller)
    return f" (needs {package}: pip install 'omni-mj[{controller}]')" if package else ""


def _descriptions(files: Mapping[str, Path]) -> Rows:
    """Return names and descriptions of TOML files."""
    return [
        [name, tomllib.loads(path.read_text("utf-8")).get("description", "")]
        for name, path in files.items()
    ]


def _first_line(where: str) -> str:
    """Return the first line of the docstring of a class named `module:Class`, which is not imported."""
    module, _, name = where.partition(":")
    top, *rest = module.split(".")
    folder = Path(str(getattr(find_spec(top), "origin", ""))).parent
    text = folder.joinpath(*rest).with_suffix(".py").read_text("utf-8")
    match = re.search(rf'^class {name}\b.*\n +"""(.*?)(?:"""|\n)', text, re.MULTILINE)
    return match[1] if match else ""

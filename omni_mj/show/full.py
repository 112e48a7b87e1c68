"""A scenario, a robot or a controller in full, as text: the first two are files that can be used."""

import inspect
import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from omni_control.controllers import parameters
from omni_control.errors import OmniError, choose
from omni_control.registry import CONTROLLERS
from omni_mj.scenarios import classes, robots, toml_files
from omni_mj.scenarios.resolve import resolve
from omni_mj.scenarios.robots import builtin as robots_here
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.scenarios.settings import Settings, every_setting
from omni_mj.scenarios.toml_files import builtin as scenarios_here

COMMENT_AT = 40  # column where the comments of settings begin, if there is room
SHORT = 20  # characters of a default that is shown beside a value


def text(name: str, overrides: Sequence[str] = (), robot: str | None = None) -> str:
    """What is called `name`, in full.

    Args:
        name: of a scenario, a robot or a controller, or a file with one: .toml, or file.py:Class.
        overrides: settings of a scenario, as for `--set`.
        robot: the scenario's, in place of its own.

    Raises:
        OmniError: there is nothing of that name, it is not what it should be, or has no settings to change.
    """
    if name in scenarios_here() or (name.endswith(".toml") and not _is_robot(name)):
        return scenario(load(name, overrides, {"robot": robot} if robot else {}))
    if name in robots_here() or name.endswith(".toml"):
        kind, describe = "robot", the_robot
    elif name in CONTROLLERS or classes.names_class(name):
        kind, describe = "controller", controller
    else:
        names = [*scenarios_here(), *robots_here(), *CONTROLLERS]
        raise OmniError(f"there is nothing called {name!r}; {choose(name, names)}, or a file: .toml, or file.py:Class")
    if overrides or robot:
        raise OmniError(f"--set and --robot change a scenario; {name} is a {kind}")
    return describe(name)


def scenario(of: Scenario) -> str:
    """The effective scenario; a setting that is not as the robot drives with by default says so."""
    usual = resolve({}, of.robot).plain()
    return "\n".join(_explained(of.to_toml().splitlines(), usual)) + "\n"


def the_robot(name: str) -> str:
    """A robot's file, with all settings of its sections, and what follows from them."""
    from omni_mj.studies.robot import robot  # builds it, with MuJoCo

    found = robot(name)
    facts = [f"#   {fact} = {value:.3g}" for fact, value in found.facts.items()]
    head = ["# What follows from the numbers below:", *facts, "", f"description = {json.dumps(found.description)}"]
    whole = {section: getattr(found.settings, section).values() for section in robots.sections(name)}
    return "\n".join([*head, *sections(found.settings, whole)]) + "\n"


def sections(settings: Settings, wanted: Mapping[str, Iterable[str]]) -> Iterator[str]:
    """Lines of a TOML file with settings, their units and meanings.

    Args:
        settings: in force.
        wanted: which of them: sections and their fields.
    """
    whole = settings.plain()
    for name, fields in wanted.items():
        lines = [f"{field} = {json.dumps(whole[name][field])}" for field in fields]
        yield from ("", *_explained([f"[{name}]", *lines]))


def controller(name: str) -> str:
    """Return what a controller does, by its docstring, and its parameters."""
    kind, label = classes.find_controller(name), classes.label(name)
    lines = [inspect.getdoc(kind) or f"{label}: its class has no docstring", "", "parameters:"]
    lines += [f"  --set controller.{label}.{key}={json.dumps(value)}" for key, value in parameters(kind).items()]
    return "\n".join([*lines, "", f"source: {inspect.getsourcefile(kind)}"]) + "\n"


def _is_robot(file: str) -> bool:
    """Return whether a TOML file is a robot's rather than a scenario's: it has nothing that robots do not have."""
    path = Path(file)
    if not path.is_file():
        raise OmniError(f"there is no file {path}")
    data = toml_files.read(path, "the file")
    return bool(data) and data.keys() <= {*robots.sections(robots.DEFAULT), robots.DESCRIPTION}


def _explained(lines: Iterable[str], usual: Mapping[str, Any] | None = None) -> Iterator[str]:
    """TOML lines, those of settings with unit and meaning behind, and what they are usually where they differ."""
    known = {declared.full: declared for declared in every_setting()}
    section = ""
    for line in lines:
        section = line.strip("[]") if line.startswith("[") else section
        name, equals, _ = line.partition(" = ")
        declared = known.get(f"{section}.{name}")
        if not equals or declared is None:
            yield line
            continue
        note = f"[{declared.unit}] {declared.doc}" if declared.unit else declared.doc
        if usual is not None and usual[section][name] != tomllib.loads(line)[name]:
            default = json.dumps(usual[section][name])
            note = (f"(default {default}) " if len(default) <= SHORT else "(not the default) ") + note
        yield f"{line.ljust(COMMENT_AT)} # {note}"

"""Robots: what their files give for settings.

A robot is a TOML file of settings by section, like a scenario: they are the defaults of whatever that robot drives.
What the default robot's file gives depends on the robot, so that every other must give it too, but for what a team is
told of it.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError, choose
from omni_mj.robots import builtin
from omni_mj.scenarios import own_model, told, toml_files
from omni_mj.scenarios.checking import in_one
from omni_mj.scenarios.nested import frozen, merged

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings

DEFAULT = "tigers-v2016"
CONTROL = "control"  # the section of what a team is told, which follows where a robot's file does not say it
SECTIONS = ("body", "wheels", "motor", "firmware", "drive", "carpet")  # in which what it follows from is
DESCRIPTION = "description"  # the one key of a robot's file that is no section


@dataclass(frozen=True)
class Robot:
    """A robot that was read and checked; whatever takes the name of a robot takes this too.

    Args:
        name: as it was asked for: a name, or the path of a .toml file.
        path: its file.
        description: what the file says it is, in a line.
        settings: what it drives with if nothing else is said: the file's, and the defaults of all others.
        facts: what follows from its numbers; see `om.robot`.
    """

    name: str
    path: Path
    description: str
    settings: "Settings"
    facts: Mapping[str, float]

    def __str__(self) -> str:
        """Its description, and a line for each fact."""
        return "\n".join([f"{self.name}: {self.description}", *(f"  {k} {v:.3g}" for k, v in self.facts.items())])


def robot_path(robot: str) -> Path:
    """The file of a robot, given its name or the path of a .toml file.

    Raises:
        OmniError: there is no such robot or file.
    """
    if robot.endswith(".toml"):
        if not os.path.isfile(path := Path(robot)):
            raise OmniError(f"there is no robot's file {path}")
        return path
    known = builtin()
    if robot.endswith(".xml"):
        raise OmniError(
            f"a robot is a .toml file of settings, not {robot!r}; {choose(robot, known)}, or robot.toml; a model of "
            f"yours goes with it: --model {robot}"
        )
    if robot not in known:
        raise OmniError(f"unknown robot {robot!r}; {choose(robot, known)}, or a file of yours: robot.toml")
    return known[robot]


def sections(robot: str) -> Mapping[str, Mapping[str, Any]]:
    """The settings that a robot's file gives, by section and field; see `robot_path` for what a robot is.

    Raises:
        OmniError: there is no such robot, or its file is not TOML or holds something else than sections.
    """
    path = robot_path(robot)
    return _read(path, path.stat().st_mtime_ns)[1]


def description(robot: str) -> str:
    """What a robot's file says it is, in a line.

    Raises:
        OmniError: as `sections`.
    """
    path = robot_path(robot)
    return _read(path, path.stat().st_mtime_ns)[0]


def of_robot(name: str) -> Callable[[], Any]:
    """A setting's default that is a robot's own: what the default robot's file gives for `section.field`."""
    section, field = name.split(".")
    return lambda: frozen(sections(DEFAULT)[section][field])


def follows(field: str) -> Callable[[], Any]:
    """A default of `[control]` that follows from the robot's own numbers: that of the default robot."""
    return lambda: _told_by_default()[field]


def completed(given: Mapping[str, Any], robot: str) -> dict[str, Any]:
    """Sections of settings as `given`, below them those that the robot's file gives, and the numbers of its model.

    What neither says of `[control]` follows from the robot's numbers (`told`): from those of its file and model,
    since what else a scenario makes of a robot its team need not know.

    Raises:
        OmniError: neither gives what depends on the robot, nor the model that they name; a line for each such setting.
    """
    whole = own_model.applied(sections(robot), given)
    in_one(
        f"{section}.{field} depends on the robot; give it in the scenario, or in {robot_path(robot)}"
        for section, fields in sections(DEFAULT).items()
        for field in fields
        if section != CONTROL and not _given(whole, section, field)
    )
    control = whole.get(CONTROL, {})
    if isinstance(control, Mapping) and not set(told.FIELDS) <= control.keys():
        whole[CONTROL] = {**_told(whole, robot), **control}
    return whole


def _told(whole: Mapping[str, Any], robot: str) -> Mapping[str, float]:
    """What follows for `[control]` from the robot's file, and of what that lacks from the `whole`; nothing if wrong."""
    from omni_mj.scenarios.settings import ControlSettings, Settings

    file = sections(robot)
    own = own_model.applied(merged(whole, {name: file[name] for name in SECTIONS if name in file}), {})
    needed = {name: own[name] for name in SECTIONS if name in own}
    try:
        nothing: dict[str, Any] = dict.fromkeys(told.FIELDS, 0.0)  # as the defaults of these are what is asked for
        settings = Settings(**needed, control=ControlSettings(**nothing))
        return told.follows(settings, _creep(whole.get(CONTROL, {})))
    except OmniError:  # which whoever makes settings of the whole is told
        return {}


@lru_cache
def _told_by_default() -> Mapping[str, float]:
    robot = sections(DEFAULT)
    return {**_told(robot, DEFAULT), **robot.get(CONTROL, {})}


def _creep(control: Any) -> float | None:
    """What is said of the creep, if it is a number that may be said."""
    said = control.get("creep_s2_m") if isinstance(control, Mapping) else None
    return float(said) if isinstance(said, int | float) and 0 <= said <= 1 else None


def _given(whole: Mapping[str, Any], section: str, field: str) -> bool:
    values = whole.get(section, {})
    return field in values if isinstance(values, Mapping) else True  # a whole section, or what is none at all


@lru_cache
def _read(path: Path, changed: int) -> tuple[str, Mapping[str, Mapping[str, Any]]]:
    data = toml_files.read(path, "the robot's file")
    says = data.pop(DESCRIPTION, "")
    if not isinstance(says, str) or not all(isinstance(section, dict) for section in data.values()):
        raise OmniError(f"the robot's file {path} holds something else than a {DESCRIPTION} and sections of settings")
    if isinstance(model := data.get(own_model.SECTION, {}).get("file"), str) and model:
        data[own_model.SECTION]["file"] = str(path.parent / model)  # relative to the robot's file
    return says, MappingProxyType(data)

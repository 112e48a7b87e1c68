"""Robots: what their files give for settings.

A robot is a TOML file of settings by section, like a scenario: they are the defaults of whatever that robot drives.
What the default robot's file gives depends on the robot, so that every other must give it too.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError, choose
from omni_mj.robots import builtin
from omni_mj.scenarios import own_model, toml_files
from omni_mj.scenarios.checking import in_one
from omni_mj.scenarios.nested import frozen

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings

DEFAULT = "tigers-v2016"
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
        if not (path := Path(robot)).is_file():
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


def completed(given: Mapping[str, Any], robot: str) -> dict[str, Any]:
    """Sections of settings as `given`, below them those that the robot's file gives, and the numbers of its model.

    Raises:
        OmniError: neither gives what depends on the robot, nor the model that they name; a line for each such setting.
    """
    whole = own_model.applied(sections(robot), given)
    in_one(
        f"{section}.{field} depends on the robot; give it in the scenario, or in {robot_path(robot)}"
        for section, fields in sections(DEFAULT).items()
        for field in fields
        if not _given(whole, section, field)
    )
    return whole


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

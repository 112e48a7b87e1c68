"""The files of robots: their settings by section, which are the defaults of whatever such a robot drives."""

import os
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, choose
from omni_mj.robots import builtin
from omni_mj.scenarios import toml_files

DEFAULT = "tigers-v2016"
DESCRIPTION = "description"  # the one key of a robot's file that is no section
Sections = Mapping[str, Mapping[str, Any]]


def robot_path(robot: str) -> Path:
    """Return the file of a robot, given its name or the path of a .toml file.

    Raises:
        OmniError: There is no such robot or file.
    """
    if robot.endswith(".toml"):
        if not os.path.isfile(robot):
            raise OmniError(f"there is no robot's file {robot}")
        return Path(robot)
    known = builtin()
    if robot.endswith(".xml"):
        raise OmniError(
            f"a robot is a .toml file of settings, not {robot!r}; {choose(robot, known)}, or robot.toml; a model of "
            f"yours goes with it: --model {robot}"
        )
    if robot not in known:
        raise OmniError(f"unknown robot {robot!r}; {choose(robot, known)}, or a file of yours: robot.toml")
    return known[robot]


def sections(robot: str) -> Sections:
    """Return the settings that a robot's file gives, by section and field.

    Raises:
        OmniError: There is no such robot, or its file is not TOML or holds something else than sections.
    """
    path = robot_path(robot)
    return _read(path, path.stat().st_mtime_ns)[1]


def description(robot: str) -> str:
    """Return the description in a robot's file, a line.

    Raises:
        OmniError: As `sections`.
    """
    path = robot_path(robot)
    return _read(path, path.stat().st_mtime_ns)[0]


def of_robot(name: str) -> Callable[[], Any]:
    """Return the default of a setting that depends on the robot: the value in the default robot's file."""
    section, field = name.split(".")

    def default() -> Any:
        value = sections(DEFAULT)[section][field]
        return tuple(value) if isinstance(value, list) else value

    return default


@lru_cache
def _read(path: Path, changed: int) -> tuple[str, Sections]:
    data = toml_files.read(path, "the robot's file")
    text = data.pop(DESCRIPTION, "")
    if not isinstance(text, str) or not all(isinstance(section, dict) for section in data.values()):
        raise OmniError(f"the robot's file {path} holds something else than a {DESCRIPTION} and sections of settings")
    if isinstance(model := data.get("model", {}).get("file"), str) and model:
        data["model"]["file"] = str(path.parent / model)  # relative to the robot's file
    return text, data

"""The files of robots, which are the defaults of whatever such a robot drives, and of models."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, suggest_names
from omni_mj.config import toml_files

DEFAULT_ROBOT = "tigers-v2016"
DESCRIPTION = "description"  # the one key of a robot's file that is no section
Sections = Mapping[str, Mapping[str, Any]]


def find_builtin_robots() -> Mapping[str, Path]:
    """Return the files of the robots that come with the package, by name."""
    return toml_files.find_packaged_files("robots")


def find_robot_file(robot: str) -> Path:
    """Return the file of a robot, given its name or the path of a .toml file.

    Raises:
        OmniError: There is no such robot or file.
    """
    if robot.endswith(".toml"):
        return Path(robot)
    if robot not in find_builtin_robots():
        raise OmniError(
            f"unknown robot {robot!r}; {suggest_names(robot, find_builtin_robots())}, or a file of yours: robot.toml"
        )
    return find_builtin_robots()[robot]


def read_robot_sections(robot: str) -> Sections:
    """Return the settings that a robot's file gives, by section and field.

    Raises:
        OmniError: There is no such robot, or its file is not TOML or holds something else than
            sections.
    """
    return _read(robot)[1]


def read_robot_description(robot: str) -> str:
    """Return the description in a robot's file, a line.

    Raises:
        OmniError: As `sections`.
    """
    return _read(robot)[0]


def find_models_folder() -> Path:
    """Return the folder of models: beside the package in a checkout, inside it in an installed wheel."""
    package = Path(__file__).parents[1]
    beside = package.parent / "models"
    return beside if (beside / "ssl_robot.xml").is_file() else package / "models"


def find_robot_mjcf() -> Path:
    """Return the MJCF of a robot's shape."""
    return find_models_folder() / "ssl_robot.xml"


def _read(robot: str) -> tuple[str, Sections]:
    path = find_robot_file(robot)
    return _parsed(path, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache
def _parsed(path: Path, changed: int) -> tuple[str, Sections]:
    data = toml_files.read_toml(path, "the robot's file")
    text = data.pop(DESCRIPTION, "")
    if not isinstance(text, str) or not all(isinstance(section, dict) for section in data.values()):
        raise OmniError(
            f"the robot's file {path} holds something else than a {DESCRIPTION} and sections of settings"
        )
    if isinstance(model := data.get("model", {}).get("file"), str) and model:
        data["model"]["file"] = str(path.parent / model)  # relative to the robot's file
    return text, data

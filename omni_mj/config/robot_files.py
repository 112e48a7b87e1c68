"""Files of robots, whose values are the defaults of scenarios with that robot, and MJCF files."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, suggest_names
from omni_mj.config import toml_files

DEFAULT_ROBOT = "tigers-v2016"
DESCRIPTION = "description"  # the only key of a robot's file that is not a section
Sections = Mapping[str, Mapping[str, Any]]


def find_builtin_robots() -> Mapping[str, Path]:
    """Return the robot files of the package by name."""
    return toml_files.find_packaged_files("robots")


def find_robot_file(robot: str) -> Path:
    """Return the file of a robot.

    Args:
        robot: Name of a robot, or path of a .toml file.

    Raises:
        OmniError: There is no robot of this name.
    """
    if robot.endswith(".toml"):
        return Path(robot)
    robots = find_builtin_robots()
    if robot not in robots:
        hint = suggest_names(robot, robots)
        raise OmniError(f"unknown robot {robot!r}; {hint}, or a file of yours: robot.toml")
    return robots[robot]


def read_robot_sections(robot: str) -> Sections:
    """Return the settings in a robot's file, by section and field.

    Raises:
        OmniError: There is no such robot, its file is not TOML, or it contains anything but
            sections.
    """
    return _read(robot)[1]


def read_robot_description(robot: str) -> str:
    """Return the one-line description in a robot's file.

    Raises:
        OmniError: As `read_robot_sections`.
    """
    return _read(robot)[0]


def find_models_folder() -> Path:
    """Return the folder of MJCF files: next to the package in a checkout, inside it in a wheel."""
    package = Path(__file__).parents[1]
    checkout = package.parent / "models"
    return checkout if (checkout / "ssl_robot.xml").is_file() else package / "models"


def find_robot_mjcf() -> Path:
    """Return the MJCF file of the standard robot shape."""
    return find_models_folder() / "ssl_robot.xml"


def _read(robot: str) -> tuple[str, Sections]:
    path = find_robot_file(robot)
    return _parse(path, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache
def _parse(path: Path, modified_ns: int) -> tuple[str, Sections]:
    """Return description and sections of a file. The modification time keys the cache."""
    data = toml_files.read_toml(path, "the robot's file")
    description = data.pop(DESCRIPTION, "")
    has_sections_only = all(isinstance(section, dict) for section in data.values())
    if not isinstance(description, str) or not has_sections_only:
        raise OmniError(
            f"the robot's file {path} may contain only a {DESCRIPTION} and sections of settings"
        )
    mjcf_file = data.get("model", {}).get("file")
    if isinstance(mjcf_file, str) and mjcf_file:
        data["model"]["file"] = str(path.parent / mjcf_file)  # relative to the robot's file
    return description, data

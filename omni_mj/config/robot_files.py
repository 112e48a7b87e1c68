"""Find and read files of robots: TOML files with settings, and models in MJCF.

MJCF is MuJoCo's XML format. A model consists of its main file and the files that this one names:
included files, meshes and textures.
"""

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, suggest_names
from omni_mj.config import toml_files

DEFAULT_ROBOT = "tigers-v2016"
DESCRIPTION = "description"  # the only key of a robot's file that is not a section
# section -> field -> value
Sections = Mapping[str, Mapping[str, Any]]
_FILE_ATTRIBUTES = (  # of elements of MJCF
    "file",
    "fileright",
    "fileleft",
    "fileup",
    "filedown",
    "filefront",
    "fileback",
)


def find_robot_file(robot: str) -> Path:
    """Return the file of a robot.

    Args:
        robot: Name of a robot, or path of a .toml file.

    Raises:
        OmniError: There is no robot of this name.
    """
    if robot.endswith(".toml"):
        return Path(robot)
    robots = toml_files.find_builtin_files("robots")
    if robot not in robots:
        hint = suggest_names(robot, robots)
        raise OmniError(f"unknown robot {robot!r}; {hint}, or the path of a .toml file")
    return robots[robot]


def read_robot_sections(robot: str) -> Sections:
    """Return the settings in a robot's file, by section and field.

    Raises:
        OmniError: There is no such robot, its file is not TOML, or the file contains anything but
            sections and a description.
    """
    return read_robot_file(robot)[1]


def read_robot_file(robot: str) -> tuple[str, Sections]:
    """Return the one-line description in a robot's file, and the settings as sections.

    Raises:
        OmniError: As `read_robot_sections`.
    """
    path = find_robot_file(robot)
    return _parse_robot_file(path, path.stat().st_mtime_ns if path.is_file() else 0)


def find_models_folder() -> Path:
    """Return the folder of MJCF files: next to the package in a checkout, inside if installed."""
    package = Path(__file__).parents[1]
    checkout = package.parent / "models"
    return checkout if (checkout / "ssl_robot.xml").is_file() else package / "models"


def find_robot_mjcf() -> Path:
    """Return the MJCF file of the standard robot shape."""
    return find_models_folder() / "ssl_robot.xml"


def list_model_files(path: Path) -> list[Path]:
    """Return a model's main file and all files that it names, whether they exist or not.

    A file that is not valid XML names no others.
    """
    names = _find_file_names(path, path.parent, {})
    return list(dict.fromkeys([path, *(path.parent / name for name in names)]))


def read_model_files(path: Path) -> dict[str, bytes]:
    """Return a mapping from relative path to contents for a model's files, the main file first.

    The paths are relative to the innermost folder that contains all files.

    Raises:
        OSError: A file cannot be read.
        ValueError: A file is named by an absolute path, so a copied model would not find its copy.
    """
    for name in _find_file_names(path, path.parent, {}):
        if Path(name).is_absolute():
            raise ValueError(f"it names {name} by an absolute path; name it relative to the model")
    files = [Path(os.path.abspath(file)) for file in list_model_files(path)]
    common_folder = Path(os.path.commonpath([file.parent for file in files]))
    return {file.relative_to(common_folder).as_posix(): file.read_bytes() for file in files}


@lru_cache
def _parse_robot_file(path: Path, modified_ns: int) -> tuple[str, Sections]:
    """Return description and sections of a file.

    `modified_ns` is the time of the file's last change. A changed file is not taken from the cache.
    """
    data = toml_files.read_toml(path)
    description = data.pop(DESCRIPTION, "")
    has_sections_only = all(isinstance(section, dict) for section in data.values())
    if not isinstance(description, str) or not has_sections_only:
        raise OmniError(
            f"the robot's file {path} must contain only sections of settings and a {DESCRIPTION}"
        )
    mjcf_file = data.get("model", {}).get("file")
    if isinstance(mjcf_file, str) and mjcf_file:
        data["model"]["file"] = str(path.parent / mjcf_file)  # relative to the robot's file
    return description, data


def _find_file_names(path: Path, main_folder: Path, asset_folders: dict[str, str]) -> Iterator[str]:
    """Yield the file names in a model, relative to the main file's folder as in MuJoCo.

    Args:
        path: File to read, the main one or an included one.
        main_folder: Folder of the main file.
        asset_folders: "mesh" or "texture" -> folder of these files; set by <compiler> elements.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError):
        return
    for compiler in root.iter("compiler"):
        for kind in ("mesh", "texture"):
            if folder := compiler.get(f"{kind}dir", compiler.get("assetdir")):
                asset_folders[kind] = folder
    for include in root.iter("include"):
        if name := include.get("file"):
            yield name
            yield from _find_file_names(main_folder / name, main_folder, asset_folders)
    for kind in ("mesh", "texture", "hfield", "skin"):
        folder_kind = "texture" if kind == "texture" else "mesh"
        asset_folder = Path(asset_folders.get(folder_kind, ""))
        for element in root.iter(kind):
            for attribute in _FILE_ATTRIBUTES:
                if name := element.get(attribute):
                    yield (asset_folder / name).as_posix()

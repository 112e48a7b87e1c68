"""Find and read files of robots: TOML files with settings, and models in MJCF.

MJCF is MuJoCo's XML format. A model consists of its main file and the files that this one names:
included files, attached models, meshes and textures. All are regular files in the main file's
folder or below.
"""

import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from omni_control.errors import OmniError, suggest_names, to_printable
from omni_mj.config import toml_files
from omni_mj.io.atomic_files import read_regular_file

DEFAULT_ROBOT = "tigers-v2016"
DESCRIPTION = "description"  # the only key of a robot's file that is not a section
# section -> field -> value
Sections = Mapping[str, Mapping[str, Any]]
FILE_ATTRIBUTES = (  # of elements of MJCF
    "file",
    "fileright",
    "fileleft",
    "fileup",
    "filedown",
    "filefront",
    "fileback",
)
_ASSET_SUFFIXES = {  # element of MJCF -> formats of its files
    "mesh": (".stl", ".obj", ".msh"),
    "texture": (".png", ".ktx"),
    "hfield": (".png", ".bin"),
    "skin": (".skn",),
}
MAX_XML_BYTES = 4_000_000  # of all XML files of a model
MAX_MODEL_FILES = 500
MAX_MODEL_BYTES = 200_000_000  # of all files of a model
# Markup of XML; an unfinished comment ends with the file. Tags may contain ">" in quotes.
_MARKUP = re.compile(
    r"<!--.*?(?:-->|\Z)|<!\[CDATA\[.*?(?:\]\]>|\Z)|<\?.*?(?:\?>|\Z)"
    r"""|<(?:"[^"]*+"|'[^']*+'|[^<>"']++)*+>""",
    re.DOTALL,
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
    return _parse_robot_file(path, path.stat().st_mtime_ns if os.path.isfile(path) else 0)


def find_models_folder() -> Path:
    """Return the folder of MJCF files: next to the package in a checkout, inside if installed."""
    package = Path(__file__).parents[1]
    checkout = package.parent / "models"
    return checkout if (checkout / "ssl_robot.xml").is_file() else package / "models"


def list_model_files(path: Path) -> list[Path]:
    """Return a model's main file and all files that it names.

    Raises:
        OmniError: A file is missing, is not a regular file, is outside of the main file's folder,
            has another format or is too large, or a file includes itself.
    """
    main = Path(os.path.realpath(path))
    collector = _ModelFileCollector(main.parent)
    collector.add_model(main, ())
    if sum(file.stat().st_size for file in collector.files) > MAX_MODEL_BYTES:
        raise OmniError(f"its files must not exceed {MAX_MODEL_BYTES / 1e6:g} MB")
    return list(collector.files)


def read_model_files(path: Path) -> dict[str, bytes]:
    """Return a mapping from relative path to contents for a model's files, the main file first.

    The paths are relative to the main file's folder.

    Raises:
        OmniError: See `list_model_files`.
    """
    files = list_model_files(path)
    folder = files[0].parent
    return {
        file.relative_to(folder).as_posix(): read_regular_file(file, MAX_MODEL_BYTES)
        for file in files
    }


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
        _check_is_below(
            path.parent / mjcf_file, path.parent, f"{path} names {to_printable(mjcf_file)}"
        )
        data["model"]["file"] = str(path.parent / mjcf_file)  # relative to the robot's file
    return description, data


class _ModelFileCollector:
    """Collects the files of a model.

    Files are searched wherever MuJoCo may look for them: relative to the model and to the file that
    names them, in the folders of <compiler>, and there without their own folders (strippath).

    Args:
        folder: Folder that must contain all files.

    Attributes:
        files: The files, as keys in the order in which they are named.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.files: dict[Path, None] = {}
        self._n_xml_bytes = 0

    def add_model(self, model: Path, ancestors: tuple[Path, ...]) -> None:
        """Add the file of a model, and the files that it and its included files name.

        Args:
            model: The model's file.
            ancestors: Files of the models to which the model is attached.
        """
        if model in ancestors:
            raise OmniError(f"{model.name} includes itself")
        if model in self.files:
            return
        roots: dict[Path, ElementTree.Element] = {}
        self._add_included(model, model.parent, roots)
        elements = [
            (source, element.tag.rpartition("}")[2], element)
            for source, root in roots.items()
            for element in root.iter()
        ]
        compilers = [element for _, tag, element in elements if tag == "compiler"]
        asset_folders = [
            _to_posix(compiler.get(name, ""))
            for compiler in compilers
            for name in ("assetdir", "meshdir", "texturedir")
        ]
        strips_paths = any(compiler.get("strippath") == "true" for compiler in compilers)
        for source, tag, element in elements:
            folders = [model.parent, source.parent]
            if tag == "model" and (name := element.get("file")):
                for child in self._find(name, folders):
                    self.add_model(child, (*ancestors, model))
            elif tag != "include":
                folders += [folder / asset for folder in folders for asset in asset_folders]
                for name in _names_of_files(tag, element):
                    self.files |= dict.fromkeys(self._find(name, folders, strips_paths))

    def _add_included(
        self, file: Path, model_folder: Path, roots: dict[Path, ElementTree.Element]
    ) -> None:
        """Add an XML file and the files that it includes.

        MuJoCo looks for included files in the folder of the model first.

        Args:
            file: The file.
            model_folder: Folder of the model to which it belongs.
            roots: File -> root element; new ones are added.
        """
        if file in roots:
            raise OmniError(f"{file.name} is included twice, or includes itself")
        if len(self.files) >= MAX_MODEL_FILES:
            raise OmniError(f"it must not have more than {MAX_MODEL_FILES} files")
        self._n_xml_bytes += file.stat().st_size
        if self._n_xml_bytes > MAX_XML_BYTES:
            raise OmniError(f"its XML files must not exceed {MAX_XML_BYTES / 1e6:g} MB")
        roots[file] = _parse_xml(file)
        self.files[file] = None
        for element in roots[file].iter():
            name = element.get("file")
            if name and element.tag.rpartition("}")[2] == "include":
                included = next(self._find(name, [model_folder, file.parent]))
                self._add_included(included, model_folder, roots)

    def _find(
        self, name: str, folders: Sequence[Path], strips_path: bool = False
    ) -> Iterator[Path]:
        """Yield the regular files of a name in some folders.

        Args:
            name: The name.
            folders: The folders.
            strips_path: Whether the file may also be there without the folders in its name.

        Raises:
            OmniError: There is none, or one is not a regular file or is outside of the folder.
        """
        name = _to_posix(name)
        names = (name, Path(name).name) if strips_path else (name,)
        paths = [folder / candidate for candidate in names for folder in folders]
        existing_paths = [path for path in paths if os.path.lexists(path)]
        if not existing_paths:
            raise OmniError(f"it names {to_printable(name)}, which does not exist")
        for path in existing_paths:
            yield _check_is_below(path, self._folder, f"it names {to_printable(name)}")


def _parse_xml(file: Path) -> ElementTree.Element:
    """Return the root of an XML file as MuJoCo's parser sees it, which allows -- in comments."""
    try:
        text = read_regular_file(file, MAX_XML_BYTES).decode("utf-8-sig")
        text = _MARKUP.sub(lambda match: _blank_comment(match[0]), text)
        if "<!DOCTYPE" in text:
            raise OmniError(f"{file.name} must not have a <!DOCTYPE>")
        return ElementTree.fromstring(text)
    except (UnicodeDecodeError, ElementTree.ParseError) as error:
        raise OmniError(f"XML parse error in {file.name}: {to_printable(str(error))}") from None


def _blank_comment(markup: str) -> str:
    """Return the line breaks of a comment, and other markup unchanged."""
    return "\n" * markup.count("\n") if markup.startswith("<!--") else markup


def _names_of_files(tag: str, element: ElementTree.Element) -> Iterator[str]:
    """Yield the names of files that MuJoCo reads for an element of MJCF."""
    names = [element.get(attribute, "") for attribute in FILE_ATTRIBUTES]
    if tag not in _ASSET_SUFFIXES:
        if any(names):
            raise OmniError(f"a robot's <{to_printable(tag, 40)}> must not have a file")
        return
    if element.get("builtin", "none") != "none":
        return
    for name in names[:1] if names[0] else filter(None, names[1:]):
        suffixes = _ASSET_SUFFIXES[tag]
        if not name.lower().endswith(suffixes):
            choices = ", ".join(suffixes)
            raise OmniError(
                f"the file of a <{tag}> must end in {choices}, not {to_printable(name, 100)}"
            )
        yield name


def _check_is_below(path: Path, folder: Path, statement: str) -> Path:
    """Return the path of a file, which must be a regular one in a folder or below, without "..".

    Args:
        path: The file; it may not exist.
        folder: The folder.
        statement: Start of the error message, which names the file.
    """
    if "\0" in str(path):
        raise OmniError(f"{statement}, which is not the name of a file")
    normal_path, real_path = Path(os.path.abspath(path)), Path(os.path.realpath(path))
    is_below = normal_path.is_relative_to(os.path.abspath(folder))
    if not (is_below and real_path.is_relative_to(os.path.realpath(folder))):
        raise OmniError(f"{statement}, which is outside of the folder {folder}; copy it there")
    if os.path.lexists(path) and not real_path.is_file():
        raise OmniError(f"{statement}, which is not a regular file")
    return normal_path


def _to_posix(name: str) -> str:
    """Return the name of a file with slashes, as MuJoCo reads it on all systems."""
    return name.replace("\\", "/")

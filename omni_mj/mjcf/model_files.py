"""The files of which a model in MJCF consists: its own, included ones, meshes, textures."""

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

_FILE_ATTRIBUTES = (
    "file",
    "fileright",
    "fileleft",
    "fileup",
    "filedown",
    "filefront",
    "fileback",
)


def list_model_files(path: Path) -> list[Path]:
    """Return a model's file and all files that it names, existing or not.

    A file that is not valid XML names no others.
    """
    names = _find_file_names(path, path.parent, {})
    return list(dict.fromkeys([path, *(path.parent / name for name in names)]))


def read_model_files(path: Path) -> dict[str, bytes]:
    """Return the contents of a model's files by relative path, its own file first.

    The paths are relative to the lowest folder that contains all files.

    Raises:
        OSError: A file cannot be read.
        ValueError: A file is named by an absolute path. A copy of it would not be found.
    """
    for name in _find_file_names(path, path.parent, {}):
        if Path(name).is_absolute():
            raise ValueError(f"it names {name} by an absolute path; name it relative to the model")
    files = [Path(os.path.abspath(file)) for file in list_model_files(path)]
    common_folder = Path(os.path.commonpath([file.parent for file in files]))
    return {file.relative_to(common_folder).as_posix(): file.read_bytes() for file in files}


def _find_file_names(path: Path, main_folder: Path, asset_folders: dict[str, str]) -> Iterator[str]:
    """Yield the file names in a model, relative to the folder of the main file, as in MuJoCo.

    Args:
        path: File to read, the main one or an included one.
        main_folder: Folder of the main file.
        asset_folders: Folders of meshes and textures by kind; changed by <compiler> elements.
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

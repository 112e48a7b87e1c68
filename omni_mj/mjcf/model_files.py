"""The files that a model in MJCF is made of."""

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

_FILES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


def list_model_files(path: Path) -> list[Path]:
    """A model's file and all that it names: what it includes, and files of meshes, textures and heights.

    Files that do not exist are among them; of what is no XML, only itself.
    """
    return list(
        dict.fromkeys([path, *(path.parent / name for name in _named(path, path.parent, {}))])
    )


def read_model_files(path: Path) -> dict[str, bytes]:
    """What a model is made of, its own file first: where each file is, beside or below that of the others -> its bytes.

    Raises:
        OSError: one cannot be read.
        ValueError: one is named by an absolute path, so that a copy of it would not be found.
    """
    for name in _named(path, path.parent, {}):
        if Path(name).is_absolute():
            raise ValueError(f"it names {name} by an absolute path; name it relative to the model")
    parts = [Path(os.path.abspath(part)) for part in list_model_files(path)]
    top = Path(os.path.commonpath([part.parent for part in parts]))
    return {part.relative_to(top).as_posix(): part.read_bytes() for part in parts}


def _named(path: Path, folder: Path, folders: dict[str, str]) -> Iterator[str]:
    """Names of files, relative to the folder of the main one, as MuJoCo has it."""
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError):
        return
    for compiler in root.iter("compiler"):
        both = compiler.get("assetdir")
        for kind in ("mesh", "texture"):
            if there := compiler.get(f"{kind}dir", both):
                folders[kind] = there
    for include in root.iter("include"):
        if name := include.get("file"):
            yield name
            yield from _named(folder / name, folder, folders)
    for kind in ("mesh", "texture", "hfield", "skin"):
        below = Path(folders.get("texture" if kind == "texture" else "mesh", ""))
        for element in root.iter(kind):
            yield from ((below / name).as_posix() for key in _FILES if (name := element.get(key)))

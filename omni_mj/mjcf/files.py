"""The files that a model in MJCF is made of."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

_FILES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")


def parts_of(path: Path) -> list[Path]:
    """A model's file and all that it names: what it includes, and files of meshes, textures and heights.

    Files that do not exist are among them; of what is no XML, only itself.
    """
    return list(dict.fromkeys(_parts(path, path.parent, {})))


def _parts(path: Path, folder: Path, folders: dict[str, str]) -> Iterator[Path]:
    yield path
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
            yield from _parts(folder / name, folder, folders)  # relative to the main file, as MuJoCo has it
    for kind in ("mesh", "texture", "hfield", "skin"):
        below = folder / folders.get("texture" if kind == "texture" else "mesh", "")
        for element in root.iter(kind):
            yield from (below / name for key in _FILES if (name := element.get(key)))

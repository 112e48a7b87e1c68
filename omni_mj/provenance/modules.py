"""Modules of a user's own that a user's file imports, and the packages of others that it needs."""

import ast
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path
from types import ModuleType

import omni_control
from omni_mj.measure.summary import installed

OURS = ("omni_mj", "omni_control")


def own(source: bytes) -> dict[str, Path]:
    """The user's own modules that a source imports, and those that they do: path below a folder of modules -> file.

    Of a package of the user's, all Python files are meant. What is imported by a name made up while it runs is not
    seen.
    """
    found: dict[str, Path] = {}
    asked, sources = set[str](), [source]
    while sources:
        for name in sorted(_imported(sources.pop()) - asked):
            asked.add(name)
            for inside, path in _files(name, sys.modules.get(name)):
                found[inside] = path
                with suppress(OSError):
                    sources.append(path.read_bytes())
    return found


def versions(sources: Mapping[str, bytes]) -> dict[str, str]:
    """Versions of the packages of others that sources import: name of the package as it is installed -> version."""
    names = set[str]().union(*map(_imported, sources.values())) - {*sys.stdlib_module_names, *OURS}
    others = {name for name in names if name in sys.modules and not list(_files(name, sys.modules[name]))}
    return installed(sorted(_packages(frozenset(others))))


@cache
def _packages(names: frozenset[str]) -> set[str]:
    """The packages that modules, which are imported, are installed with; to read what all have takes 0.2 s."""
    homes = packages_distributions() if names else {}
    return {package for name in names for package in homes.get(name, ())}


def _imported(source: bytes) -> set[str]:
    """The first parts of the names of modules that a source imports, wherever in it."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):  # of a file that is never run
        return set()
    names = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and not node.level]
    return {name.partition(".")[0] for name in names}


def _files(name: str, module: ModuleType | None) -> Iterator[tuple[str, Path]]:
    """The files of a module that is no part of Python, of this program or of an installed package."""
    if module is None or name in OURS or name in sys.stdlib_module_names:
        return
    for folder in map(Path, getattr(module, "__path__", ())):
        if _users(folder):
            yield from (
                (f"{name}/{path.relative_to(folder).as_posix()}", path) for path in sorted(folder.rglob("*.py"))
            )
    file = Path(getattr(module, "__file__", None) or "")
    if not hasattr(module, "__path__") and file.suffix == ".py" and _users(file):
        yield f"{name}.py", file


def _users(path: Path) -> bool:
    installed = [Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    installed += [Path(omni_control.__file__).parent, Path(__file__).parents[1]]
    there = path.resolve()
    below = any(there.is_relative_to(each.resolve()) for each in installed)
    return not below and not {"site-packages", "dist-packages"} & set(there.parts)

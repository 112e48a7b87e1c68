"""Classes of a user's own, named by their file: `my_file.py:MyClass`."""

import importlib.util
import inspect
import os
import sys
from collections.abc import Callable
from functools import lru_cache
from importlib.abc import SourceLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from omni_control.errors import OmniError, choose, printable

_OURS = "omni_user_"  # before the names of the modules
_SOURCE = "__omni_source__"  # a module's attribute: the bytes that it was made of


def names_class(name: str) -> bool:
    """Whether a name is one of a class in a file, which need not exist."""
    file, colon, _ = name.rpartition(":")
    return bool(colon) and file.endswith(".py")


def find(name: str, what: str, fits: Callable[[type], bool]) -> type[Any]:
    """The class named `file.py:Class`, of those that the file itself defines and that fit.

    Args:
        name: of the class.
        what: it must be, for messages: "derived from ...".
        fits: whether a class is that.

    Raises:
        OmniError: there is no such file or class, the class does not fit, or the file cannot be run.
    """
    file, _, class_name = name.rpartition(":")
    module = _run(Path(file))
    own = {
        key: value
        for key, value in vars(module).items()
        if inspect.isclass(value) and value.__module__ == module.__name__ and fits(value)
    }
    if class_name not in own:
        found = f"; {choose(class_name, sorted(own))}" if own else " and no other"
        raise OmniError(f"{file} has no class {class_name!r} {what}{found}")
    return own[class_name]


def source(name: str) -> bytes:
    """The source of the class named `file.py:Class`, as it was run.

    Raises:
        OmniError: as `find`.
    """
    data: bytes = vars(_run(Path(name.rpartition(":")[0])))[_SOURCE]
    return data


def _run(path: Path) -> ModuleType:
    """Run a Python file as a module, once as long as it does not change."""
    if not os.path.isfile(path):
        raise OmniError(f"there is no file {path}")
    state = path.stat()
    return _module(path.resolve(), path, (state.st_mtime_ns, state.st_size))


@lru_cache
def _module(file: Path, path: Path, state: tuple[int, int]) -> ModuleType:
    spec = importlib.util.spec_from_file_location(_OURS + file.stem, file)
    assert spec is not None, "a .py file has a loader"
    assert isinstance(spec.loader, SourceLoader)
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module  # where dataclasses look up the annotations of their module
    try:
        # What is run must be what is recorded; the loader's exec_module may run bytecode of an older file instead.
        data = file.read_bytes()
        vars(module)[_SOURCE] = data
        exec(spec.loader.source_to_code(data, str(file)), vars(module))
    except (Exception, SystemExit) as error:
        raise OmniError(f"{path} cannot be run: {type(error).__name__}: {printable(str(error))}") from error
    return module

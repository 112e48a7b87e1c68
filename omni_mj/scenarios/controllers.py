"""Controllers by name: those of `omni_control`, and a user's own from a Python file."""

import sys
from collections.abc import Iterable

from omni_control import controllers
from omni_control.controllers.base import Controller
from omni_control.errors import OmniError, choose
from omni_control.registry import CONTROLLERS
from omni_mj.scenarios import user_files

Kind = str | type[Controller]


def find(kind: Kind) -> type[Controller]:
    """The class of a controller: given itself, by the name of one that comes along, or as `my_file.py:MyController`.

    Raises:
        OmniError: there is no such controller, file or class, the file cannot be run, or the class is no `Controller`.
    """
    if not isinstance(kind, str):
        return kind
    if kind in CONTROLLERS:
        return controllers.find(kind)
    if not user_files.names_class(kind):
        hint = choose(kind, sorted(CONTROLLERS))
        raise OmniError(f"unknown controller {kind!r}; {hint}, or a class of yours: file.py:Class")
    return user_files.find(kind, "derived from omni_control.Controller", lambda found: issubclass(found, Controller))


def resolve(kinds: Iterable[Kind]) -> dict[str, type[Controller]]:
    """Label -> class of several controllers."""
    return {label(kind): find(kind) for kind in kinds}


def label(kind: Kind) -> str:
    """What a controller is called in tables and files: the class's name for a user's own."""
    return kind.rpartition(":")[2] if isinstance(kind, str) else kind.__name__


def written(kind: Kind) -> str:
    """How a scenario's file names a controller: a class by the file that it is in, as far as it is in one."""
    if isinstance(kind, str):
        return kind
    file = getattr(sys.modules.get(kind.__module__), "__file__", None) or kind.__module__
    return f"{file}:{kind.__qualname__}"

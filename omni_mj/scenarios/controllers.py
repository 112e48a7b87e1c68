"""Controllers by name: those of `omni_control`, and a user's own from a Python file; and their parameters."""

import sys
from collections.abc import Iterable, Mapping
from typing import Any

from omni_control import controllers
from omni_control.controllers import checked_parameters
from omni_control.controllers.base import Controller
from omni_control.errors import OmniError, choose
from omni_control.registry import CONTROLLERS
from omni_mj.scenarios import user_files
from omni_mj.scenarios.checking import in_one

Kind = str | type[Controller]


def find(kind: Kind) -> type[Controller]:
    """Return the class of a controller: given itself, by name, or as `my_file.py:MyController`.

    Raises:
        OmniError: There is no such controller, file or class, the file cannot be run, or the class is no `Controller`.
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
    """Return the classes of several controllers by label."""
    return {label(kind): find(kind) for kind in kinds}


def label(kind: Kind) -> str:
    """Return the name of a controller in tables and files: the class's name for a user's own."""
    return kind.rpartition(":")[2] if isinstance(kind, str) else kind.__name__


def written(kind: Kind) -> str:
    """Return the name of a controller in a scenario's file: a class by the file that it is in, if there is one."""
    if isinstance(kind, str):
        return kind
    file = getattr(sys.modules.get(kind.__module__), "__file__", None) or kind.__module__
    return f"{file}:{kind.__qualname__}"


def check_parameters(
    parameters: Mapping[str, Mapping[str, Any]], kinds: Mapping[str, type[Controller]]
) -> dict[str, dict[str, Any]]:
    """Return parameters as the controllers take them: a whole number becomes a float where one is needed.

    Args:
        parameters: Label -> parameter -> value.
        kinds: The controllers by label.

    Raises:
        OmniError: There is no such controller or parameter, or a value has another type; a line for each.
    """
    errors: list[str] = []
    result: dict[str, dict[str, Any]] = {}
    for name, values in parameters.items():
        if name not in kinds:
            errors.append(f"unknown controller {name!r} in [controller.{name}]; {choose(name, kinds)}")
            continue
        result[name] = {}
        for key, value in values.items():
            try:
                result[name] |= checked_parameters(kinds[name], {key: value})
            except OmniError as error:
                errors.append(f"controller.{name}.{key}: {error}")
    in_one(errors)
    return result

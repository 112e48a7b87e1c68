"""The controllers by the names that users call them, each loaded when it is asked for; made, with their parameters."""

import inspect
import math
import numbers
from collections.abc import Mapping
from importlib import import_module
from typing import TypeVar

from omni_control.controllers.base import Controller, Told, error_place, record_of
from omni_control.errors import ControllerError, OmniError, choose
from omni_control.reference import Reference
from omni_control.registry import CONTROLLERS, missing

Parameter = bool | int | float | str
Kind = TypeVar("Kind", bound=Controller)

MAX_MEMORY_FRAMES = 36_000
_WANTED = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


def find(name: str) -> type[Controller]:
    """The class of the controller called `name`.

    Raises:
        OmniError: there is no such controller, or a package that it needs is not installed.
    """
    if name not in CONTROLLERS:
        raise OmniError(f"unknown controller {name!r}; {choose(name, sorted(CONTROLLERS))}")
    if package := missing(name):
        get = f"pip install 'omni-mj[{name}]'"
        raise OmniError(f"controller {name!r} needs the package {package}, which is not installed; get it by {get}")
    module, _, class_name = CONTROLLERS[name].partition(":")
    return getattr(import_module(module), class_name)


def parameters(kind: type[Controller]) -> dict[str, Parameter]:
    """Names and default values of a controller's parameters; see `Controller`. Those of its base classes come first."""
    names = [name for base in reversed(kind.__mro__) for name in inspect.get_annotations(base)]
    return {
        name: getattr(kind, name)
        for name in dict.fromkeys(names)
        if not name.startswith("_") and _type(kind, name) is not None
    }


def checked_parameters(kind: type[Controller], given: Mapping[str, object]) -> dict[str, Parameter]:
    """The parameters given, each of its type: a whole number is a number too.

    Raises:
        OmniError: a name that the controller does not have, or a value of another type; all of them, one line each.
    """
    known, checked, wrong = parameters(kind), {}, []
    for name, value in given.items():
        if name not in known:
            none = f"{kind.__name__} has no parameter {name!r}; "
            wrong.append(none + (choose(name, known) if known else "it has none at all"))
        elif (fitting := _fitting(value, wanted := _type(kind, name))) is None:
            wrong.append(f"parameter {name} of {kind.__name__} must be {_WANTED[wanted]}, not {value!r}")  # type: ignore[index]
        else:
            checked[name] = fitting
    if wrong:
        raise OmniError("\n".join(wrong))
    return checked


def make(
    kind: str | type[Kind],
    told: Told,
    reference: Reference,
    n: int,
    parameters: Mapping[str, object] | None = None,
) -> Controller:
    """Return a controller of `n` robots, by its class or its name.

    Its `parameters` are set before its constructor runs.

    Raises:
        OmniError: there is no controller of that name, or a parameter is wrong.
        ControllerError: its constructor failed, or did not call that of `Controller`.
    """
    found = find(kind) if isinstance(kind, str) else kind
    values = checked_parameters(found, parameters or {})
    controller = found.__new__(found)
    for name, value in values.items():
        setattr(controller, name, value)
    try:
        controller.__init__(told, reference, n)  # type: ignore[misc]
        record_of(controller, n)
        if not 0 <= controller.memory_frames <= MAX_MEMORY_FRAMES:
            raise OmniError(f"memory_frames must be from 0 to {MAX_MEMORY_FRAMES}")
    except Exception as error:
        raise ControllerError(f"{found.__name__} cannot be made{error_place(found, error)}") from error
    return controller


def _type(kind: type[Controller], name: str) -> type | None:
    """The type of a parameter, by its annotation, or by its default where that says no more; None for none."""
    annotation = next(a[name] for base in kind.__mro__ if name in (a := inspect.get_annotations(base)))
    default = getattr(kind, name, None)
    if type(default) not in _WANTED or "ClassVar" in str(annotation):
        return None
    named = {t.__name__: t for t in _WANTED}
    return named.get(annotation if isinstance(annotation, str) else getattr(annotation, "__name__", ""), type(default))


def _fitting(value: object, wanted: type | None) -> Parameter | None:
    """The value as a parameter of that type, None if it is of another."""
    if wanted is bool or isinstance(value, bool):
        return value if wanted is bool and isinstance(value, bool) else None
    if wanted is str:
        return value if isinstance(value, str) else None
    if wanted is int:
        return int(value) if isinstance(value, numbers.Integral) else None
    return float(value) if isinstance(value, numbers.Real) and math.isfinite(value) else None

"""The controllers by the names that users call them, each loaded when it is asked for; made, with their parameters."""

import inspect
import math
import numbers
from collections.abc import Mapping
from importlib import import_module
from typing import TypeVar

from omni_control.controllers.base import Controller, TeamModel, error_place, record_of
from omni_control.errors import ControllerError, OmniError, choose
from omni_control.reference import Reference
from omni_control.registry import CONTROLLERS, missing

Parameter = bool | int | float | str
Kind = TypeVar("Kind", bound=Controller)

MAX_MEMORY_FRAMES = 36_000
# What a parameter of a type may be given as, and what to ask for.
_ACCEPTED: dict[type, tuple[type, str]] = {
    bool: (bool, "true or false"),
    int: (numbers.Integral, "a whole number"),
    float: (numbers.Real, "a number"),
    str: (str, "a text"),
}


def find(name: str) -> type[Controller]:
    """The class of the controller called `name`.

    Raises:
        OmniError: there is no such controller, or a package that it needs is not installed.
    """
    if name not in CONTROLLERS:
        raise OmniError(f"unknown controller {name!r}; {choose(name, sorted(CONTROLLERS))}")
    if package := missing(name):
        get = f"pip install 'omni-mj[{name}]'"
        raise OmniError(
            f"controller {name!r} needs the package {package}, which is not installed; get it by {get}"
        )
    module, _, class_name = CONTROLLERS[name].partition(":")
    return getattr(import_module(module), class_name)


def parameters(kind: type[Controller]) -> dict[str, Parameter]:
    """Names and default values of a controller's parameters; see `Controller`. Those of its base classes come first."""
    return {name: getattr(kind, name) for name in _types(kind)}


def checked_parameters(kind: type[Controller], given: Mapping[str, object]) -> dict[str, Parameter]:
    """The parameters given, each of its type: a whole number is a number too.

    Raises:
        OmniError: a name that the controller does not have, or a value of another type; all of
            them, one line each.
    """
    types, checked, wrong = _types(kind), dict[str, Parameter](), []
    for name, value in given.items():
        if name not in types:
            hint = choose(name, types) if types else "it has none at all"
            wrong.append(f"{kind.__name__} has no parameter {name!r}; {hint}")
            continue
        wanted = types[name]
        accepted, text = _ACCEPTED[wanted]
        fits = isinstance(value, accepted) and isinstance(value, bool) == (wanted is bool)
        if fits and (isinstance(value, str) or math.isfinite(value)):  # type: ignore[arg-type]
            checked[name] = wanted(value)
        else:
            wrong.append(f"parameter {name} of {kind.__name__} must be {text}, not {value!r}")
    if wrong:
        raise OmniError("\n".join(wrong))
    return checked


def make(
    kind: str | type[Kind],
    model: TeamModel,
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
        controller.__init__(model, reference, n)  # type: ignore[misc]
        record_of(controller, n)
        if not 0 <= controller.memory_frames <= MAX_MEMORY_FRAMES:
            raise OmniError(f"memory_frames must be from 0 to {MAX_MEMORY_FRAMES}")
    except Exception as error:
        raise ControllerError(
            f"{found.__name__} cannot be made{error_place(found, error)}"
        ) from error
    return controller


def _types(kind: type[Controller]) -> dict[str, type]:
    """The types of a controller's parameters, by their annotations."""
    named = {wanted.__name__: wanted for wanted in _ACCEPTED}
    annotations: dict[str, object] = {}
    for base in reversed(kind.__mro__):
        annotations |= inspect.get_annotations(base)
    types = {
        name: named.get(str(getattr(each, "__name__", each))) for name, each in annotations.items()
    }
    return {
        name: kind_
        for name, kind_ in types.items()
        if kind_ and name[0] != "_" and hasattr(kind, name)
    }

"""Find controllers and plants by name or by the class path of a user's class, `file.py:Class`."""

import inspect
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from pkgutil import resolve_name
from types import ModuleType
from typing import Any

from omni_control.controllers.base import Controller, describe_error
from omni_control.controllers.registry import (
    CONTROLLERS,
    load_controller_class,
    validate_parameters,
)
from omni_control.errors import OmniError, suggest_names, to_printable
from omni_mj.config.validation import collect_errors, raise_errors

ControllerSpec = str | type[Controller]  # a name, a class path "file.py:Class", or a class
PLANTS: dict[str, str] = {  # to add a plant, add a line here
    "mujoco": "omni_mj.plants.mujoco_plant:MujocoPlant",
    "planar": "omni_mj.plants.planar_plant:PlanarPlant",
    "kinematic": "omni_mj.plants.kinematic_plant:KinematicPlant",
    "live": "omni_mj.live.live_loop:LivePlant",
}
_PLANT_METHODS = ("pose", "twist", "advance", "telemetry")  # required; see `omni_mj.plants.Plant`
USER_MODULE_PREFIX = "omni_user_"


def find_controller(spec: ControllerSpec) -> type[Controller]:
    """Return the class of a controller.

    Args:
        spec: Name of a controller, `file.py:Class`, or the class itself.

    Raises:
        OmniError: There is no such controller, file or class, or the file cannot be run.
    """
    if isinstance(spec, type) and issubclass(spec, Controller):
        return spec
    name = str(spec)
    if name in CONTROLLERS:
        return load_controller_class(name)
    if not is_class_path(name):
        hint = suggest_names(name, sorted(CONTROLLERS))
        raise OmniError(f"unknown controller {name!r}; {hint}, or a class of yours: file.py:Class")
    return load_class(
        name,
        "derived from omni_control.Controller",
        lambda candidate: issubclass(candidate, Controller),
    )


def find_plant(name: str) -> type[Any]:
    """Return the class of a plant.

    A user's class is wrapped: an exception in one of its methods becomes an `OmniError`.

    Args:
        name: Name of a plant, or `file.py:Class` of a class like `omni_mj.plants.Plant`.

    Raises:
        OmniError: There is no such plant, or the class lacks a method of plants.
    """
    if name in PLANTS:
        return resolve_name(PLANTS[name])
    if not is_class_path(name):
        hint = suggest_names(name, PLANTS)
        raise OmniError(f"unknown plant {name!r}; {hint}, or a class of yours: file.py:Class")
    user_class = load_class(
        name,
        f"with the methods {', '.join(_PLANT_METHODS)}",
        lambda candidate: all(hasattr(candidate, method) for method in _PLANT_METHODS),
    )
    methods = ("__init__", *_PLANT_METHODS)
    guarded_methods = {method: _guard_method(user_class, method) for method in methods}
    return type(user_class.__name__, (user_class,), guarded_methods)


def _guard_method(plant_class: type[Any], method: str) -> Callable[..., Any]:
    """Return a method of a user's plant that turns exceptions into an `OmniError` of one line."""

    def guarded(*arguments: Any, **keywords: Any) -> Any:
        try:
            return getattr(plant_class, method)(*arguments, **keywords)
        except (Exception, SystemExit) as error:
            description = describe_error(plant_class, error)
            raise OmniError(f"the plant {plant_class.__name__}{description}") from error

    return guarded


def label_controller(spec: ControllerSpec) -> str:
    """Return the label of a controller in tables and files: its name, or the name of its class."""
    return spec.rpartition(":")[2] if isinstance(spec, str) else spec.__name__


def format_controller_spec(spec: ControllerSpec) -> str:
    """Return a controller as in a scenario file: its name or, for a class, its class path."""
    if isinstance(spec, str):
        return spec
    file = getattr(sys.modules.get(spec.__module__), "__file__", None) or spec.__module__
    return f"{file}:{spec.__qualname__}"


def validate_controller_parameters(
    parameters: Mapping[str, Mapping[str, Any]], controllers: Iterable[ControllerSpec]
) -> dict[str, dict[str, Any]]:
    """Return validated parameters of controllers. An int becomes a float where one is needed.

    Args:
        parameters: Label of controller -> name of parameter -> value.
        controllers: Controllers of the scenario.

    Raises:
        OmniError: There is no such controller or parameter, or a value has another type. The
            message has one line per error.
    """
    specs = {label_controller(spec): spec for spec in controllers}
    errors: list[str] = []
    result: dict[str, dict[str, Any]] = {}
    for label, values in parameters.items():
        with collect_errors(errors, f"controller.{label}: "):
            if label not in specs:
                raise OmniError(f"there is no such controller; {suggest_names(label, specs)}")
            result[label] = validate_parameters(find_controller(specs[label]), values)
    raise_errors(errors)
    return result


def is_class_path(name: str) -> bool:
    """Return whether a name is a class path, `file.py:Class`. The file need not exist."""
    file, colon, _ = name.rpartition(":")
    return bool(colon) and file.endswith(".py")


def load_class(name: str, requirement: str, is_suitable: Callable[[type], bool]) -> type[Any]:
    """Run a user's file and return a class in it.

    Args:
        name: Class path, `file.py:Class`.
        requirement: Requirement of the class, for messages: "derived from ...".
        is_suitable: Returns whether a class meets the requirement.

    Raises:
        OmniError: There is no such file or suitable class, or the file cannot be run.
    """
    file, _, class_name = name.rpartition(":")
    path = Path(file)
    if not os.path.isfile(path):  # unlike `Path.is_file`, also if the name is too long
        raise OmniError(f"there is no file {to_printable(file)}")
    module = _run_file(path.resolve(), path.stat().st_mtime_ns)
    classes = {
        key: value
        for key, value in vars(module).items()
        if inspect.isclass(value) and is_suitable(value)
    }
    if class_name not in classes:
        choices = ", ".join(classes) or "none"
        raise OmniError(f"{file} has no class {class_name!r} {requirement}; it has {choices}")
    return classes[class_name]


@lru_cache
def _run_file(file: Path, modified_ns: int) -> ModuleType:
    """Run a Python file as a module. The modification time keys the cache."""
    module = ModuleType(USER_MODULE_PREFIX + file.stem)
    module.__file__ = str(file)
    sys.modules[module.__name__] = module  # where dataclasses resolve annotations
    try:
        exec(compile(file.read_bytes(), file, "exec"), vars(module))
    except (Exception, SystemExit) as error:
        reason = f"{type(error).__name__}: {to_printable(str(error))}"
        if isinstance(error, ModuleNotFoundError):
            reason += "; folders of your own modules must be in PYTHONPATH"
        raise OmniError(f"{file} cannot be run: {reason}") from error
    return module

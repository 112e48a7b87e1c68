"""Controllers and plants by name: the package's, or a class of a user's own, `my_file.py:MyClass`."""

import inspect
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from omni_control.controllers import CONTROLLERS, load_controller_class, validate_parameters
from omni_control.controllers.base import Controller, describe_error
from omni_control.errors import OmniError, suggest_names, to_printable
from omni_mj.config.validation import raise_errors

Kind = str | type[Controller]
PLANTS: dict[str, str] = {  # a plant is added by its file and one line here
    "mujoco": "omni_mj.plants.mujoco:MujocoPlant",
    "planar": "omni_mj.plants.planar:PlanarPlant",
    "kinematic": "omni_mj.plants.kinematic:KinematicPlant",
    "live": "omni_mj.live.live_loop:LivePlant",
}
_CALLS = ("pose", "twist", "advance", "telemetry")  # of `omni_mj.plants.Plant`
_OURS = "omni_user_"  # before the names of modules that are a user's files


def find_controller(kind: Kind) -> type[Controller]:
    """Return the class of a controller: given itself, by name, or as `my_file.py:MyController`.

    Raises:
        OmniError: There is no such controller, file or class, or the file cannot be run.
    """
    if isinstance(kind, type) and issubclass(kind, Controller):
        return kind
    name = str(kind)
    if name in CONTROLLERS:
        return load_controller_class(name)
    if not is_class_reference(name):
        hint = suggest_names(name, sorted(CONTROLLERS))
        raise OmniError(f"unknown controller {name!r}; {hint}, or a class of yours: file.py:Class")
    return load_class(
        name, "derived from omni_control.Controller", lambda found: issubclass(found, Controller)
    )


def find_plant(name: str) -> type[Any]:
    """Return the class of a plant, by its name or as `my_file.py:MyPlant`; see `omni_mj.plants.Plant`.

    Raises:
        OmniError: There is none, or the class lacks one of a plant's calls.
    """
    if name in PLANTS:
        module, _, class_name = PLANTS[name].partition(":")
        kind: type[Any] = getattr(import_module(module), class_name)
        return kind
    if not is_class_reference(name):
        raise OmniError(
            f"unknown plant {name!r}; {suggest_names(name, PLANTS)}, or a class of yours: file.py:Class"
        )
    fits = load_class(
        name,
        f"with the calls {', '.join(_CALLS)}",
        lambda found: all(hasattr(found, c) for c in _CALLS),
    )
    return type(
        fits.__name__, (fits,), {call: _guarded(fits, call) for call in ("__init__", *_CALLS)}
    )


def _guarded(plant: type[Any], call: str) -> Callable[..., Any]:
    """Return a call of a user's plant, of which exceptions are a line: where in its file, and what it says."""

    def guarded(*arguments: Any, **keywords: Any) -> Any:
        try:
            return getattr(plant, call)(*arguments, **keywords)
        except Exception as error:
            raise OmniError(f"the plant {plant.__name__}{describe_error(plant, error)}") from error

    return guarded


def label_controller(kind: Kind) -> str:
    """Return the name of a controller in tables and files: the class's name for a user's own."""
    return kind.rpartition(":")[2] if isinstance(kind, str) else kind.__name__


def reference_controller(kind: Kind) -> str:
    """Return the name of a controller in a scenario's file: a class by the file that it is in, if there is one."""
    if isinstance(kind, str):
        return kind
    file = getattr(sys.modules.get(kind.__module__), "__file__", None) or kind.__module__
    return f"{file}:{kind.__qualname__}"


def check_controller_parameters(
    parameters: Mapping[str, Mapping[str, Any]], kinds: Iterable[Kind]
) -> dict[str, dict[str, Any]]:
    """Return parameters as the controllers take them: a whole number becomes a float where one is needed.

    Args:
        parameters: Label -> parameter -> value.
        kinds: The controllers.

    Raises:
        OmniError: There is no such controller or parameter, or a value has another type; a line for
            each.
    """
    known, errors = {label_controller(kind): kind for kind in kinds}, list[str]()
    result: dict[str, dict[str, Any]] = {}
    for name, values in parameters.items():
        try:
            if name not in known:
                raise OmniError(f"there is no such controller; {suggest_names(name, known)}")
            result[name] = validate_parameters(find_controller(known[name]), values)
        except OmniError as error:
            errors += [f"controller.{name}: {line}" for line in str(error).splitlines()]
    raise_errors(errors)
    return result


def is_class_reference(name: str) -> bool:
    """Return whether a name is one of a class in a file, which need not exist."""
    file, colon, _ = name.rpartition(":")
    return bool(colon) and file.endswith(".py")


def load_class(name: str, what: str, fits: Callable[[type], bool]) -> type[Any]:
    """Return the class named `file.py:Class`, of those in the file that fit.

    Args:
        name: Of the class.
        what: It must be, for messages: "derived from ...".
        fits: Whether a class is that.

    Raises:
        OmniError: There is no such file or class, or the file cannot be run.
    """
    file, _, class_name = name.rpartition(":")
    path = Path(file)
    if not path.is_file():
        raise OmniError(f"there is no file {to_printable(file)}")
    module = _module(path.resolve(), path.stat().st_mtime_ns)
    kinds = {
        key: kind for key, kind in vars(module).items() if inspect.isclass(kind) and fits(kind)
    }
    if class_name not in kinds:
        raise OmniError(
            f"{file} has no class {class_name!r} {what}; it has {', '.join(kinds) or 'none'}"
        )
    return kinds[class_name]


@lru_cache
def _module(file: Path, changed: int) -> ModuleType:
    """Run a Python file as a module, once as long as it does not change."""
    module = ModuleType(_OURS + file.stem)
    module.__file__ = str(file)
    # Where dataclasses look up the annotations of their module
    sys.modules[module.__name__] = module
    try:
        exec(compile(file.read_bytes(), file, "exec"), vars(module))
    except (Exception, SystemExit) as error:
        hint = (
            "; your own modules must be on PYTHONPATH"
            if isinstance(error, ModuleNotFoundError)
            else ""
        )
        raise OmniError(
            f"{file} cannot be run: {type(error).__name__}: {to_printable(str(error))}{hint}"
        ) from error
    return module

"""Names of the controllers, and construction of a controller with its parameters.

A controller's module is imported when the controller is used. A list of names therefore does not
import scipy or a QP solver.
"""

import inspect
import math
import numbers
from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec

from omni_control.controllers.base import Controller, TeamModel, collect_channels, describe_error
from omni_control.errors import ControllerError, OmniError, suggest_names
from omni_control.reference import Reference

Parameter = bool | int | float | str

# Class of each controller: "module:class".
CONTROLLERS: dict[str, str] = {
    "flc": "omni_control.controllers.flc:Flc",
    "comp-flc": "omni_control.controllers.flc:CompFlc",
    "comp-flc-lag": "omni_control.controllers.flc:CompFlcLag",
    "inverse-flc": "omni_control.controllers.adaptive:InverseFlc",
    "adaptive-comp-flc": "omni_control.controllers.adaptive:AdaptiveCompFlc",
    "p": "omni_control.controllers.baselines:Proportional",
    "smith": "omni_control.controllers.baselines:SmithPredictor",
    "lqr": "omni_control.controllers.baselines:Lqr",
    "mpc": "omni_control.controllers.mpc:Mpc",
    "oracle": "omni_control.controllers.adaptive:Oracle",
}
# Packages beyond numpy and scipy. The extra `omni-mj[NAME]` installs that of controller NAME.
REQUIRED_PACKAGES = {"mpc": "piqp"}
MAX_MEMORY_FRAMES = 36_000
# Values that a parameter of each type accepts, and their description in messages.
_ACCEPTED: dict[type, tuple[type, str]] = {
    bool: (bool, "true or false"),
    int: (numbers.Integral, "a whole number"),
    float: (numbers.Real, "a number"),
    str: (str, "a string"),
}


def find_missing_package(name: str) -> str | None:
    """Return the package that controller `name` needs and that is not installed, or None."""
    package = REQUIRED_PACKAGES.get(name)
    return package if package and find_spec(package) is None else None


def list_available_controllers() -> tuple[str, ...]:
    """Return the names of the controllers whose packages are installed."""
    return tuple(name for name in CONTROLLERS if find_missing_package(name) is None)


def load_controller_class(name: str) -> type[Controller]:
    """Import and return the class of controller `name`.

    Raises:
        OmniError: The name is unknown, or a package that the controller needs is not installed.
    """
    if name not in CONTROLLERS:
        raise OmniError(f"unknown controller {name!r}; {suggest_names(name, sorted(CONTROLLERS))}")
    if package := find_missing_package(name):
        raise OmniError(
            f"controller {name!r} needs the package {package}, which is not installed; "
            f"install it with pip install 'omni-mj[{name}]'"
        )
    module, _, class_name = CONTROLLERS[name].partition(":")
    return getattr(import_module(module), class_name)


def get_parameters(controller_class: type[Controller]) -> dict[str, Parameter]:
    """Return names and default values of a controller's parameters, those of base classes first."""
    return {
        name: getattr(controller_class, name) for name in _get_parameter_types(controller_class)
    }


def validate_parameters(
    controller_class: type[Controller], values: Mapping[str, object]
) -> dict[str, Parameter]:
    """Return the values converted to the types of the controller's parameters.

    A whole number is accepted where a number is needed.

    Raises:
        OmniError: A name is unknown, or a value has another type. One line per error.
    """
    types = _get_parameter_types(controller_class)
    validated: dict[str, Parameter] = {}
    errors = []
    for name, value in values.items():
        if name not in types:
            hint = suggest_names(name, types) if types else "it has no parameters"
            errors.append(f"{controller_class.__name__} has no parameter {name!r}; {hint}")
            continue
        expected = types[name]
        accepted, description = _ACCEPTED[expected]
        is_valid = isinstance(value, accepted) and isinstance(value, bool) == (expected is bool)
        if is_valid and (isinstance(value, str) or math.isfinite(value)):  # type: ignore[arg-type]
            validated[name] = expected(value)
        else:
            errors.append(
                f"parameter {name} of {controller_class.__name__} must be {description}, "
                f"not {value!r}"
            )
    if errors:
        raise OmniError("\n".join(errors))
    return validated


def make_controller(
    controller: str | type[Controller],
    model: TeamModel,
    reference: Reference,
    n: int,
    parameters: Mapping[str, object] | None = None,
) -> Controller:
    """Return a controller of `n` robots.

    Args:
        controller: Name in `CONTROLLERS`, or a class.
        model: The team's knowledge of the robots and the loop.
        reference: Desired poses of the robots.
        n: Number of robots.
        parameters: Values by name, set before the constructor runs. Default: those of the class.

    Raises:
        OmniError: The name is unknown, or a parameter is wrong.
        ControllerError: The constructor failed, or did not call that of `Controller`.
    """
    controller_class = (
        load_controller_class(controller) if isinstance(controller, str) else controller
    )
    values = validate_parameters(controller_class, parameters or {})
    instance = controller_class.__new__(controller_class)
    for name, value in values.items():
        setattr(instance, name, value)
    try:
        instance.__init__(model, reference, n)  # type: ignore[misc]
        collect_channels(instance, n)
        if not 0 <= instance.memory_frames <= MAX_MEMORY_FRAMES:
            raise OmniError(
                f"memory_frames must be between 0 and {MAX_MEMORY_FRAMES}, "
                f"got {instance.memory_frames}"
            )
    except Exception as error:
        raise ControllerError(
            f"{controller_class.__name__} cannot be made{describe_error(controller_class, error)}"
        ) from error
    return instance


def _get_parameter_types(controller_class: type[Controller]) -> dict[str, type]:
    """Return the types of a controller's parameters, from the annotations of its class."""
    types_by_name = {accepted.__name__: accepted for accepted in _ACCEPTED}
    annotations: dict[str, object] = {}
    for base in reversed(controller_class.__mro__):
        annotations |= inspect.get_annotations(base)
    types = {}
    for name, annotation in annotations.items():
        annotated_type = types_by_name.get(str(getattr(annotation, "__name__", annotation)))
        if annotated_type and name[0] != "_" and hasattr(controller_class, name):
            types[name] = annotated_type
    return types

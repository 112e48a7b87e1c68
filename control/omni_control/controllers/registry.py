"""Names of the controllers, and construction of a controller with its parameters.

A controller's module is imported when the controller is used. So a list of names can be printed
without scipy and without a QP solver.
"""

import inspect
import math
from collections.abc import Mapping
from importlib.util import find_spec
from pkgutil import resolve_name

from omni_control.arguments import fits_annotation
from omni_control.controllers.base import Controller, TeamModel, collect_channels, describe_error
from omni_control.errors import ControllerError, OmniError, suggest_names
from omni_control.install_hints import describe_installation
from omni_control.reference import Reference

Parameter = bool | int | float | str

CONTROLLERS: dict[str, str] = {  # name -> "module:class"
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
# Controller -> package that it needs besides numpy and scipy. An extra of the controller's name
# installs it.
REQUIRED_PACKAGES = {"mpc": "piqp"}
# Type of a parameter -> description of its values in messages
_DESCRIPTIONS: dict[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a string",
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
            f"install it with {describe_installation(name)}"
        )
    return resolve_name(CONTROLLERS[name])


def get_parameters(controller_class: type[Controller]) -> dict[str, Parameter]:
    """Return names and default values of a controller's parameters, those of base classes first."""
    return {
        name: getattr(controller_class, name) for name in _get_parameter_types(controller_class)
    }


def validate_parameters(
    controller_class: type[Controller], values: Mapping[str, object]
) -> dict[str, Parameter]:
    """Return the values of some parameters, converted to the types of the parameters.

    A float parameter also accepts whole numbers.

    Raises:
        OmniError: A name is unknown, or a value is of the wrong type or not finite. One line per
            error.
    """
    types = _get_parameter_types(controller_class)
    validated: dict[str, Parameter] = {}
    errors = []
    for name, value in values.items():
        if name not in types:
            hint = suggest_names(name, types) if types else "it has no parameters"
            errors.append(f"{controller_class.__name__} has no parameter {name!r}; {hint}")
            continue
        parameter_type = types[name]
        is_valid = fits_annotation(value, parameter_type)
        if is_valid and (isinstance(value, str) or math.isfinite(value)):  # type: ignore[arg-type]
            validated[name] = parameter_type(value)
        else:
            errors.append(
                f"parameter {name} of {controller_class.__name__} must be "
                f"{_DESCRIPTIONS[parameter_type]}, not {value!r}"
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
        parameters: Values by name, set before the constructor runs. Default: the values in the
            class.

    Raises:
        OmniError: The name is unknown, or a parameter is wrong.
        ControllerError: The constructor fails, or does not call the constructor of `Controller`.
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
    except (Exception, SystemExit) as error:
        raise ControllerError(
            f"{controller_class.__name__} cannot be made{describe_error(controller_class, error)}"
        ) from error
    return instance


def _get_parameter_types(controller_class: type[Controller]) -> dict[str, type]:
    """Return the types of a controller's parameters, from the annotations of its class.

    An annotation is a type or, if it is quoted in the source, the name of a type.
    """
    types_by_name = {parameter_type.__name__: parameter_type for parameter_type in _DESCRIPTIONS}
    annotations: dict[str, object] = {}
    for base in reversed(controller_class.__mro__):
        annotations |= inspect.get_annotations(base)
    types = {}
    for name, annotation in annotations.items():
        parameter_type = types_by_name.get(str(getattr(annotation, "__name__", annotation)))
        if parameter_type and name[0] != "_" and hasattr(controller_class, name):
            types[name] = parameter_type
    return types

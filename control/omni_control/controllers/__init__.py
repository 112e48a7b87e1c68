"""Controllers: the base class, the paper's controllers, and those that they are compared with."""

from omni_control.controllers.registry import (
    CONTROLLERS,
    find_missing_package,
    get_parameters,
    list_available_controllers,
    load_controller_class,
    make_controller,
    validate_parameters,
)

__all__ = [
    "CONTROLLERS",
    "find_missing_package",
    "get_parameters",
    "list_available_controllers",
    "load_controller_class",
    "make_controller",
    "validate_parameters",
]

"""Checks of arguments in Python: integers and arrays of numbers."""

import numpy as np

from omni_control.errors import OmniError, format_value
from omni_control.kinematics import Array


def check_integer(name: str, value: object, low: int, high: int) -> int:
    """Return an integer of any type as int.

    Raises:
        OmniError: The value is not an integer from `low` to `high`.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    is_integer = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not is_integer or not low <= value <= high:  # type: ignore[operator]
        raise OmniError(
            f"{name} must be an integer from {low} to {high}, got {format_value(value)}"
        )
    return int(value)  # type: ignore[call-overload]


def check_array(name: str, value: object, shape: tuple[int | None, ...]) -> Array:
    """Return finite numbers as an array of floats.

    Args:
        name: Name of the argument in messages.
        value: Numbers as an array or nested lists.
        shape: Required shape; None allows any length.

    Raises:
        OmniError: The value has another shape, or is not made of finite numbers.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # lists of different lengths
        array = np.asarray(None)
    has_shape = array.ndim == len(shape) and all(
        length in (None, actual) for length, actual in zip(shape, array.shape, strict=True)
    )
    if not has_shape or array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        axes = ", ".join("n" if length is None else str(length) for length in shape)
        raise OmniError(
            f"{name} must be finite numbers of shape ({axes}{',' * (len(shape) == 1)}), "
            f"got {format_value(value)}"
        )
    return array.astype(float)

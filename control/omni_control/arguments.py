"""Checks of the types of arguments in Python, by annotations; of integers; and of arrays."""

import inspect
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache, wraps
from types import UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_control.errors import OmniError, format_value

F = TypeVar("F", bound=Callable[..., Any])
# Annotation -> types of the values that fit it
_SCALARS: dict[Any, tuple[type, ...]] = {
    bool: (bool, np.bool_),
    int: (int, np.integer),
    float: (int, float, np.integer, np.floating),
    str: (str,),
}


def check_integer(name: str, value: object, low: int, high: int) -> int:
    """Return an integer of any type as int.

    Raises:
        OmniError: The value is not an integer from `low` to `high`.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not fits_annotation(value, int) or not low <= value <= high:  # type: ignore[operator]
        raise OmniError(
            f"{name} must be an integer from {low} to {high}, got {format_value(value)}"
        )
    return int(value)  # type: ignore[call-overload]


def check_array(
    name: str, value: object, shape: tuple[int | None, ...], allow_nan: bool = False
) -> NDArray[np.float64]:
    """Return a copy of finite numbers as an array of floats.

    Args:
        name: Name of the argument in messages.
        value: Numbers as an array or nested lists.
        shape: Required shape; None allows any length.
        allow_nan: Whether numbers may be NaN.

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
    is_numeric = has_shape and array.dtype.kind in "iuf"
    if not is_numeric or np.isinf(array).any() or (np.isnan(array).any() and not allow_nan):
        axes = ", ".join("n" if length is None else str(length) for length in shape)
        raise OmniError(
            f"{name} must be finite numbers of shape ({axes}{',' * (len(shape) == 1)}), "
            f"got {format_value(value)}"
        )
    return array.astype(float)


def check_types(function: F) -> F:
    """Decorate a function or class: arguments must fit their annotations.

    Raises:
        OmniError: An argument has another type. The decorated function is not run.
    """
    if isinstance(function, type):
        function.__init__ = check_types(function.__init__)  # type: ignore[misc]
        return function

    @wraps(function)
    def check_and_call(*args: Any, **kwargs: Any) -> Any:
        _check_call(function, args, kwargs)
        return function(*args, **kwargs)

    return cast("F", check_and_call)


def explain_types(function: F) -> F:
    """Decorate a function, or the public methods of a class: explain exceptions.

    Types are checked only after an exception, which suits functions that run in every frame.

    Raises:
        OmniError: The function failed: an argument does not fit its annotation, or has another
            shape than the other arguments. The cause is the exception.
    """
    if isinstance(function, type):
        for name, member in list(vars(function).items()):
            is_public = name == "__init__" or not name.startswith("_")
            if is_public and inspect.isfunction(member):
                setattr(function, name, explain_types(member))
        return function

    @wraps(function)
    def call_and_check(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except OmniError:
            raise
        except (TypeError, AttributeError, ValueError, LookupError, ArithmeticError) as error:
            _check_call(function, args, kwargs)
            raise OmniError(f"{function.__qualname__}: {error}") from error

    return cast("F", call_and_check)


def _check_call(function: Callable[..., Any], args: Any, kwargs: Any) -> None:
    """Raise OmniError for the first argument of a call that does not fit its annotation."""
    signature, hints = _inspect_annotations(function)
    for name, value in signature.bind(*args, **kwargs).arguments.items():
        is_variadic = signature.parameters[name].kind in (
            inspect.Parameter.VAR_POSITIONAL,
            inspect.Parameter.VAR_KEYWORD,
        )
        if name in hints and not is_variadic and not fits_annotation(value, hints[name]):
            annotation = inspect.formatannotation(hints[name])
            is_array = "numpy._typing" in annotation or "numpy.ndarray" in annotation
            expected = "an array of numbers" if is_array else re.sub(r"[\w.]+\.", "", annotation)
            raise OmniError(f"{name} must be {expected}, got {format_value(value)}")


@cache
def _inspect_annotations(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    return inspect.signature(function), get_type_hints(function)


def fits_annotation(value: object, hint: Any) -> bool:
    """Return whether a value has the type of an annotation.

    NumPy's numbers are numbers, true and false are none. NaN is a number.
    """
    if hint is Any or hint is object or isinstance(hint, TypeVar):
        return True
    if hint is None or hint is type(None):
        return value is None
    if hint == ArrayLike or get_origin(hint) is np.ndarray:
        return _is_numeric(value)
    if hint in _SCALARS:
        is_bool = isinstance(value, (bool, np.bool_))
        return isinstance(value, _SCALARS[hint]) and is_bool == (hint is bool)
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(fits_annotation(value, arg) for arg in args)
    if origin is Literal:
        return isinstance(value, str | int) and value in args
    if origin is Callable:
        return callable(value)
    if origin is type:
        return isinstance(value, type) and issubclass(value, args[0])
    if origin is not None:
        return _fits_container(value, origin, args)
    try:
        return isinstance(value, hint)
    except TypeError:  # a protocol that cannot be checked
        return True


def _fits_container(value: Any, origin: type, args: tuple[Any, ...]) -> bool:
    """Return whether a value and its items have the types of an annotation such as list[int]."""
    if issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            fits_annotation(key, args[0]) and fits_annotation(item, args[1])
            for key, item in value.items()
        )
    if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
        return False
    if isinstance(value, np.ndarray):
        return value.ndim > 0 and all(fits_annotation(item, args[0]) for item in value)
    if issubclass(origin, Sequence) and not isinstance(value, Sequence):
        return False
    if not isinstance(value, Collection):  # an iterator, which must not be consumed
        return True
    if origin is tuple and args[-1] is not Ellipsis:
        return len(value) == len(args) and all(map(fits_annotation, value, args))
    return all(fits_annotation(item, args[0]) for item in value)


def _is_numeric(value: object) -> bool:
    """Return whether a value is an array of real numbers, or can be converted to one."""
    try:
        return np.asarray(value).dtype.kind in "iufb"
    except (TypeError, ValueError):  # lists of different lengths
        return False

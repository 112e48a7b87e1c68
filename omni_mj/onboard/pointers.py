"""What `addresses` are compiled to. Importing this takes numba."""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.numpy_support import carray


def _inttoptr(typing: Any, address: Any) -> Any:
    """The code that makes a pointer of an address."""

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.inttoptr(given[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), code


def _calling(typing: Any, function: Any, one: Any, other: Any) -> Any:
    """The code that calls a function of two pointers."""

    def code(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        pointer = context.get_value_type(types.voidptr)
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer])
        builder.call(
            builder.inttoptr(given[0], kind.as_pointer()), [builder.inttoptr(each, pointer) for each in given[1:]]
        )
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), code


_pointer: Any = intrinsic(_inttoptr)
_call: Any = intrinsic(_calling)


def floats(address: int, shape: tuple[int, ...]) -> Any:
    """See `addresses.floats`."""
    return carray(_pointer(address), shape, np.float64)


def vectors(address: int, shape: tuple[int, ...]) -> Any:
    """See `addresses.vectors`."""
    return carray(_pointer(address), shape, np.complex128)


def numbers(address: int, shape: tuple[int, ...]) -> Any:
    """See `addresses.numbers`."""
    return carray(_pointer(address), shape, np.int64)


def words(address: int, shape: tuple[int, ...]) -> Any:
    """See `addresses.words`."""
    return carray(_pointer(address), shape, np.int32)


def truths(address: int, shape: tuple[int, ...]) -> Any:
    """See `addresses.truths`."""
    return carray(_pointer(address), shape, np.bool_)


def call(function: int, one: int, other: int) -> Any:
    """See `addresses.call`."""
    return _call(function, one, other)

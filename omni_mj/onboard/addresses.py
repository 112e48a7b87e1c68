"""Arrays by their addresses: how a compiled loop is told of Python's arrays, all at once.

Handing an array to a compiled function costs up to half a microsecond, and the loops of a cycle, of which a simulated
second has 960, need sixty. So they are handed one, of addresses and sizes, and find the others by it. Nothing here
keeps an array alive: who writes its address down does.
"""

import ctypes

import numpy as np

Shape = tuple[int, ...]


def of(array: np.ndarray) -> int:
    """Where an array is.

    Raises:
        ValueError: its numbers are not side by side, in the order of its axes.
    """
    if not array.flags.c_contiguous:
        raise ValueError(f"an array of the shape {array.shape} is not in one piece")
    address: int = array.__array_interface__["data"][0]
    return address


def floats(address: int, shape: Shape) -> np.ndarray:
    """The array of float64 that is there (compiled: `pointers`)."""
    return _there(address, shape, np.float64)


def vectors(address: int, shape: Shape) -> np.ndarray:
    """The array of complex128 that is there (compiled: `pointers`)."""
    return _there(address, shape, np.complex128)


def numbers(address: int, shape: Shape) -> np.ndarray:
    """The array of int64 that is there (compiled: `pointers`)."""
    return _there(address, shape, np.int64)


def words(address: int, shape: Shape) -> np.ndarray:
    """The array of int32 that is there (compiled: `pointers`)."""
    return _there(address, shape, np.int32)


def truths(address: int, shape: Shape) -> np.ndarray:
    """The array of bool that is there (compiled: `pointers`)."""
    return _there(address, shape, np.bool_)


def call(function: int, one: int, other: int) -> None:
    """Call the C function that is there with two pointers (compiled: `pointers`)."""
    ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(int(function))(int(one), int(other))


def _there(address: int, shape: Shape, kind: type[np.generic]) -> np.ndarray:
    size = int(np.prod(shape)) * np.dtype(kind).itemsize
    return np.frombuffer(memoryview((ctypes.c_char * size).from_address(int(address))), kind).reshape(shape)

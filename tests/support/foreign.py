"""Protocol Buffers by hand, as somebody else would write them: shares no code with ours."""

import struct
from typing import Any


def field(number: int, value: Any) -> bytes:
    """A field: a whole number as varint, a float as 32 bits, bytes as they are after their length."""
    if isinstance(value, float):
        return _varint(number << 3 | 5) + struct.pack("<f", value)
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    return _varint(number << 3 | 2) + _varint(len(value)) + value


def fields(data: bytes) -> dict[int, list[Any]]:
    """The fields of a message by number: varints as numbers, all else as bytes."""
    found: dict[int, list[Any]] = {}
    at = 0
    while at < len(data):
        tag, at = _read(data, at)
        if tag & 7 == 0:
            value, at = _read(data, at)
        else:
            size, at = (8, at) if tag & 7 == 1 else (4, at) if tag & 7 == 5 else _read(data, at)
            value, at = data[at : at + size], at + size
        found.setdefault(tag >> 3, []).append(value)
    return found


def first(message: dict[int, list[Any]], number: int) -> Any:
    """A field that is there once."""
    (value,) = message[number]
    return value


def _varint(value: int) -> bytes:
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def _read(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            return value, at

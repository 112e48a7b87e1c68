"""Kinds of values of Protocol Buffers' binary encoding: how each is written and read.

Source: https://protobuf.dev/programming-guides/encoding.
"""

import operator
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from omni_control.errors import OmniError

VARINT, FIXED64, BYTES_OF_LENGTH, GROUP, END_OF_GROUP, FIXED32 = 0, 1, 2, 3, 4, 5  # wire types
MM_PER_M = 1000.0
MOST_OF_32_BITS = 5  # bytes of a tag or a length, as protobuf's own parsers have it

Read = Callable[[bytes, int, int], tuple[Any, int]]  # of (data, from, end): value and where it ends
Write = Callable[[Any], bytes]


ONE_BYTE = "B"

_BYTES = [bytes([value]) for value in range(0x80)]


class WireError(OmniError):
    """Bytes that are no such message, or values that a message cannot carry."""


@dataclass(frozen=True)
class Kind:
    """How a value is written.

    Args:
        wire_type: of it.
        read: how it is read.
        write: how it is written.
        form: code in `struct` of one that has a fixed size, or, `ONE_BYTE`, of one from 0 to 127; "" of others.
        scale: with which it is multiplied on the wire; None where that is not said of it.
    """

    wire_type: int
    read: Read
    write: Write
    form: str = ""
    scale: float | None = None


def read_varint(data: bytes, at: int, end: int, most: int = 10) -> tuple[int, int]:
    """A number of up to 64 bits in that many bytes at most, seven in a byte, the lowest first."""
    value = 0
    for shift in range(0, 7 * most, 7):
        if at >= end:
            raise WireError("cut off within a number")
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value & 0xFFFF_FFFF_FFFF_FFFF, at
    raise WireError(f"a number is longer than {most} bytes")


def write_varint(value: int) -> bytes:
    """A number of 0 to 2^64 - 1."""
    if 0 <= value <= 0x7F:
        return _BYTES[value]
    written = bytearray()
    while value > 0x7F:
        written.append(value & 0x7F | 0x80)
        value >>= 7
    written.append(value)
    return bytes(written)


def _integer(least: int, most: int, *, scale: float = 1.0) -> Kind:
    """Integers of 32 or 64 bits, two's complement in 64; on the wire they are multiplied by a scale."""
    bits = (most - min(least, 0)).bit_length()

    def read(data: bytes, at: int, end: int) -> tuple[Any, int]:
        value, at = read_varint(data, at, end)
        value &= (1 << bits) - 1
        value -= (least < 0 and value > most) << bits
        return value if scale == 1.0 else value / scale, at

    def write(value: Any) -> bytes:
        whole = operator.index(value) if scale == 1.0 else round(value * scale)
        if not least <= whole <= most:
            raise ValueError(f"must be from {least} to {most}")
        return write_varint(whole & 0xFFFF_FFFF_FFFF_FFFF)

    return Kind(VARINT, read, write, ONE_BYTE if scale == 1.0 else "")


def _real(code: str, wire_type: int, *, scale: float = 1.0) -> Kind:
    """IEEE 754 numbers, the lowest byte first; on the wire they are multiplied by a scale."""
    form = struct.Struct(code)
    size, unpack = form.size, form.unpack_from

    def read(data: bytes, at: int, end: int) -> tuple[float, int]:
        after = at + size
        if after > end:
            raise WireError("cut off within a number")
        return unpack(data, at)[0] / scale, after

    write = form.pack if scale == 1.0 else lambda value: form.pack(value * scale)
    return Kind(wire_type, read, write, code[-1], None if scale == 1.0 else scale)


def read_sized(data: bytes, at: int, end: int) -> tuple[bytes, int]:
    """Bytes after their number."""
    if at < end and data[at] < 0x80:  # as of most
        size, at = data[at], at + 1
    else:
        size, at = read_varint(data, at, end, MOST_OF_32_BITS)
    if size > end - at:
        raise WireError(f"cut off: {size} bytes are announced, {end - at} are left")
    return data[at : at + size], at + size


def _text(data: bytes, at: int, end: int) -> tuple[str, int]:
    raw, at = read_sized(data, at, end)
    return raw.decode(errors="replace"), at  # names only: what is no UTF-8 is no reason to lose a packet


def _truth(data: bytes, at: int, end: int) -> tuple[bool, int]:
    value, at = read_varint(data, at, end)
    return value != 0, at


def with_size(raw: bytes) -> bytes:
    """Bytes, their number before them."""
    return write_varint(len(raw)) + raw


UINT32 = _integer(0, 2**32 - 1)
INT32 = _integer(-(2**31), 2**31 - 1)
INT64 = _integer(-(2**63), 2**63 - 1)
FLOAT = _real("<f", FIXED32)
DOUBLE = _real("<d", FIXED64)
MILLIMETRES = _real("<f", FIXED32, scale=MM_PER_M)  # m here, mm on the wire
WHOLE_MILLIMETRES = _integer(-(2**31), 2**31 - 1, scale=MM_PER_M)
BOOL = Kind(VARINT, _truth, lambda value: b"\1" if value else b"\0")
TEXT = Kind(BYTES_OF_LENGTH, _text, lambda value: with_size(value.encode()))
BYTES = Kind(BYTES_OF_LENGTH, read_sized, lambda value: with_size(bytes(value)))


def of_enumeration(values: type[IntEnum]) -> Kind:
    """Values that are not known are as if absent, as proto2 has it."""
    known = {int(value): value for value in values}

    def read(data: bytes, at: int, end: int) -> tuple[IntEnum | None, int]:
        value, at = INT32.read(data, at, end)
        return known.get(value), at

    return Kind(VARINT, read, lambda value: INT32.write(values(value)))

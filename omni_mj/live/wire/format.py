"""Protocol Buffers' binary encoding, of messages that are described by tables of their own.

A message is a NamedTuple, each of whose fields is annotated with its number, kind and label:

    class Ball(NamedTuple):
        x: Annotated[float, required(3, MILLIMETRES)]
        z: Annotated[float | None, optional(5, MILLIMETRES)] = None

    decode(Ball, encode(Ball(x=1.5))) == Ball(x=1.5)

Sources: https://protobuf.dev/programming-guides/encoding for the format; proto2 for presence: what is required is
written though it is zero, and an optional field that is None is not.
"""

import struct
from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple, TypeVar, get_type_hints

from omni_mj.live.wire.kinds import (
    BYTES_OF_LENGTH,
    END_OF_GROUP,
    FIXED32,
    FIXED64,
    GROUP,
    MOST_OF_32_BITS,
    VARINT,
    Kind,
    Read,
    WireError,
    Write,
    of_enumeration,
    read_sized,
    read_varint,
    with_size,
    write_varint,
)
from omni_mj.live.wire.layout import Layout

MAX_BYTES = 65_507  # of a UDP datagram's payload over IPv4
MAX_GROUPS = 100  # within each other, in what is skipped; as deep as protobuf's own parsers go

Message = TypeVar("Message", bound=tuple[Any, ...])


class Field(NamedTuple):
    """What a table says of a field: number, kind (or a message's or enumeration's class), label."""

    number: int
    kind: Kind | type
    label: str


def required(number: int, kind: Kind | type) -> Field:
    """A field without which there is no message."""
    return Field(number, kind, "required")


def optional(number: int, kind: Kind | type) -> Field:
    """A field that is None when it is absent."""
    return Field(number, kind, "optional")


def one_of(number: int, kind: Kind | type) -> Field:
    """An optional field that excludes the others of its message that are so marked; the last that was sent counts."""
    return Field(number, kind, "one of")


def repeated(number: int, kind: type) -> Field:
    """A tuple of messages."""
    return Field(number, kind, "repeated")


class _Table(NamedTuple):
    """Plain tuples: of a packet with 12 robots, a hundred are gone through, cold, between two pieces of physics."""

    write: list[tuple[int, bytes, Write, str]]  # place in the NamedTuple, tag, how, label; by number: so it is written
    # By tag: place, how, whether it is a message, places that it excludes.
    read: dict[int, tuple[int, Read, bool, tuple[int, ...]]]
    messages: list[tuple[int, type[Any], bool]]  # place, class, whether repeated
    required: list[tuple[int, str]]  # place, name
    names: list[str]  # by place
    layout: Layout | None


def encode(message: tuple[Any, ...]) -> bytes:
    """The bytes of a message, its fields in the order of their numbers.

    Raises:
        WireError: a required field is None, or a value has the wrong type or is out of its kind's range.
    """
    table, written, place = _table(type(message)), bytearray(), 0
    if table.layout is not None and (whole := table.layout.write(message)) is not None:
        return whole
    try:
        for place, tag, write, label in table.write:
            value = message[place]
            if label == "repeated":
                for each in value:
                    written += tag
                    written += write(each)
            elif value is not None:
                written += tag
                written += write(value)
            elif label == "required":
                raise ValueError("is required")
    except WireError:  # of a message within this one
        raise
    except (TypeError, ValueError, OverflowError, AttributeError, struct.error) as error:
        what = f"{type(message).__name__}.{table.names[place]}"
        raise WireError(f"{what} cannot be {message[place]!r}: {error}") from None
    return bytes(written)


def decode(kind: type[Message], data: bytes) -> Message:
    """The message that bytes are; fields that its table does not have are skipped.

    Raises:
        WireError: they are cut off, malformed, too many, or lack what is required.
    """
    if len(data) > MAX_BYTES:
        raise WireError(f"{kind.__name__}: {len(data)} bytes; a packet has {MAX_BYTES} at most")
    try:
        return _read(kind, bytes(data))
    except WireError as error:
        raise WireError(f"{kind.__name__}: {error}") from None


def _read(kind: type[Message], *parts: bytes) -> Message:
    """A message; sent twice, it is merged: each part is well-formed, and what is required may be in any."""
    table = _table(kind)
    if table.layout is not None and len(parts) == 1 and (whole := table.layout.read(parts[0])) is not None:
        return kind(*whole)
    values: list[Any] = [None] * len(table.names)
    for data in parts:
        at, end = 0, len(data)
        while at < end:
            tag = data[at]
            at += 1
            if tag > 0x7F:
                tag, at = read_varint(data, at - 1, end, MOST_OF_32_BITS)
            entry = table.read.get(tag)
            if entry is None:
                at = _skipped(data, at, end, tag)
                continue
            place, read, within, others = entry
            value, at = read(data, at, end)
            for other in others:
                values[other] = None
            if not within:
                values[place] = values[place] if value is None else value
            elif values[place] is None:
                values[place] = [value]
            else:
                values[place].append(value)
    for place, message, many in table.messages:
        held = values[place]
        if many:
            values[place] = tuple([_read(message, raw) for raw in held or ()])
        elif held is not None:
            values[place] = _read(message, *held)
    for place, name in table.required:
        if values[place] is None:
            raise WireError(f"{kind.__name__}.{name} is required, and is missing")
    return kind(*values)


def _skipped(data: bytes, at: int, end: int, tag: int) -> int:
    """Where a field ends of which nothing is known."""
    open_groups: list[int] = []
    while True:
        number, wire_type = tag >> 3, tag & 7
        if not 0 < number < 2**29:
            raise WireError(f"{number} is no number of a field")
        if wire_type == VARINT:
            _, at = read_varint(data, at, end)
        elif wire_type == BYTES_OF_LENGTH:
            _, at = read_sized(data, at, end)
        elif wire_type in (FIXED32, FIXED64):
            at += 4 if wire_type == FIXED32 else 8
            if at > end:
                raise WireError("cut off within a number")
        elif wire_type == GROUP and len(open_groups) < MAX_GROUPS:
            open_groups.append(number)
        elif wire_type == END_OF_GROUP and open_groups and open_groups[-1] == number:
            open_groups.pop()
        else:
            raise WireError(f"field {number} has wire type {wire_type}, which cannot stand there")
        if not open_groups:
            return at
        tag, at = read_varint(data, at, end, MOST_OF_32_BITS)


def fields(kind: type[Any]) -> dict[str, Field]:
    """The fields of a message, by name, in the order of its NamedTuple."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: next(f for f in hint.__metadata__ if isinstance(f, Field)) for name, hint in hints.items()}


@cache
def _table(kind: type) -> _Table:
    """What the annotations of a message say."""
    described = fields(kind)
    exclusive = [place for place, field in enumerate(described.values()) if field.label == "one of"]
    table, kinds = _Table([], {}, [], [], list(described), None), list[tuple[int, int, Kind]]()
    for place, (name, field) in sorted(enumerate(described.items()), key=lambda item: item[1][1].number):
        coded, message = field.kind, None
        if not isinstance(coded, Kind):
            coded, message = (of_enumeration(coded), None) if issubclass(coded, IntEnum) else (_of(coded), coded)
        others = tuple(other for other in exclusive if other != place) if place in exclusive else ()
        tag = field.number << 3 | coded.wire_type
        table.write.append((place, write_varint(tag), coded.write, field.label))
        kinds.append((place, tag, coded))
        table.read[tag] = place, coded.read, message is not None, others
        if message is not None:
            table.messages.append((place, message, field.label == "repeated"))
        if field.label == "required":
            table.required.append((place, name))
    return table._replace(layout=Layout.of(kinds))


def _of(message: type[Any]) -> Kind:
    def write(value: Any) -> bytes:
        if type(value) is not message:
            raise TypeError(f"must be a {message.__name__}")
        return with_size(encode(value))

    return Kind(BYTES_OF_LENGTH, read_sized, write)

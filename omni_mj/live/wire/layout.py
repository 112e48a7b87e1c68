"""Messages of few small values, such as a velocity or a robot that was seen: by one call of `struct`, as whole."""

import struct
from collections.abc import Sequence
from typing import Any

from omni_mj.live.wire.kinds import ONE_BYTE, Kind


class Layout:
    """The bytes of a message all of whose fields are there, in the order of their numbers, each as short as can be.

    That is how most messages are; for others whoever asks has another way.

    Args:
        fields: place in the NamedTuple, tag, and kind, by number; the tags are below 128, and the kinds have a form.
    """

    def __init__(self, fields: Sequence[tuple[int, int, Kind]]) -> None:
        self._form = struct.Struct("<" + "".join(f"B{kind.form}" for _, _, kind in fields))
        self._tags = tuple(tag for _, tag, _ in fields)
        self._written = [(place, tag, kind.scale) for place, tag, kind in fields]
        order = sorted(range(len(fields)), key=lambda number: fields[number][0])
        self._read = [(2 * number + 1, fields[number][2].scale) for number in order]
        self._small = [place for place, _, kind in fields if kind.form == ONE_BYTE]
        self._small_read = [2 * number + 1 for number, (_, _, kind) in enumerate(fields) if kind.form == ONE_BYTE]

    @classmethod
    def of(cls, fields: Sequence[tuple[int, int, Kind]]) -> "Layout | None":
        """That of a message with these fields, if it has one."""
        return cls(fields) if fields and all(tag < 0x80 and kind.form for _, tag, kind in fields) else None

    def write(self, message: tuple[Any, ...]) -> bytes | None:
        """A message's bytes; None where they are others, or something is wrong with it."""
        if None in message:
            return None
        written = list[Any]()
        try:
            for place in self._small:
                if message[place] > 0x7F:
                    return None
            for place, tag, scale in self._written:
                written += tag, message[place] if scale is None else message[place] * scale
            return self._form.pack(*written)
        except (TypeError, ValueError, OverflowError, struct.error):
            return None

    def read(self, data: bytes) -> list[Any] | None:
        """The values of a message, by their places; None if the bytes are others."""
        if len(data) != self._form.size:
            return None
        found = self._form.unpack(data)
        if found[::2] != self._tags:
            return None
        for number in self._small_read:
            if found[number] > 0x7F:
                return None
        return [found[number] if scale is None else found[number] / scale for number, scale in self._read]

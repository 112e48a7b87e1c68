"""Bench of the league's messages: their descriptors, and bytes as messages."""

from typing import Any

from google.protobuf.descriptor import FieldDescriptor

from omni_mj.live.wire import WireError, league_pb2, parse_message

MESSAGES, ENUMERATIONS = (
    league_pb2.DESCRIPTOR.message_types_by_name,
    league_pb2.DESCRIPTOR.enum_types_by_name,
)


def table(message: str) -> str:
    """Label (! required, ? optional, * repeated), number, type and name of a message's fields."""
    kinds = {
        getattr(FieldDescriptor, name): name
        for name in dir(FieldDescriptor)
        if name.startswith("TYPE_")
    }
    rows = []
    for field in MESSAGES[message].fields:
        label = "*" if field.is_repeated else "!" if field.is_required else "?"
        inside = field.message_type or field.enum_type
        kind = inside.name if inside else kinds[field.type].removeprefix("TYPE_").lower()
        rows.append(f"{label}{field.number} {kind} {field.name}")
    return ", ".join(rows)


def read(packet: str, data: bytes) -> Any:
    """The message that bytes are; None if they are refused."""
    try:
        return parse_message(getattr(league_pb2, packet), data)
    except WireError:
        return None

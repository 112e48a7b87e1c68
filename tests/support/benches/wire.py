"""Bench of the league's messages: their descriptors, and bytes as messages."""

from typing import Any

from google.protobuf.descriptor import FieldDescriptor

from omni_mj.live.wire import WireError, parse, simulation_pb2, vision_pb2

FILES = vision_pb2.DESCRIPTOR, simulation_pb2.DESCRIPTOR
MESSAGES = {name: kind for file in FILES for name, kind in file.message_types_by_name.items()}
ENUMERATIONS = {name: kind for file in FILES for name, kind in file.enum_types_by_name.items()}


def table(message: str) -> dict[int, tuple[str, str, str]]:
    """Field number -> label, type and name of a message's fields."""
    rows = {}
    for field in MESSAGES[message].fields:
        label = "repeated" if field.is_repeated else "required" if field.is_required else "optional"
        inside = field.message_type or field.enum_type
        kinds = {getattr(FieldDescriptor, name): name for name in dir(FieldDescriptor) if name.startswith("TYPE_")}
        kind = inside.name if inside else kinds[field.type].removeprefix("TYPE_").lower()
        rows[field.number] = label, kind, field.name
    return rows


def read(packet: str, data: bytes) -> Any:
    """The message that bytes are; None if they are refused."""
    try:
        return parse(getattr(vision_pb2 if packet == "VisionPacket" else simulation_pb2, packet), data)
    except WireError:
        return None

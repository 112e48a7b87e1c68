"""Our codec against protobuf's own runtime, whose classes come from tables that share nothing with ours.

Where protobuf refuses a packet, ours raises `WireError`; where both accept, they read the same values. What differs is
known: of a text that is no UTF-8, protobuf gives the bytes, ours has replacement characters; `realism_config` and
feedback's `custom` are bytes here, into which nobody looks (so they are in the tables); and a way to move that another
one in the same command replaces is not looked into here.
"""

import math
from enum import IntEnum
from typing import Any

import league_protocol
import pytest
from google.protobuf.any_pb2 import Any as Anything
from google.protobuf.message import DecodeError
from hypothesis import given, settings
from hypothesis import strategies as st
from wire_messages import PACKETS, bad_packets, messages

from omni_mj.live.wire import WireError, decode, encode
from omni_mj.live.wire.format import fields
from omni_mj.live.wire.simulation import (
    MoveCommand,
    RobotCommand,
    RobotFeedback,
    RobotId,
    SimulatorCommand,
    SimulatorError,
    SyncResponse,
    TeleportRobot,
)
from omni_mj.live.wire.vision import VisionPacket

ALL = (*PACKETS, SyncResponse)
LACKING = {("Geometry", "models"), ("RobotSpecs", "custom")}  # fields that ours skips

kinds = pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.__name__)
few = settings(max_examples=40, deadline=None, derandomize=True)


def read_by_protobuf(kind: type[Any], data: bytes) -> dict[str, Any] | None:
    """What protobuf reads; None where it refuses."""
    try:
        made = league_protocol.message_class(kind.__name__).FromString(data)
    except DecodeError:
        return None
    return league_protocol.values(made) if made.IsInitialized() else None


def read_by_us(kind: type[Any], data: bytes) -> Any:
    """What ours reads; None where it refuses."""
    try:
        return decode(kind, data)
    except WireError:
        return None


def same(ours: Any, theirs: Any) -> bool:
    """Whether values are equal; numbers to the bit, but that any NaN is like another."""
    if isinstance(theirs, dict):
        return all(same(getattr(ours, name), theirs[name]) for name in ours._fields)
    if isinstance(theirs, list):
        return len(ours) == len(theirs) and all(map(same, ours, theirs))
    if isinstance(ours, str) and isinstance(theirs, bytes):
        return ours == theirs.decode(errors="replace")
    if isinstance(ours, float) and math.isnan(ours):
        return math.isnan(theirs)
    return ours == theirs and (ours is None) == (theirs is None)


def agree(kind: type[Any], data: bytes) -> bool:
    """That both read the same or both refuse; whether it was read."""
    ours, theirs = read_by_us(kind, data), read_by_protobuf(kind, data)
    assert (ours is None) == (theirs is None), f"{data.hex()}: ours {ours}, protobuf {theirs}"
    assert ours is None or same(ours, theirs), f"{data.hex()}: ours {ours}, protobuf {theirs}"
    return ours is not None


def reached(kind: type[Any]) -> set[type[Any]]:
    """A message, and all that it may hold."""
    held = [field.kind for field in fields(kind).values() if isinstance(field.kind, type)]
    return {kind}.union(*(reached(each) for each in held if not issubclass(each, IntEnum)))


def test_tables_have_the_same_fields() -> None:
    """Numbers, labels and names of all messages, and values of all enumerations; ours lacks what is listed above."""
    labels = {"!": "required", "?": "optional", "|": "one of", "*": "repeated"}
    lacking = set()
    for kind in set.union(*map(reached, ALL)):
        theirs = {row[4]: (row[1], labels[row[0]]) for row in league_protocol.rows(kind.__name__) if row[1] < 900}
        ours = {name: (field.number, field.label) for name, field in fields(kind).items()}
        assert ours.items() <= theirs.items()
        lacking |= {(kind.__name__, name) for name in theirs.keys() - ours.keys()}
        for field in fields(kind).values():
            if isinstance(field.kind, type) and issubclass(field.kind, IntEnum):
                assert set(field.kind) == set(league_protocol.ENUMERATIONS[field.kind.__name__])
    assert lacking == LACKING


@kinds
@given(data=st.data())
@few
def test_what_either_writes_the_other_reads(kind: type[Any], data: st.DataObject) -> None:
    """Also what a later version writes: fields and groups that ours does not know, at every depth, are skipped."""
    message = data.draw(messages(kind))
    written = encode(message)
    made = league_protocol.message_class(kind.__name__).FromString(written)
    assert made.IsInitialized()
    assert same(message, league_protocol.values(made))
    assert decode(kind, made.SerializeToString()) == message
    made = league_protocol.filled(message)
    assert made.SerializeToString(deterministic=True) == written
    league_protocol.extend(made, data.draw(st.integers(-(2**63), 2**63 - 1)), data.draw(st.binary(max_size=20)))
    assert len(made.SerializeToString()) > len(written)
    assert decode(kind, made.SerializeToString()) == message


@kinds
@given(data=st.data())
@few
def test_packets_joined_cut_off_or_changed_are_read_alike(kind: type[Any], data: st.DataObject) -> None:
    """Of two in one, scalars and ways to move count that are the last, and submessages merge."""
    packet = bytearray(encode(data.draw(messages(kind))) + encode(data.draw(messages(kind))))
    assert agree(kind, bytes(packet))
    agree(kind, bytes(packet[: data.draw(st.integers(0, len(packet)))]))
    for place in data.draw(st.lists(st.integers(0, len(packet) - 1), max_size=4)) if packet else ():
        packet[place] = data.draw(st.integers(0, 255))
        agree(kind, bytes(packet))


def test_many_bad_packets_of_a_full_frame_are_read_alike() -> None:
    read = [agree(VisionPacket, packet) for packet in bad_packets(0, 2000)]
    assert 0.1 < sum(read) / len(read) < 0.9


CORNERS = {  # kind, bytes, whether they are a message
    "a tag of five bytes": (RobotId, "888080800001", True),
    "a tag of six bytes": (RobotId, "88808080800001", False),
    "a tag above 32 bits": (RobotId, "888080801001", False),
    "a tag of six bytes in a group": (RobotId, "bb3e" + "88808080800001" + "bc3e", False),
    "a length of five bytes": (SimulatorError, "0a818080800041", True),
    "a length of six bytes": (SimulatorError, "0a81808080800041", False),
    "a number of ten bytes, above 64 bits": (RobotId, "08ffffffffffffffffff7f", True),
    "a number above 32 bits": (RobotId, "088180808010", True),
    "a negative enumeration": (RobotId, "0801" + "10ffffffffffffffffff01", True),
    "an enumeration above 32 bits": (RobotId, "0801" + "108280808010", True),
    "a truth above 32 bits": (RobotFeedback, "0801" + "108080808010", True),
    "a group where a number is": (RobotId, "0b0c", True),
    "a hundred groups in each other": (RobotId, "bb3e" * 100 + "bc3e" * 100, True),
    "more than a hundred": (RobotId, "bb3e" * 101 + "bc3e" * 101, False),
    "two parts of a message": (SimulatorCommand, "0a051d00000040" + "0a020a00", True),
    "two parts of a message, cut within a number": (SimulatorCommand, "0a011d" + "0a0400000040", False),
    "what is required, in two parts": (
        RobotCommand,
        "0801" + "120712050d00000000" + "120c120a" + "1500000000" + "1d00000000",
        True,
    ),
    "what is required, in another part": (TeleportRobot, "1500000000" + "0a020801" + "0a021001", True),
}


@pytest.mark.parametrize(("kind", "data", "message"), CORNERS.values(), ids=list(CORNERS))
def test_corners_of_the_encoding_are_read_alike(kind: type[Any], data: str, message: bool) -> None:
    assert agree(kind, bytes.fromhex(data)) == message


def test_anything_of_a_simulator_is_its_bytes() -> None:
    """`custom` is protobuf's `Any`; ours has the bytes that it is."""
    inside = Anything(type_url="league/its.own", value=b"\x08\x01").SerializeToString()
    assert decode(RobotFeedback, encode(RobotFeedback(1, None, inside))).custom == inside
    made = league_protocol.message_class("RobotFeedback")(id=1, custom=inside)
    assert decode(RobotFeedback, made.SerializeToString()) == RobotFeedback(1, None, inside)


def test_a_replaced_way_of_moving_is_not_looked_into() -> None:
    """The one difference in what is refused."""
    packet = bytes.fromhex("0a010d" + "120f" + "0d0000803f" + "1500000040" + "1d00004040")
    assert read_by_protobuf(MoveCommand, packet) is None
    assert decode(MoveCommand, packet).local_velocity == (1.0, 2.0, 3.0)

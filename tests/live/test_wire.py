"""Messages as bytes: known ones by hand from the specification; what is skipped, merged and refused."""

import struct
from typing import Annotated, NamedTuple

import pytest

from omni_mj.live.wire import WireError, decode, encode
from omni_mj.live.wire.format import MAX_BYTES, optional, required
from omni_mj.live.wire.kinds import INT32, TEXT, UINT32
from omni_mj.live.wire.simulation import (
    GlobalVelocity,
    LocalVelocity,
    MoveCommand,
    RobotCommand,
    RobotControl,
    RobotControlResponse,
    RobotFeedback,
    RobotId,
    SimulatorCommand,
    SimulatorControl,
    SimulatorError,
    Team,
    TeleportRobot,
)
from omni_mj.live.wire.vision import DetectedRobot, Detection, FieldLine, FieldSize, Point, Shape, Source, VisionPacket


class Example(NamedTuple):
    """The messages of the specification's own examples: a number, a text, a submessage has its tag 3."""

    a: Annotated[int | None, optional(1, INT32)] = None
    b: Annotated[str | None, optional(2, TEXT)] = None


class Holder(NamedTuple):
    c: Annotated[Example | None, optional(3, Example)] = None


def f32(value: float) -> bytes:
    return struct.pack("<f", value)


# Message, its bytes as the specification has them, or put together from it by hand: (field << 3 | wire type), value.
KNOWN = [
    (Example(a=150), bytes.fromhex("089601")),
    (Example(b="testing"), bytes.fromhex("120774657374696e67")),
    (Holder(Example(a=150)), bytes.fromhex("1a03089601")),
    (Example(a=-2), bytes.fromhex("08feffffffffffffffff01")),
    (Example(a=0), bytes.fromhex("0800")),
    (Example(), b""),
    (  # zeros that are required are written, by which ER-Force's simulator knows that they are there
        RobotControl((RobotCommand(0, MoveCommand(local_velocity=LocalVelocity(0.0, -1.5, 0.0))),)),
        bytes.fromhex("0a15" + "0800" + "1211" + "120f" + "0d" + "00000000" + "15" + "0000c0bf" + "1d" + "00000000"),
    ),
    (
        RobotControl((RobotCommand(11, MoveCommand(global_velocity=GlobalVelocity(1.0, 2.0, 3.0))),)),
        bytes.fromhex("0a15" + "080b" + "1211" + "1a0f" + "0d0000803f" + "1500000040" + "1d00004040"),
    ),
    (
        SimulatorCommand(SimulatorControl(None, (TeleportRobot(RobotId(7, Team.BLUE), x=1.0, present=True),), 2.0)),
        bytes.fromhex("0a14" + "120d" + "0a0408071002" + "150000803f" + "4001" + "1d00000040"),
    ),
    (
        RobotControlResponse((SimulatorError("X"),), (RobotFeedback(1, False),)),
        bytes.fromhex("0a030a0158" + "120408011000"),
    ),
    (
        VisionPacket(
            Detection(300, 1.5, 2.0, 3, (), (), (DetectedRobot(4, 1.25, -0.5, 0.5, 1.0),)), None, Source.GRSIM
        ),
        b"\x0a\x39\x08\xac\x02"
        + (b"\x11" + struct.pack("<d", 1.5) + b"\x19" + struct.pack("<d", 2.0) + b"\x20\x03\x3a\x20")
        + (b"\x0d" + f32(1.0) + b"\x10\x04\x1d" + f32(1250.0) + b"\x25" + f32(-500.0) + b"\x2d" + f32(0.5))
        + (b"\x35" + f32(0.0) + b"\x3d" + f32(0.0) + b"\x18\x04"),
    ),
    (
        FieldSize(9.0, 6.0, 1.0, 0.18, 0.3, (FieldLine("h", Point(0, -3), Point(0, 3), 0.01, Shape.HALFWAY_LINE),)),
        bytes.fromhex("08a846" + "10f02e" + "18e807" + "20b401" + "28ac02" + "3222" + "0a0168")
        + (b"\x12\x0a\x0d" + f32(0.0) + b"\x15" + f32(-3000.0) + b"\x1a\x0a\x0d" + f32(0.0) + b"\x15" + f32(3000.0))
        + (b"\x25" + f32(10.0) + b"\x28\x06"),
    ),
]


@pytest.mark.parametrize(("message", "data"), KNOWN, ids=lambda value: type(value).__name__)
def test_known_bytes(message: tuple, data: bytes) -> None:
    """Written as the specification has it, and read back."""
    assert encode(message) == data
    assert decode(type(message), data) == message


UNKNOWN = {
    "number": bytes.fromhex("f80101"),
    "64 bits": b"\x79" + bytes(8),
    "32 bits": b"\x7d" + bytes(4),
    "bytes": bytes.fromhex("7a03010203"),
    "group in a group": bytes.fromhex("7b" + "8b01" + "0801" + "8c01" + "7c"),
    "another kind of a known field": bytes.fromhex("0d00000000"),
}


@pytest.mark.parametrize("unknown", UNKNOWN.values(), ids=list(UNKNOWN))
def test_what_is_not_known_is_skipped(unknown: bytes) -> None:
    assert decode(Example, unknown + bytes.fromhex("089601") + unknown) == Example(a=150)


def test_the_last_of_several_counts_and_messages_merge() -> None:
    """Of scalars the last; submessages as if their bytes were of one; of fields that exclude each other the last."""
    assert decode(Example, bytes.fromhex("08010802")) == Example(a=2)
    assert decode(Holder, bytes.fromhex("1a020801" + "1a03120141")) == Holder(Example(1, "A"))
    local, world = (
        MoveCommand(local_velocity=LocalVelocity(1, 2, 3)),
        MoveCommand(global_velocity=GlobalVelocity(4, 5, 6)),
    )
    assert decode(MoveCommand, encode(local) + encode(world)) == world
    assert decode(MoveCommand, encode(world) + encode(local)) == local


def test_the_same_message_has_other_bytes_too() -> None:
    """Fields in another order, a number in more bytes than it needs; and numbers that need two."""
    robot = DetectedRobot(4, 1.25, -0.5, 0.5, 1.0, 2.0, 3.0, 0.15)
    data = encode(robot)
    assert len(data) == 37
    assert decode(DetectedRobot, data[5:] + data[:5]) == decode(DetectedRobot, data)
    assert decode(DetectedRobot, data[:6] + b"\x84\x00" + data[7:]) == decode(DetectedRobot, data)
    for number in (127, 128):
        other = encode(robot._replace(robot_id=number))
        assert other == data[:6] + (b"\x7f" if number == 127 else b"\x80\x01") + data[7:]
        assert decode(DetectedRobot, other).robot_id == number


def test_an_unknown_value_of_an_enumeration_is_as_if_absent() -> None:
    assert decode(RobotId, bytes.fromhex("0801" + "1009")) == RobotId(1, None)
    assert decode(RobotId, bytes.fromhex("1002" + "1009")) == RobotId(None, Team.BLUE)


def test_a_text_that_is_not_utf_8_is_read_as_far_as_it_is() -> None:
    assert decode(Example, bytes.fromhex("120241ff")) == Example(b="A\N{REPLACEMENT CHARACTER}")


REFUSED = {
    "cut off after a tag": ("08", "cut off"),
    "cut off within a number": ("0896", "cut off"),
    "more announced than there is": ("120774", "7 bytes are announced, 1 are left"),
    "a length of 2^32 - 1": ("12ffffffff0f", "are announced"),
    "a length of 2^64 - 1": ("12ffffffffffffffffff01", "longer than 5 bytes"),
    "a number of eleven bytes": ("08" + "80" * 10 + "01", "longer than 10 bytes"),
    "field 0": ("0001", "0 is no number of a field"),
    "wire type 7": ("0f", "wire type 7"),
    "a group that nobody began": ("7c", "wire type 4"),
    "a group that nobody ends": ("7b", "cut off"),
    "groups without end": ("7b" * 200, "wire type 3"),
    "a group's end in another": ("7b8c01", "wire type 4"),
}


@pytest.mark.parametrize(("data", "reason"), REFUSED.values(), ids=list(REFUSED))
def test_malformed_bytes_are_refused_and_say_why(data: str, reason: str) -> None:
    with pytest.raises(WireError, match=reason):
        decode(Example, bytes.fromhex(data))


def test_what_is_required_must_be_there() -> None:
    whole = encode(LocalVelocity(1.0, 2.0, 3.0))
    with pytest.raises(WireError, match=r"LocalVelocity\.angular is required"):
        decode(LocalVelocity, whole[:-5])
    with pytest.raises(WireError, match=r"RobotCommand\.id cannot be None: is required"):
        encode(RobotCommand(None))  # type: ignore[arg-type]


def test_datagrams_have_a_size() -> None:
    field = b"\x7a\xf8\xff\x03" + bytes(MAX_BYTES - 11)
    with pytest.raises(WireError, match="65507 at most"):
        decode(Example, bytes(MAX_BYTES + 1))
    with pytest.raises(WireError, match="announced"):
        decode(Example, field)


class Small(NamedTuple):
    n: Annotated[int, required(1, UINT32)]


@pytest.mark.parametrize("value", [-1, 2**32, 1.5, "1", float("nan")])
def test_values_that_a_kind_cannot_carry_are_refused(value: object) -> None:
    with pytest.raises(WireError, match=r"Small\.n cannot be"):
        encode(Small(value))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "message",
    [
        LocalVelocity(1e39, 0.0, 0.0),  # more than a float holds
        FieldSize(float("nan"), 6.0, 1.0, 0.18, 0.3),
        FieldSize(float("inf"), 6.0, 1.0, 0.18, 0.3),
        VisionPacket(Point(0.0, 0.0)),  # type: ignore[arg-type]
        RobotControl((None,)),  # type: ignore[arg-type]
        RobotControl(None),  # type: ignore[arg-type]
        RobotId(1, 9),  # type: ignore[arg-type]
        SimulatorError(3),  # type: ignore[arg-type]
    ],
    ids=str,
)
def test_messages_that_cannot_be_sent_are_refused(message: tuple) -> None:
    with pytest.raises(WireError, match="cannot be"):
        encode(message)

"""Any message of the league's protocols, for hypothesis; packets that are none any more."""

import random
from collections.abc import Iterator
from enum import IntEnum
from functools import cache
from typing import Any

from hypothesis import strategies as st

from omni_mj.live.wire import encode, kinds
from omni_mj.live.wire.format import Field, fields
from omni_mj.live.wire.simulation import (
    RobotControl,
    RobotControlResponse,
    SimulatorCommand,
    SimulatorResponse,
    SyncRequest,
)
from omni_mj.live.wire.vision import DetectedBall, DetectedRobot, Detection, VisionPacket

PACKETS = (VisionPacket, SimulatorCommand, SimulatorResponse, RobotControl, RobotControlResponse, SyncRequest)

_floats = st.floats(width=32, allow_nan=False)
_SCALARS = {
    id(kinds.UINT32): st.integers(0, 2**32 - 1),
    id(kinds.INT32): st.integers(-(2**31), 2**31 - 1),
    id(kinds.INT64): st.integers(-(2**63), 2**63 - 1),
    id(kinds.FLOAT): _floats,
    id(kinds.DOUBLE): st.floats(allow_nan=False),
    id(kinds.MILLIMETRES): _floats.map(lambda mm: mm / kinds.MM_PER_M),
    id(kinds.WHOLE_MILLIMETRES): st.integers(-(2**31), 2**31 - 1).map(lambda mm: mm / kinds.MM_PER_M),
    id(kinds.BOOL): st.booleans(),
    id(kinds.TEXT): st.text(max_size=20),
    id(kinds.BYTES): st.binary(max_size=20),
}


@cache
def messages(kind: type[Any]) -> st.SearchStrategy[Any]:
    """Any message of a kind, with numbers that the wire carries exactly."""
    drawn, exclusive = {}, []
    for name, field in fields(kind).items():
        value = _value(field)
        if field.label == "repeated":
            drawn[name] = st.lists(value, max_size=3).map(tuple)
        elif field.label == "required":
            drawn[name] = value
        else:
            drawn[name] = st.none() | value
            exclusive += [name] if field.label == "one of" else []
    whole = st.builds(kind, **drawn)
    if not exclusive:
        return whole
    return st.tuples(whole, st.sampled_from(exclusive)).map(
        lambda pair: pair[0]._replace(**dict.fromkeys(set(exclusive) - {pair[1]}))
    )


def _value(field: Field) -> st.SearchStrategy[Any]:
    if isinstance(field.kind, kinds.Kind):
        return _SCALARS[id(field.kind)]
    return st.sampled_from(field.kind) if issubclass(field.kind, IntEnum) else messages(field.kind)


def full_frame(robots: int = 11) -> VisionPacket:
    """What a camera sends that sees two whole teams."""
    each = tuple(DetectedRobot(i, 0.4 * i, -0.3 * i, 0.1 * i, 0.9, 10.0 * i, 20.0 * i, 0.14) for i in range(robots))
    return VisionPacket(Detection(7, 1.5, 1.6, 2, (DetectedBall(0.1, -0.2),), each, each))


def bad_packets(seed: int, count: int) -> Iterator[bytes]:
    """Random bytes, and packets that were cut off, of which bits were turned, or parts put in the wrong place."""
    rng = random.Random(seed)
    whole = encode(full_frame())
    for _ in range(count):
        data = bytearray(whole[: rng.randrange(len(whole) + 1)] if rng.random() < 0.5 else whole)
        which = rng.random()
        if which < 0.3:
            data = bytearray(rng.randbytes(rng.randrange(200)))
        elif which < 0.6 and data:
            for _ in range(rng.randrange(1, 9)):
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        elif which < 0.8:
            start, size = rng.randrange(len(data) + 1), rng.randrange(50)
            data[start:start] = data[start : start + size]
        yield bytes(data)

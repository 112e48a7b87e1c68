"""Any message comes back as it was sent; any bytes are a message or one kind of error, never anything else."""

from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from wire_messages import PACKETS, bad_packets, messages

from omni_mj.live.wire import WireError, decode, encode
from omni_mj.live.wire.vision import VisionPacket

kinds = pytest.mark.parametrize("kind", PACKETS, ids=lambda kind: kind.__name__)


def message_or_error(kind: type[Any], data: bytes) -> Any:
    """What bytes are; None if they are refused."""
    try:
        return decode(kind, data)
    except WireError:
        return None


@kinds
@given(data=st.data())
@settings(max_examples=25, deadline=None)
def test_what_is_sent_comes_back(kind: type[Any], data: st.DataObject) -> None:
    message = data.draw(messages(kind))
    assert decode(kind, encode(message)) == message


@kinds
@given(data=st.data())
@settings(max_examples=25, deadline=None)
def test_packets_cut_off_anywhere_or_changed_are_messages_or_refused(kind: type[Any], data: st.DataObject) -> None:
    """And what is read of them says the same again, once it is written: the codec reads what it writes."""
    packet = encode(data.draw(messages(kind)))
    cut = packet[: data.draw(st.integers(0, len(packet)))]
    changed = bytearray(cut)
    for place in data.draw(st.lists(st.integers(0, max(len(cut) - 1, 0)), max_size=8)) if cut else ():
        changed[place] = data.draw(st.integers(0, 255))
    for each in (cut, bytes(changed)):
        message = message_or_error(kind, each)
        if message is not None:
            again = encode(message)
            assert encode(decode(kind, again)) == again


@kinds
@given(data=st.binary(max_size=300))
@example(data=b"\x0a" * 300)
@example(data=b"\xff" * 300)
@settings(max_examples=100, deadline=None)
def test_random_bytes_are_messages_or_refused(kind: type[Any], data: bytes) -> None:
    message_or_error(kind, data)


def test_many_bad_packets_of_a_full_frame() -> None:
    """Some are refused, and some are messages, as bits may turn in numbers; `tests/bench_wire.py` takes 100 000."""
    read = [message_or_error(VisionPacket, packet) for packet in bad_packets(0, 3000)]
    assert 0.1 < sum(message is None for message in read) / len(read) < 0.9


@given(st.lists(st.sampled_from([b"\x7b", b"\x7c", b"\x0a\x00", b"\x12\x7f", b"\x80"]), max_size=400).map(b"".join))
@settings(max_examples=100, deadline=None)
def test_groups_and_lengths_nest_without_end(data: bytes) -> None:
    for kind in PACKETS:
        message_or_error(kind, data)

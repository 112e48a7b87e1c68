"""The synchronous mode: requests over TCP, each answered after its step with what cameras saw meanwhile."""

import socket
import struct
from collections.abc import Sequence

import pytest
import serving
from foreign import field, fields
from served import FAST, QUIET, here, pitch_of
from serving import LOOPBACK


class Stream:
    """A client that knows lengths and fields, and nothing of ours."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection((LOOPBACK, port), serving.PATIENCE_S)

    def ask(self, request: bytes, pieces: int = 1) -> dict:
        """Send a request in so many pieces; the answer's fields."""
        data = length(request) + request
        size = max(len(data) // pieces, 1)
        for at in range(0, len(data), size):
            self._socket.sendall(data[at : at + size])
        size, shift = 0, 0
        while True:
            byte = self._read(1)[0]
            size |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return fields(self._read(size))

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def hung_up(self) -> bool:
        return self._socket.recv(1) == b""

    def close(self) -> None:
        self._socket.close()

    def _read(self, count: int) -> bytes:
        found = b""
        while len(found) < count:
            came = self._socket.recv(count - len(found))
            assert came
            found += came
        return found


def length(message: bytes) -> bytes:
    """Of up to 2^14 - 1 bytes, as a varint."""
    size = len(message)
    return bytes([size]) if size < 128 else bytes([size & 0x7F | 0x80, size >> 7])


def request(step: float | None = None, robots: bytes = b"", simulator: bytes = b"") -> bytes:
    """A step in s, commands to robots and to the simulator."""
    parts = (b"" if step is None else field(1, step)), field(2, simulator), field(3, robots)
    return b"".join(part for part, there in zip(parts, (True, simulator, robots), strict=True) if there)


def codes(answer: dict) -> list[str]:
    """Of the errors."""
    return serving.codes(answer[2][0])


def test_steps_by_tcp_are_those_by_packets_to_the_bit() -> None:
    """An answer has the very images that went out; a packet a frame makes the same run."""
    sets = *QUIET[1:], FAST, "vision.delay_s=0"
    tapes: list[Sequence[bytes]] = []
    with here(pitch_of(*sets)) as (client, _):
        tapes.append([client.step(serving.local(0, 1.0, 0.2, 0.3)) for _ in range(12)])
    with here(pitch_of(*sets)) as (client, server):
        stream = Stream(server.ports[1])
        images = [stream.ask(request(1 / 60, serving.local(0, 1.0, 0.2, 0.3)))[1] for _ in range(12)]
        stream.close()
        assert client.newest() == images[-1][0]
    assert all(len(each) == 1 for each in images)
    assert [bytes(each[0]) for each in images] == tapes[0]


def test_a_step_is_as_long_as_it_says_and_has_all_images_that_went_out_in_it() -> None:
    """Steps that are no whole cycles add up: 30 of 0.01 s are 0.3 s, 18 images; steps of 0.1 s have six each."""
    with here(pitch_of(*QUIET, FAST, blue="2", yellow="1")) as (_, server):
        blue, control = Stream(server.ports[1]), Stream(server.ports[0])
        times = []
        for _ in range(30):
            times += [serving.captured(raw) for raw in blue.ask(request(0.01)).get(1, ())]
        assert server.pitch.time_s == pytest.approx(0.3)
        assert times == pytest.approx([k / 60 for k in range(1, 19)])
        put = serving.teleport(1, 2, x=2.0, y=1.0, orientation=0.5)
        answer = control.ask(request(0.1, simulator=put), pieces=7)
        assert len(answer[1]) == 6
        assert serving.robots(answer[1][-1])["blue", 1] == pytest.approx((2.0, 1.0, 0.5), abs=2e-3)
        assert codes(control.ask(request(robots=serving.local(0, 1.0)))) == ["NO_TEAM"]
        assert codes(control.ask(request(-1.0))) == ["STEP"]
        assert codes(control.ask(request(float("nan")))) == ["STEP"]
        assert codes(blue.ask(request(0.0, serving.kick(0), serving.speed(2.0)))) == ["NO_KICK", "LOCKSTEP"]
        for each in (blue, control):
            each.close()


@pytest.mark.parametrize("bad", [b"\xff\xff\xff\xff\xff\xff", b"\xff\xff\x7f", b"\x02\x0d\x00"])
def test_who_cannot_be_understood_is_hung_up_on_and_the_others_are_not(bad: bytes) -> None:
    """A length without end, one that no message has, and a message that is cut off."""
    with here(pitch_of(FAST)) as (client, server):
        streams = [Stream(server.ports[1]) for _ in range(3)]
        streams[0].send(bad)
        assert streams[0].hung_up()
        streams[1].close()
        assert len(streams[2].ask(request(1 / 60))[1]) == 1
        assert serving.robots(client.step(serving.local(0, 0.0)))
        assert server.notes.counts["bad packets"] == 1
        for each in streams:
            each.close()


def test_in_real_time_nobody_is_let_in() -> None:
    with here(pitch_of(FAST), "") as (_, server), pytest.raises(ConnectionRefusedError):
        socket.create_connection((LOOPBACK, server.ports[0]), 1)


def test_a_nan_is_a_number_on_the_wire() -> None:
    """Or what is refused above as a step would be a message that is cut off."""
    assert field(1, float("nan"))[1:] == struct.pack("<f", float("nan"))

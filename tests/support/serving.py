"""The league's protocols by hand, as somebody else would write them: packets, a client, `omni-mj serve` as a process.

Shares no code with the program, and is an oracle for it: field numbers are those of the protocols' documentation.
"""

import os
import re
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

LOOPBACK = "127.0.0.1"
PATIENCE_S = 20.0  # of a test, on a busy machine
YELLOW, BLUE = 1, 2  # numbers of the teams; ports of their robots follow that of the simulator, blue first
Pose = tuple[float, float, float]


class Double(float):
    """A number that is 64 bits wide on the wire."""


def field(number: int, value: Any) -> bytes:
    """Encode a field: an int as varint, a float as 32 bits, bytes after their length."""
    if isinstance(value, Double):
        return _varint(number << 3 | 1) + struct.pack("<d", value)
    if isinstance(value, float):
        return _varint(number << 3 | 5) + struct.pack("<f", value)
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    return _varint(number << 3 | 2) + _varint(len(value)) + value


def message(*values: Any) -> bytes:
    """Encode a message whose fields are numbered from 1; None leaves one out."""
    return b"".join(field(number, value) for number, value in enumerate(values, 1) if value is not None)


def fields(data: bytes) -> dict[int, list[Any]]:
    """Decode a message: field number -> values; varints as numbers, all else as bytes."""
    result: dict[int, list[Any]] = {}
    at = 0
    while at < len(data):
        tag, at = _read_varint(data, at)
        if tag & 7 == 0:
            value, at = _read_varint(data, at)
        else:
            size, at = (8, at) if tag & 7 == 1 else (4, at) if tag & 7 == 5 else _read_varint(data, at)
            value, at = data[at : at + size], at + size
        result.setdefault(tag >> 3, []).append(value)
    return result


def float32(data: bytes) -> float:
    return float(struct.unpack("<f", data)[0])


def prefixed(data: bytes) -> bytes:
    """A message after its length, as on a stream."""
    return _varint(len(data)) + data


def _varint(value: int) -> bytes:
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            return value, at


def local(number: int, forward: float, left: float = 0.0, angular: float = 0.0) -> bytes:
    """A packet to one robot: velocities in its frame. Packets to several are joined."""
    return _command(number, field(2, message(float(forward), float(left), float(angular))))


def world(number: int, x: float, y: float = 0.0, angular: float = 0.0) -> bytes:
    """A packet to one robot: velocities in the field's frame."""
    return _command(number, field(3, message(float(x), float(y), float(angular))))


def wheels(number: int, *rims: float) -> bytes:
    """A packet to one robot: rim speeds front right, back right, back left, front left."""
    return _command(number, field(1, message(*rims)))


def kick(number: int) -> bytes:
    """A packet to one robot that shall kick."""
    return field(1, message(number, None, 5.0))


def _command(number: int, move: bytes) -> bytes:
    return field(1, message(number, move))


def teleport(number: int, team: int, present: bool | None = True, **values: float) -> bytes:
    """A packet to the simulator: x, y, orientation, v_x, v_y, v_angular."""
    names = ("x", "y", "orientation", "v_x", "v_y", "v_angular")
    numbers = [None if name not in values else float(values[name]) for name in names]
    return field(1, field(2, message(message(number, team), *numbers, None if present is None else int(present))))


def speed(times: float) -> bytes:
    """A packet to the simulator: simulated seconds per second."""
    return field(1, field(3, times))


def vision(
    frame: int,
    robots: Sequence[tuple[int, float, float, float]],
    *,
    camera: int = 0,
    captured: float,
    sent: float,
    yellow: Sequence[tuple[int, float, float, float]] = (),
) -> bytes:
    """A packet of SSL-Vision: numbers and poses in m and rad of the blue robots."""
    detection = message(frame, Double(captured), Double(sent), camera)
    for number, team in ((6, yellow), (7, robots)):
        for name, x, y, heading in team:
            seen = message(1.0, int(name), 1000.0 * x, 1000.0 * y, float(heading), 0.0, 0.0)
            detection += field(number, seen)
    return field(1, detection)


def robots(detection: bytes) -> dict[tuple[str, int], Pose]:
    """Poses in m and rad that a detection has."""
    found = {}
    for team, number in (("yellow", 6), ("blue", 7)):
        for raw in fields(detection).get(number, ()):
            robot = fields(raw)
            x, y, heading = (float32(robot[n][0]) for n in (3, 4, 5))
            found[team, robot[2][0]] = (x / 1000, y / 1000, heading)
    return found


def captured(detection: bytes) -> float:
    """When it was taken, s."""
    return float(struct.unpack("<d", fields(detection)[2][0])[0])


def codes(answer: bytes) -> list[str]:
    """Codes of the errors in an answer."""
    return [fields(raw)[1][0].decode() for raw in fields(answer).get(1, ())]


class Client:
    """A team's software."""

    def __init__(self) -> None:
        self.vision, self.commands = udp(), udp()
        self.ports: Sequence[int] = (0, 0, 0)

    @property
    def vision_port(self) -> int:
        return int(self.vision.getsockname()[1])

    def ask(self, port: int, packet: bytes) -> bytes:
        """Send to the simulator (0), blue (1) or yellow (2), and return the answer."""
        self.commands.sendto(packet, (LOOPBACK, self.ports[port]))
        return self.commands.recv(65536)

    def codes(self, port: int, packet: bytes) -> list[str]:
        """Send, and return the codes of the errors in the answer."""
        return codes(self.ask(port, packet))

    def after(self, packet: bytes, team: int = 1) -> dict[tuple[str, int], Pose]:
        """In lockstep: command, and return the poses that the camera sees after."""
        return robots(self.step(packet, team))

    def detection(self) -> bytes:
        """The next detection."""
        while True:
            packet = fields(self.vision.recv(65536))
            if 1 in packet:
                return bytes(packet[1][0])

    def step(self, packet: bytes, team: int = 1) -> bytes:
        """In lockstep: command, and return what the camera sees after."""
        self.ask(team, packet)
        return self.newest()

    def newest(self) -> bytes:
        """The last detection that has come."""
        found = self.detection()
        self.vision.setblocking(False)
        try:
            while True:
                packet = fields(self.vision.recv(65536))
                found = bytes(packet[1][0]) if 1 in packet else found
        except BlockingIOError:
            return found
        finally:
            self.vision.settimeout(PATIENCE_S)

    def close(self) -> None:
        self.vision.close()
        self.commands.close()


def udp() -> socket.socket:
    """A socket of this computer."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 21)
    made.bind((LOOPBACK, 0))
    made.settimeout(PATIENCE_S)
    return made


def free_port() -> int:
    with udp() as made:
        return int(made.getsockname()[1])


@contextmanager
def served(*options: str, client: Client, ports: Sequence[int] = (0, 0, 0)) -> Iterator[subprocess.Popen]:
    """`omni-mj serve` as a process that sends its vision to a client; standard output is read up to the ports."""
    names = ("--control-port", "--blue-port", "--yellow-port")
    where = [word for name, port in zip(names, ports, strict=True) for word in (name, str(port))]
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "omni_mj.cli.main", "serve", *where]
    command += ["--vision", f"{LOOPBACK}:{client.vision_port}", *options]
    environment = os.environ | {"PYTHONPATH": f"{root}:{root / 'control'}", "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if found := re.search(r"simulator (\d+), blue (\d+), yellow (\d+)", line):
                client.ports = tuple(map(int, found.groups()))
                break
        else:
            raise AssertionError(process.communicate()[1])
        yield process
    finally:
        process.kill()
        process.communicate()


def ended(process: subprocess.Popen, by: int = signal.SIGTERM) -> tuple[str, str]:
    """What a process says that is asked to end."""
    process.send_signal(by)
    return process.communicate(timeout=PATIENCE_S)

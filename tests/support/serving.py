"""`omni-mj serve` as a process of its own, and a client that knows the league's packets and nothing of ours."""

import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from foreign import field as field
from foreign import fields as fields
from foreign import first

LOOPBACK = "127.0.0.1"
PATIENCE_S = 20.0  # of a test, on a busy machine


class Client:
    """Sockets of a team's software, and packets put together by hand."""

    def __init__(self) -> None:
        self.vision = udp()
        self.commands = udp()
        self.ports = (0, 0, 0)

    @property
    def vision_port(self) -> int:
        return int(self.vision.getsockname()[1])

    def ask(self, port: int, packet: bytes) -> bytes:
        """Send to the simulator (0), blue (1) or yellow (2), and return what it answers."""
        self.commands.sendto(packet, (LOOPBACK, self.ports[port]))
        return self.commands.recv(65536)

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
        """The last detection that is there."""
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


@contextmanager
def served(*options: str, client: Client | None = None, ports: Sequence[int] = (0, 0, 0)) -> Iterator[tuple]:
    """A process, and a client that it sends its vision to.

    Yields:
        The client and the process, whose standard output is read up to the ports.
    """
    own = client or Client()
    names = ("--control-port", "--blue-port", "--yellow-port")
    where = [word for name, port in zip(names, ports, strict=True) for word in (name, str(port))]
    vision = ["--vision", f"{LOOPBACK}:{own.vision_port}"]
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "omni_mj.cli.main", "serve", *where, *vision, *options]
    environment = os.environ | {"PYTHONPATH": f"{root}:{root / 'control'}", "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if found := re.search(r"simulator (\d+), blue (\d+), yellow (\d+)", line):
                own.ports = tuple(map(int, found.groups()))
                break
        else:
            raise AssertionError(process.communicate()[1])
        yield own, process
    finally:
        process.kill()
        process.communicate()
        if client is None:
            own.close()


def ended(process: subprocess.Popen) -> tuple[str, str]:
    """What a process says that is asked to end."""
    process.send_signal(signal.SIGTERM)
    return process.communicate(timeout=PATIENCE_S)


def local(number: int, forward: float, left: float = 0.0, angular: float = 0.0) -> bytes:
    """A packet to one robot: velocities of its own."""
    return _command(number, field(2, b"".join(field(i, v) for i, v in enumerate((forward, left, angular), 1))))


def world(number: int, x: float, y: float = 0.0, angular: float = 0.0) -> bytes:
    """A packet to one robot: velocities of the field."""
    return _command(number, field(3, b"".join(field(i, v) for i, v in enumerate((x, y, angular), 1))))


def wheels(number: int, *rims: float) -> bytes:
    """A packet to one robot: speeds of the wheels front right, back right, back left, front left."""
    return _command(number, field(1, b"".join(field(i, v) for i, v in enumerate(rims, 1))))


def _command(number: int, move: bytes, more: bytes = b"") -> bytes:
    return field(1, field(1, number) + field(2, move) + more)


def kick(number: int) -> bytes:
    """A packet to one robot that shall kick."""
    return field(1, field(1, number) + field(3, 5.0))


def teleport(number: int, team: int, present: bool | None = True, **place: float) -> bytes:
    """A packet to the simulator: team 1 yellow, 2 blue; x, y, orientation, v_x, v_y, v_angular."""
    names = ("x", "y", "orientation", "v_x", "v_y", "v_angular")
    body = field(1, field(1, number) + field(2, team))
    body += b"".join(field(names.index(name) + 2, float(value)) for name, value in place.items())
    return field(1, field(2, body + (b"" if present is None else field(8, int(present)))))


def speed(times: float) -> bytes:
    """A packet to the simulator: times as fast as real time."""
    return field(1, field(3, times))


def robots(detection: bytes) -> dict[tuple[str, int], tuple[float, float, float]]:
    """Poses in m and rad that a detection has."""
    found = {}
    for team, number in (("yellow", 6), ("blue", 7)):
        for raw in fields(detection).get(number, ()):
            robot = fields(raw)
            x, y, heading = (struct.unpack("<f", first(robot, n))[0] for n in (3, 4, 5))
            found[team, first(robot, 2)] = (x / 1000, y / 1000, heading)
    return found


def captured(detection: bytes) -> float:
    """When it was taken, s."""
    return float(struct.unpack("<d", first(fields(detection), 2))[0])


def codes(answer: bytes) -> list[str]:
    """Codes of the errors in an answer."""
    return [first(fields(raw), 1).decode() for raw in fields(answer).get(1, ())]


def wait_for(condition: object, client: Client) -> dict:
    """Read detections until robots are as wanted."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        seen = robots(client.detection())
        if condition(seen):  # type: ignore[operator]
            return seen
    raise AssertionError(f"never so: {seen}")

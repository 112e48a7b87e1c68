"""A simulator for tests, which does nothing but what its options say: robots that integrate commands exactly.

    python tests/support/peer.py --vision 127.0.0.1:10020 --port 10301 [...]

Robots of the blue team do as they are told, `--delay` frames after the frame in which they are. It stamps simulated
time, in 60ths of a second, and publishes as many frames a second of real time; or, with `--lockstep`, the next as soon
as commands have come.
"""

import argparse
import random
import select
import socket
import time
from itertools import count
from typing import Any

import numpy as np
from serving import vision

from omni_mj.live.wire.league_pb2 import RobotControl

PERIOD_S = 1 / 60
SUBSTEPS = 16
PATIENCE_S = 0.05  # for the first commands, in lockstep


DEFAULTS: dict[str, Any] = {
    "vision": "127.0.0.1:10020",
    "port": 10301,
    "delay": 0.0,  # frames
    "age": 0.0,  # between capture and sending, s, as stamped
    "noise": 0.0,  # m, and ten times as many rad
    "cameras": 1,
    "bias": 0.0,  # of the second camera, m in x and y
    "loss": 0.0,  # of packets, both ways
    "mirror": 0.0,  # how often a heading is seen the wrong way round
    "swap": 0.0,  # how often a robot has another's number
    "patience": 10.0,  # for the next commands, in lockstep, s
    "junk": 0.0,  # bad packets per frame
}


def options() -> argparse.Namespace:
    parse = argparse.ArgumentParser()
    for name, default in DEFAULTS.items():
        parse.add_argument(f"--{name}", type=type(default), default=default)
    parse.add_argument("--start", type=float, nargs="+", default=[0.0, 0.0, 0.0], help="x y heading of each robot")
    parse.add_argument("--lockstep", action="store_true")
    return parse.parse_args()


class Robots:
    """Commands are held from when they act until others do; a velocity in a robot's own frame turns with it."""

    def __init__(self, start: np.ndarray, delay: float) -> None:
        self.pose = start.copy()
        self._delay = round(delay * SUBSTEPS)
        n = len(start)
        self._queue = [(-self._delay, np.zeros((n, 3)), np.ones(n, bool))]
        self._step = 0
        self._past: list[np.ndarray] = [self.pose.copy()]

    def at(self, age: float) -> np.ndarray:
        """Poses so many s ago."""
        return self._past[-1 - min(round(age * SUBSTEPS / PERIOD_S), len(self._past) - 1)]

    def command(self, packet: bytes) -> None:
        _, twist, local = self._queue[-1]
        twist, local = twist.copy(), local.copy()
        for command in RobotControl.FromString(packet).robot_commands:
            form = command.move_command.WhichOneof("command")
            if command.id < len(twist):
                velocity = getattr(command.move_command, form)
                twist[command.id] = [value for _, value in velocity.ListFields()]
                local[command.id] = form == "local_velocity"
        self._queue.append((self._step, twist, local))

    def advance(self) -> None:
        for _ in range(SUBSTEPS):
            while len(self._queue) > 1 and self._queue[1][0] + self._delay <= self._step:
                del self._queue[0]
            _, twist, local = self._queue[0]
            turn = twist[:, 2] * PERIOD_S / SUBSTEPS
            heading = np.where(local, self.pose[:, 2] + turn / 2, 0.0)
            c, s = np.cos(heading), np.sin(heading)
            step = twist[:, :2] * PERIOD_S / SUBSTEPS
            self.pose[:, 0] += c * step[:, 0] - s * step[:, 1]
            self.pose[:, 1] += s * step[:, 0] + c * step[:, 1]
            self.pose[:, 2] += turn
            self._step += 1
            self._past = [*self._past[-4 * SUBSTEPS :], self.pose.copy()]


class Peer:
    """Sockets, cameras and clock."""

    def __init__(self, said: argparse.Namespace) -> None:
        self.said, self.random, self.normal = said, random.Random(0), np.random.default_rng(0)
        self.robots = Robots(np.array(said.start, float).reshape(-1, 3), said.delay)
        host, _, port = said.vision.partition(":")
        self.vision = (host, int(port))
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.commands = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.commands.bind(("127.0.0.1", said.port))
        self.commands.setblocking(False)
        self.told = False

    def run(self) -> None:
        due = time.monotonic()
        for frame in count():
            self.publish(frame)
            due += PERIOD_S
            until = time.monotonic() + (self.said.patience if self.told else PATIENCE_S) if self.said.lockstep else due
            self.obey(until)
            self.robots.advance()

    def publish(self, frame: int) -> None:
        """What each camera sees now; what it stamps is when it sends, and the age before that."""
        said, pose = self.said, self.robots.at(self.said.age)
        now = frame * PERIOD_S
        for camera in range(said.cameras):
            middle = (camera - (said.cameras - 1) / 2) * 2.0
            robots = []
            for number, (x, y, heading) in enumerate(pose):
                if abs(x - middle) > 1.25 and said.cameras > 1:
                    continue
                shift = said.bias if camera == 1 else 0.0
                dx, dy, dh = self.normal.normal(size=3) * said.noise
                turned = np.pi if self.random.random() < said.mirror else 0.0
                name = (number + 1) % len(pose) if self.random.random() < said.swap else number
                seen = (heading + 10 * dh + turned + np.pi) % (2 * np.pi) - np.pi
                robots.append((name, x + shift + dx, y + shift + dy, seen))
            self.send(vision(frame, robots, camera=camera, captured=now - said.age, sent=now))
        if self.random.random() < said.junk:
            self.send(self.random.randbytes(self.random.randrange(60)))

    def send(self, packet: bytes) -> None:
        if self.random.random() >= self.said.loss:
            self.out.sendto(packet, self.vision)

    def obey(self, until: float) -> None:
        """Take in commands until the next frame is due, or, in lockstep, until there were some."""
        while True:
            try:
                data, client = self.commands.recvfrom(65536)
            except BlockingIOError:
                if (left := until - time.monotonic()) <= 0:
                    return
                select.select([self.commands], [], [], left)
                continue
            if self.random.random() < self.said.loss:
                continue
            self.robots.command(data)
            self.told = True
            self.commands.sendto(b"", client)
            if self.said.lockstep:
                return


if __name__ == "__main__":
    Peer(options()).run()

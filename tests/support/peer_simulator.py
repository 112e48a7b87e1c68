"""A simulator for tests whose robots integrate commands exactly, with errors by its options.

    python tests/support/peer_simulator.py --vision 127.0.0.1:10020 --port 10301 [...]

Robots of the blue team execute a command `--delay` frames after the frame in which it arrives. Time
stamps are simulated time. Frames come 60 times per second of real time; with `--lockstep`, a frame
follows each command.
"""

import argparse
import socket
import time
from collections import deque
from itertools import count
from typing import Any

import numpy as np
from serve_client import vision

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
    "tell": 0,  # after how many packets of commands a line is printed
}


def options() -> argparse.Namespace:
    parse_message = argparse.ArgumentParser()
    for name, default in DEFAULTS.items():
        parse_message.add_argument(f"--{name}", type=type(default), default=default)
    parse_message.add_argument(
        "--start", type=float, nargs="+", default=[0.0, 0.0, 0.0], help="x y heading of each robot"
    )
    parse_message.add_argument("--lockstep", action="store_true")
    return parse_message.parse_args()


class Robots:
    """A command acts until the next one. A velocity in the body frame turns with the robot."""

    def __init__(self, start: np.ndarray, delay: float) -> None:
        self._delay, self._step, n = round(delay * SUBSTEPS), 0, len(start)
        self._queue = [(-self._delay, np.zeros((n, 3)), np.ones(n, bool))]
        self._past = deque([start], maxlen=4 * SUBSTEPS)

    def at(self, age: float) -> np.ndarray:
        """Poses so many s ago."""
        return self._past[-1 - min(round(age * SUBSTEPS / PERIOD_S), len(self._past) - 1)]

    def command(self, packet: bytes) -> None:
        twist, local = (values.copy() for values in self._queue[-1][1:])
        for command in RobotControl.FromString(packet).robot_commands:
            form = command.move_command.WhichOneof("command")
            twist[command.id] = [
                value for _, value in getattr(command.move_command, form).ListFields()
            ]
            local[command.id] = form == "local_velocity"
        self._queue.append((self._step, twist, local))

    def advance(self) -> None:
        for _ in range(SUBSTEPS):
            while len(self._queue) > 1 and self._queue[1][0] + self._delay <= self._step:
                del self._queue[0]
            _, twist, local = self._queue[0]
            pose, step = self._past[-1], twist * PERIOD_S / SUBSTEPS
            heading = np.where(local, pose[:, 2] + step[:, 2] / 2, 0.0)
            move = (step[:, 0] + 1j * step[:, 1]) * np.exp(1j * heading)
            self._past.append(pose + np.column_stack([move.real, move.imag, step[:, 2]]))
            self._step += 1


class Peer:
    """Sockets, cameras and clock."""

    def __init__(self, said: argparse.Namespace) -> None:
        self.said, self.random = said, np.random.default_rng(0)
        self.robots = Robots(np.array(said.start, float).reshape(-1, 3), said.delay)
        host, _, port = said.vision.partition(":")
        self.vision = (host, int(port))
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", said.port))
        self.patience, self.n_heard = PATIENCE_S, 0

    def run(self) -> None:
        due = time.monotonic()
        for frame in count():
            self.publish(frame)
            due += PERIOD_S
            self.obey(time.monotonic() + self.patience if self.said.lockstep else due)
            self.robots.advance()

    def publish(self, frame: int) -> None:
        """What each camera sees now; what it stamps is when it sends, and the age before that."""
        said, pose, now = self.said, self.robots.at(self.said.age), frame * PERIOD_S
        n = len(pose)
        for camera in range(said.cameras):
            middle = (camera - (said.cameras - 1) / 2) * 2.0
            visible = (np.abs(pose[:, 0] - middle) < 1.25) | (said.cameras == 1)
            seen = pose + said.noise * self.random.normal(size=(n, 3)) * [1, 1, 10]
            seen[:, :2] += said.bias * (camera == 1)
            seen[:, 2] += np.pi * (self.random.random(n) < said.mirror)
            names = (np.arange(n) + (self.random.random(n) < said.swap)) % n
            robots = [
                (name, *place) for name, place in zip(names[visible], seen[visible], strict=True)
            ]
            self.send(vision(frame, robots, camera=camera, captured=now - said.age, sent=now))
        if self.random.random() < said.junk:
            self.send(self.random.bytes(self.random.integers(60)))

    def send(self, packet: bytes) -> None:
        if self.random.random() >= self.said.loss:
            self.socket.sendto(packet, self.vision)

    def obey(self, until: float) -> None:
        """Take in commands until the next frame is due, or, in lockstep, until there were some."""
        while (left := until - time.monotonic()) > 0:
            self.socket.settimeout(left)
            try:
                data, client = self.socket.recvfrom(65536)
            except TimeoutError:
                return
            if self.random.random() >= self.said.loss:
                self.robots.command(data)
                self.n_heard += 1
                if self.n_heard == self.said.tell:
                    print("heard", flush=True)
                self.patience = self.said.patience
                self.socket.sendto(b"", client)
                if self.said.lockstep:
                    return


if __name__ == "__main__":
    Peer(options()).run()

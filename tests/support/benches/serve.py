"""Bench of `omni-mj serve` without a process: the world alone, or its server in a thread."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from serve_client import BLUE, LOOPBACK, Client, teleport

from omni_mj.live.serve import initial_setup
from omni_mj.live.serve.recorder import Recorder, TrajectoryWriter
from omni_mj.live.serve.served_world import ServedWorld
from omni_mj.live.serve.server import Server
from omni_mj.live.serve.simulation_requests import robot_label
from omni_mj.live.sockets import Address, MessageCounter
from omni_mj.live.wire import parse_message
from omni_mj.live.wire.league_pb2 import RobotControl, SimulatorCommand

QUIET = (
    "vision.position_noise_m=0",
    "vision.heading_noise_rad=0",
    "vision.miss_probability=0",
    "sensors.gyro_noise_rad_s=0",
    "sensors.gyro_bias_rad_s=0",
)
FAST = "wheels.model=two-rollers"
CYCLES = 16  # of the wheel loops in a frame


class Ended(Exception):  # noqa: N818
    """Ends a server."""


class Field:
    """What `serve` makes of its options; robots are named by team and number."""

    def __init__(
        self,
        *sets: str,
        blue: str = "1",
        yellow: str = "0",
        scenario: str | None = None,
        **head: Any,
    ) -> None:
        chosen = initial_setup.load_served_scenario(scenario, sets, head)
        poses = initial_setup.starting_poses(
            initial_setup.parse_robot_ids(blue, "--blue"),
            initial_setup.parse_robot_ids(yellow, "--yellow"),
            chosen,
        )
        self.said: list[str] = []
        self.pitch = ServedWorld(chosen, poses, MessageCounter(self.said.append))
        self.recorder: Recorder | None = None

    @property
    def names(self) -> list[str]:
        return [robot_label(name) for name in self.pitch.poses()]

    @property
    def poses(self) -> np.ndarray:
        """Of the robots on the field, in the order of `names`."""
        return np.array([*self.pitch.poses().values()])

    @property
    def twists(self) -> np.ndarray:
        return self.pitch.plant.twist()[self.pitch.plant.present]

    @property
    def upright(self) -> bool:
        return bool((self.pitch.plant.present == ~self.pitch.plant._failed).all())

    @property
    def time_s(self) -> float:
        return self.pitch.time_s

    def command(self, packet: bytes, team: int = BLUE) -> list[str]:
        """Send a packet to robots; codes of what is refused."""
        errors, _ = self.pitch.command(team, parse_message(RobotControl, packet).robot_commands)
        return [error.code for error in errors]

    def cycles(self, count: int) -> list[Any]:
        """Go on; the images that were taken meanwhile."""
        images = []
        for _ in range(count):
            images += self.look()
            self.pitch.advance()
        return images

    def look(self) -> list[Any]:
        """The images that are due."""
        images = self.pitch.take_images()
        for image in images:
            self.pitch.publish(image)
        return images

    def drive(self, frames: int, blue: bytes = b"", yellow: bytes = b"") -> list[Any]:
        """Go on by frames, with the same commands in each; the images that were taken meanwhile."""
        images = []
        for _ in range(frames):
            assert self.command(blue) == self.command(yellow, 1) == []
            images += self.cycles(CYCLES)
            if self.recorder is not None:
                self.recorder.add_frame()
        return images

    def teleport(self, *packets: bytes) -> list[str]:
        """Put robots down or take them away; codes and names of what is refused."""
        command = parse_message(SimulatorCommand, b"".join(packets))
        return [f"{error.code} {error.message}" for error in self.pitch.teleport(command.control)]

    def put(
        self, number: int, x: float, y: float, heading: float, team: int = BLUE, **twist: float
    ) -> list[str]:
        """Put a robot down; codes of what is refused."""
        refused = self.teleport(teleport(number, team, x=x, y=y, orientation=heading, **twist))
        return [text.split()[0] for text in refused]

    def break_physics(self) -> None:
        self.pitch.plant._batch.bind("qvel")[0, 3] = 1e12

    def heading_estimates(self) -> np.ndarray:
        """What robots take their headings to be."""
        return np.asarray(self.pitch.plant.electronics.firmware.heading)

    def voltage(self) -> float:
        """Largest voltage of the motors in the cycle just past."""
        return float(np.abs(self.pitch.plant._views.voltage.get()).max())

    def record(self, path: Path) -> None:
        """Record to a table until `finish`."""
        self.writer = TrajectoryWriter(path)
        self.recorder = Recorder(self.pitch, [self.writer.add_block])

    def finish(self) -> None:
        assert self.recorder is not None
        self.recorder.end_block()
        self.writer.close()


@contextmanager
def here(
    field: Field, lockstep: bool = True, speed: float = 1.0
) -> Iterator[tuple[Client, Server]]:
    """A server in a thread, and a foreign client of it."""
    client, stop = Client(), threading.Event()
    vision = Address(LOOPBACK, client.vision_port)
    server = Server(field.pitch, (0, 0, 0), vision, speed=speed, lockstep=lockstep)
    client.ports = server.ports

    def check() -> None:
        if stop.is_set():
            raise Ended

    def run() -> None:
        try:
            server.run(check)
        except Ended:
            server.close()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield client, server
    finally:
        stop.set()
        thread.join(10)
        client.close()
        assert not thread.is_alive()

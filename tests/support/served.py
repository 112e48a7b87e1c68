"""`serve` without a process of its own: the pitch alone, or behind its sockets in a thread of this one."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from serving import LOOPBACK, Client

from omni_mj.live.serve import line_up
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.serve.ports import Ports
from omni_mj.live.serve.server import Server
from omni_mj.live.sockets import Address
from omni_mj.live.wire.simulation import GlobalVelocity, LocalVelocity, MoveCommand, RobotCommand, Team, WheelVelocity

QUIET = (
    "vision.position_noise_m=0",
    "vision.heading_noise_rad=0",
    "vision.miss_probability=0",
    "sensors.gyro_noise_rad_s=0",
    "sensors.gyro_bias_rad_s=0",
)
FAST = "wheels.model=two-rollers"


class Ended(Exception):  # noqa: N818
    """Ends a server."""


def pitch_of(
    *sets: str, blue: str = "1", yellow: str = "0", scenario: str | None = None, seed: int = 0, **robots: str
) -> Pitch:
    """What `serve` makes of these options; `robots` are `robot` and `yellow_robot`."""
    head = {"seed": seed} | {key: value for key, value in robots.items() if key == "robot"}
    chosen = line_up.load(scenario, sets, head)
    theirs = line_up.load(scenario, sets, head | {"robot": robots.get("yellow_robot", chosen.robot)})
    line_up.check_together(chosen, theirs)
    numbers = line_up.numbers(blue, "--blue"), line_up.numbers(yellow, "--yellow")
    poses = line_up.poses(*numbers, chosen if scenario else None)
    return Pitch({Team.BLUE: chosen, Team.YELLOW: theirs}, poses)


@contextmanager
def here(pitch: Pitch, lockstep: str = "any", speed: float = 1.0) -> Iterator[tuple[Client, Server]]:
    """A server in a thread, and a foreign client of it."""
    client, stop = Client(), threading.Event()
    server = Server(pitch, Ports(0, 0, 0, Address(LOOPBACK, client.vision_port)), speed, lockstep)
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


def local(number: int, forward: float, left: float = 0.0, angular: float = 0.0) -> RobotCommand:
    """Velocities of the robot's own."""
    return RobotCommand(number, MoveCommand(local_velocity=LocalVelocity(forward, left, angular)))


def world(number: int, x: float, y: float = 0.0, angular: float = 0.0) -> RobotCommand:
    """Velocities of the field."""
    return RobotCommand(number, MoveCommand(global_velocity=GlobalVelocity(x, y, angular)))


def rims(number: int, *speeds: float) -> RobotCommand:
    """Speeds of the wheels front right, back right, back left, front left."""
    return RobotCommand(number, MoveCommand(wheel_velocity=WheelVelocity(*speeds)))


def drive(pitch: Pitch, frames: int, *blue: RobotCommand, yellow: tuple[RobotCommand, ...] = (), each: int = 1) -> None:
    """Go on by frames, told the same in every `each`-th."""
    for frame in range(frames):
        if frame % each == 0:
            for team, commands in ((Team.BLUE, blue), (Team.YELLOW, yellow)):
                assert pitch.command(team, commands)[0] == []
        for _ in range(16):
            for image in pitch.look():
                pitch.detection(image, 0.0)
            pitch.step()


def put(pitch: Pitch, number: int, *pose: float, team: Team = Team.BLUE, twist: tuple = (0, 0, 0)) -> list[str]:
    """Put a robot down; codes of what is refused."""
    wanted = {(team, number): (np.array(pose, float), np.array(twist, float))}
    return [refusal.code for refusal in pitch.place(wanted, set())]

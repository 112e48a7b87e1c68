"""A client of the league's protocols, packets for it, and `omni-mj serve` as a process."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from omni_mj.live.wire.league_pb2 import (
    Detection,
    MoveCommand,
    RobotCommand,
    RobotControl,
    RobotId,
    SimulatorCommand,
    SimulatorControl,
    SimulatorResponse,
    Team,
    TeleportRobot,
    VisionPacket,
)

LOOPBACK = "127.0.0.1"
PATIENCE_S = 20.0  # of a test, on a busy machine
YELLOW, BLUE = Team.YELLOW, Team.BLUE
Pose = tuple[float, float, float]
RobotSeen = tuple[int, float, float, float]  # number and pose


def local(number: int, forward: float, left: float = 0.0, angular: float = 0.0) -> bytes:
    """A packet to one robot: velocities in its frame. Packets to several are joined."""
    return _command(number, local_velocity={"forward": forward, "left": left, "angular": angular})


def world(number: int, x: float, y: float = 0.0, angular: float = 0.0) -> bytes:
    """A packet to one robot: velocities in the field's frame."""
    return _command(number, global_velocity={"x": x, "y": y, "angular": angular})


def wheels(number: int, *rims: float) -> bytes:
    """A packet to one robot: rim speeds front right, back right, back left, front left."""
    names = "front_right", "back_right", "back_left", "front_left"
    return _command(number, wheel_velocity=dict(zip(names, rims, strict=True)))


def _command(number: int, **move: dict[str, float]) -> bytes:
    command = RobotCommand(id=number, move_command=MoveCommand(**move))
    return RobotControl(robot_commands=[command]).SerializeToString()


def teleport(number: int, team: int, present: bool | None = True, **values: float) -> bytes:
    """A packet to the simulator: x, y, orientation, v_x, v_y, v_angular."""
    robot = TeleportRobot(id=RobotId(id=number, team=team), present=present, **values)
    return SimulatorCommand(control=SimulatorControl(teleport_robot=[robot])).SerializeToString()


def control(**values: object) -> bytes:
    """A packet to the simulator: the speed, or the ball."""
    return SimulatorCommand(control=SimulatorControl(**values)).SerializeToString()


def vision(
    frame: int,
    blue: Sequence[RobotSeen],
    *,
    camera: int = 0,
    captured: float,
    sent: float,
    yellow: Sequence[RobotSeen] = (),
) -> bytes:
    """A packet of SSL-Vision: numbers and poses in m and rad."""
    detection = Detection(frame_number=frame, t_capture=captured, t_sent=sent, camera_id=camera)
    for team, robots in ((detection.robots_blue, blue), (detection.robots_yellow, yellow)):
        for name, x, y, heading in robots:
            pixel = {"pixel_x": 0, "pixel_y": 0}
            team.add(
                confidence=1,
                robot_id=int(name),
                x=1000 * x,
                y=1000 * y,
                orientation=heading,
                **pixel,
            )
    return VisionPacket(detection=detection).SerializeToString()


def robots(detection: Detection) -> dict[tuple[str, int], Pose]:
    """Poses in m and rad that a detection has."""
    teams = {"yellow": detection.robots_yellow, "blue": detection.robots_blue}
    return {
        (team, robot.robot_id): (robot.x / 1000, robot.y / 1000, robot.orientation)
        for team, seen in teams.items()
        for robot in seen
    }


class Client:
    """A team's software."""

    def __init__(self) -> None:
        self.vision, self.commands = udp(), udp()
        self.vision_port = int(self.vision.getsockname()[1])
        self.ports: Sequence[int] = (0, 0, 0)

    def ask(self, port: int, packet: bytes) -> bytes:
        """Send to the simulator (0), blue (1) or yellow (2), and return the answer."""
        self.commands.sendto(packet, (LOOPBACK, self.ports[port]))
        return self.commands.recv(65536)

    def codes(self, port: int, packet: bytes) -> list[str]:
        """Send, and return the codes of the errors in the answer."""
        return [error.code for error in SimulatorResponse.FromString(self.ask(port, packet)).errors]

    def step(self, packet: bytes, team: int = 1) -> Detection:
        """In lockstep: command, and return what the camera sees after."""
        self.ask(team, packet)
        return self.newest()

    def after(self, packet: bytes, team: int = 1) -> dict[tuple[str, int], Pose]:
        """In lockstep: command, and return the poses that the camera sees after."""
        return robots(self.step(packet, team))

    def packet(self, part: str = "detection") -> VisionPacket:
        """The next packet of vision that has a part."""
        while not (packet := VisionPacket.FromString(self.vision.recv(65536))).HasField(part):
            pass
        return packet

    def newest(self) -> Detection:
        """The last detection that has come."""
        newest = self.packet().detection
        self.vision.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                newest = self.packet().detection
        self.vision.settimeout(PATIENCE_S)
        return newest

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
def served(
    *options: str, client: Client, ports: Sequence[int] = (0, 0, 0)
) -> Iterator[subprocess.Popen]:
    """`omni-mj serve` as a process that sends vision to a client; its ports are read."""
    names = ("--control-port", "--blue-port", "--yellow-port")
    where = [word for name, port in zip(names, ports, strict=True) for word in (name, str(port))]
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "omni_mj.cli.main", "serve", *where]
    command += ["--vision", f"{LOOPBACK}:{client.vision_port}", *options]
    environment = os.environ | {"PYTHONPATH": f"{root}:{root / 'control'}", "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
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

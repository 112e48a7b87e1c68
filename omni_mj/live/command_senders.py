"""Commands on their way out: by ssl-simulation-protocol, or by a team's own radio."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from omni_mj.live import sockets
from omni_mj.live.sockets import LOOPBACK, MAX_DATAGRAM, Address, Notes
from omni_mj.live.ssl_vision import Colour
from omni_mj.live.wire import BLUE_PORT, YELLOW_PORT, WireError, parse
from omni_mj.live.wire.league_pb2 import RobotControl, RobotControlResponse

PORTS: dict[Colour, int] = {"blue": BLUE_PORT, "yellow": YELLOW_PORT}


@dataclass(frozen=True)
class Command:
    """Velocity that a robot is told in a frame.

    Attributes:
        id: Number of the robot.
        x, y: Velocity along the field, m/s.
        turn: Turn rate, counter-clockwise, rad/s.
        heading: Predicted heading of the robot in the middle of the time for which the command
            acts, rad.
    """

    id: int
    x: float
    y: float
    turn: float
    heading: float

    @property
    def forward(self) -> float:
        """Velocity in the direction of `heading`, m/s."""
        return math.cos(self.heading) * self.x + math.sin(self.heading) * self.y

    @property
    def left(self) -> float:
        """Velocity to the left of `heading`, m/s."""
        return math.cos(self.heading) * self.y - math.sin(self.heading) * self.x


@dataclass(frozen=True)
class Line:
    """Where a radio leads.

    Attributes:
        host: Address of the robots or their simulator; None for the usual one.
        colour: Of the team.
        interface: By which packets leave.
        both: Whether the other team's port gets an empty packet for each.
    """

    host: Address | None
    colour: Colour
    interface: str
    both: bool = False


class Radio:
    """Derive from it, write `send`, and name the class: `omni-mj drive --radio my_radio.py:MyRadio`.

    `send` is called once a frame, 60 times a second, with a command for each robot, within the
    limits of `[control]`; it must not wait. Robots that vision has lost are told to stop. At the
    end `close` is called.

    Args:
        line: Where it leads.
        notes: For what goes wrong: `notes.add(kind, text)` counts it.
    """

    def __init__(self, line: Line, notes: Notes) -> None:
        self.line, self.notes = line, notes

    def send(self, commands: Sequence[Command]) -> None:
        """Send what robots are told in this frame."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of what was opened."""


class SimulatorRadio(Radio):
    """ssl-simulation-protocol: a datagram a frame to the team's port.

    The other team's may get an empty one: grSim stops a team whose opponents nobody commands.
    """

    def __init__(self, line: Line, notes: Notes) -> None:
        super().__init__(line, notes)
        self._target = line.host or Address(LOOPBACK, PORTS[line.colour])
        self._socket = sockets.sender(line.interface)
        self._opponents = None
        if (
            line.both and self._target.port == PORTS[line.colour]
        ):  # of other ports it is not known whose they are
            self._opponents = self._target._replace(
                port=PORTS["yellow" if line.colour == "blue" else "blue"]
            )

    def send(self, commands: Sequence[Command]) -> None:
        """See `Radio`."""
        self._read_answers()
        packet = RobotControl()
        for command in commands:
            velocity = packet.robot_commands.add(id=command.id).move_command.local_velocity
            velocity.forward, velocity.left, velocity.angular = (
                command.forward,
                command.left,
                command.turn,
            )
        try:
            self._socket.sendto(packet.SerializeToString(), self._target)
            if self._opponents:
                self._socket.sendto(b"", self._opponents)
        except OSError as error:
            self.notes.add(
                "not sent", f"commands to {self._target} are not sent: {sockets.reason(error)}"
            )

    def close(self) -> None:
        """See `Radio`."""
        self._socket.close()

    def _read_answers(self) -> None:
        """Note what the simulator refuses."""
        while True:
            try:
                response = parse(RobotControlResponse, self._socket.recv(MAX_DATAGRAM))
            except BlockingIOError:
                return
            except (OSError, WireError):
                self.notes.add("bad answer", f"an answer of {self._target} to commands is skipped")
                continue
            for error in response.errors:
                text = error.message or error.code or "no reason given"
                self.notes.add(f"refused: {text}", f"{self._target} refuses: {text}")

"""Senders of commands: the ssl-simulation-protocol, and the base class of a team's own radio."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from omni_control.errors import to_printable
from omni_mj.live import sockets
from omni_mj.live.sockets import LOOPBACK, MAX_DATAGRAM, MAX_READS, Address, MessageCounter
from omni_mj.live.ssl_vision import TeamColor
from omni_mj.live.wire import BLUE_PORT, YELLOW_PORT, WireError, parse_message
from omni_mj.live.wire.league_pb2 import RobotControl, RobotControlResponse

PORTS: dict[TeamColor, int] = {"blue": BLUE_PORT, "yellow": YELLOW_PORT}


@dataclass(frozen=True)
class VelocityCommand:
    """Velocity command of one robot for one frame.

    Attributes:
        id: Number of the robot.
        x, y: Velocity in the world frame, m/s.
        turn: Turn rate, counter-clockwise, rad/s.
        heading: Predicted heading of the robot in the middle of the frame in which the command
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
class SenderConfig:
    """Destination of commands.

    Attributes:
        host: Address of the robots or their simulator. None: the default address of the team.
        color: Color of the team.
        interface: Address of the network interface that sends packets.
        reaches_both_teams: Whether the other team's port also gets a packet, without commands, in
            each frame.
    """

    host: Address | None
    color: TeamColor
    interface: str
    reaches_both_teams: bool


class TeamRadio:
    """Base class of a team's own radio: `omni-mj drive --radio my_radio.py:MyRadio`.

    Derive a class and implement `send`, which is called 60 times per second and must not block.
    Commands are within the limits of `[control]`. Robots that vision has lost get a command to
    stop. `close` is called at the end.

    Args:
        config: Destination of the commands.
        messages: Counts problems: `messages.add(kind, text)` prints the first text of each kind.
    """

    def __init__(self, config: SenderConfig, messages: MessageCounter) -> None:
        self.config, self.messages = config, messages

    def send(self, commands: Sequence[VelocityCommand]) -> None:
        """Send the commands of this frame, one per robot."""
        raise NotImplementedError

    def close(self) -> None:
        """Close what the constructor opened."""


class SimulatorRadio(TeamRadio):
    """Sends one datagram of the ssl-simulation-protocol per frame to the team's port.

    If requested, the other team's port gets an empty datagram per frame. grSim needs it, because it
    stops a team if its opponents get no packets.
    """

    def __init__(self, config: SenderConfig, messages: MessageCounter) -> None:
        super().__init__(config, messages)
        self._target = config.host or Address(LOOPBACK, PORTS[config.color])
        self._socket = sockets.open_sender(config.interface)
        self._opponents = None
        # The opponents' port is known only if the team's port is the default one.
        if config.reaches_both_teams and self._target.port == PORTS[config.color]:
            self._opponents = self._target._replace(
                port=PORTS["yellow" if config.color == "blue" else "blue"]
            )

    def send(self, commands: Sequence[VelocityCommand]) -> None:
        """See `TeamRadio`."""
        self._read_answers()
        packet = RobotControl()
        for command in commands:
            velocity = packet.robot_commands.add(id=command.id).move_command.local_velocity
            velocity.forward = command.forward
            velocity.left = command.left
            velocity.angular = command.turn
        try:
            self._socket.sendto(packet.SerializeToString(), self._target)
            if self._opponents:
                self._socket.sendto(b"", self._opponents)
        except OSError as error:
            self.messages.add(
                "not sent",
                f"cannot send commands to {self._target}: {sockets.error_reason(error)}",
            )

    def close(self) -> None:
        """See `TeamRadio`."""
        self._socket.close()

    def _read_answers(self) -> None:
        """Read the simulator's responses, and count the errors that they report."""
        for _ in range(MAX_READS):
            try:
                response = parse_message(RobotControlResponse, self._socket.recv(MAX_DATAGRAM))
            except BlockingIOError:
                return
            except (OSError, WireError):
                self.messages.add("bad answer", f"skipped a malformed answer from {self._target}")
                continue
            for error in response.errors:
                # Text that is not UTF-8 is of type bytes.
                text = to_printable(str(error.message or error.code or "no reason given"))
                self.messages.add(f"refused: {text}", f"{self._target} refuses: {text}")

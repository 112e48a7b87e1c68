"""Commands on their way out: by ssl-simulation-protocol, or by a team's own radio."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from omni_mj.live import sockets
from omni_mj.live.notes import Notes
from omni_mj.live.sockets import Address
from omni_mj.live.vision import Colour
from omni_mj.live.wire import WireError, decode, encode
from omni_mj.live.wire.simulation import (
    BLUE_PORT,
    YELLOW_PORT,
    GlobalVelocity,
    LocalVelocity,
    MoveCommand,
    RobotCommand,
    RobotControl,
    RobotControlResponse,
)

PORTS: dict[Colour, int] = {"blue": BLUE_PORT, "yellow": YELLOW_PORT}
OTHER: dict[Colour, Colour] = {"blue": "yellow", "yellow": "blue"}


@dataclass(frozen=True)
class Command:
    """What a robot is told in a frame.

    Attributes:
        id: its number.
        x, y: velocity along the field, m/s.
        turn: turn rate, counter-clockwise, rad/s.
        heading: that the robot is predicted to have in the middle of the time for which the command acts, rad.
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
        """Velocity to the left of it, m/s."""
        return math.cos(self.heading) * self.y - math.sin(self.heading) * self.x


@dataclass(frozen=True)
class Line:
    """What a radio is told of where it leads.

    Attributes:
        host: where the robots, or their simulator, are; None for the usual one.
        colour: of the team.
        interface: by which packets leave.
        world: whether robots shall be told velocities along the field, in place of forward and left.
        notes: for what goes wrong.
        both: whether the other team's port shall get an empty packet for each.
    """

    host: Address | None
    colour: Colour
    interface: str
    world: bool
    notes: Notes
    both: bool = False


class Radio:
    """Derive from it, write `send`, and name the class: `omni-mj drive --radio my_radio.py:MyRadio`.

    `send` is called once a frame, 60 times a second, with a command for each robot, within the limits of
    `[control]`; it must not wait. Robots that vision has lost are told to stop. At the end `close` is called.

    Args:
        line: where it leads.
    """

    name: ClassVar[str] = "own radio"

    def __init__(self, line: Line) -> None:
        self.line = line

    def send(self, commands: Sequence[Command]) -> None:
        """Send what robots are told in this frame."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of what was opened."""


class SimulatorRadio(Radio):
    """ssl-simulation-protocol: a datagram a frame to the team's port.

    The other team's may get an empty one: grSim stops a team whose opponents nobody commands.
    """

    name = "ssl-simulation-protocol"

    def __init__(self, line: Line) -> None:
        super().__init__(line)
        self.target = line.host or Address(sockets.LOOPBACK, PORTS[line.colour])
        sockets.check_local(self.target, line.interface)
        self._socket = sockets.sender(line.interface)
        both = line.both and self.target.port == PORTS[line.colour]  # of other ports it is not known whose they are
        self._other = Address(self.target.host, PORTS[OTHER[line.colour]]) if both else None
        self._nothing = encode(RobotControl())

    def send(self, commands: Sequence[Command]) -> None:
        """See `Radio`."""
        self._listen()
        packet = encode(RobotControl(tuple(RobotCommand(each.id, self._move(each)) for each in commands)))
        try:
            self._socket.sendto(packet, self.target)
            if self._other:
                self._socket.sendto(self._nothing, self._other)
        except OSError as error:
            self.line.notes.add("not sent", f"commands to {self.target} are not sent: {error.strerror or error}")

    def close(self) -> None:
        """See `Radio`."""
        self._socket.close()

    def _move(self, each: Command) -> MoveCommand:
        if self.line.world:
            return MoveCommand(global_velocity=GlobalVelocity(each.x, each.y, each.turn))
        return MoveCommand(local_velocity=LocalVelocity(each.forward, each.left, each.turn))

    def _listen(self) -> None:
        """Note what the simulator complains of."""
        while True:
            try:
                data = self._socket.recv(sockets.MOST_BYTES)
                response = decode(RobotControlResponse, data)
            except BlockingIOError:
                return
            except (OSError, WireError):
                self.line.notes.add("bad answer", f"an answer of {self.target} to commands is skipped")
                continue
            for error in response.errors:
                said = error.message or error.code or "no reason given"
                self.line.notes.add(f"refused: {said}", f"{self.target} refuses: {said}")

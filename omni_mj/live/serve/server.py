"""`serve`: the pitch behind the sockets of the league's simulators, in real time or in lockstep with commands."""

import heapq
import math
import select
import time
from collections import Counter, deque
from collections.abc import Callable
from itertools import islice
from typing import NamedTuple

from omni_mj.live.notes import Notes
from omni_mj.live.serve import control
from omni_mj.live.serve.cameras import CYCLES, Image
from omni_mj.live.serve.commands import Refusal
from omni_mj.live.serve.pace import Pace
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.sockets import LOOPBACK, Address, Receiver, sender
from omni_mj.live.wire import WireError, decode, encode
from omni_mj.live.wire.simulation import (
    BLUE_PORT,
    SIMULATOR_PORT,
    YELLOW_PORT,
    RobotControl,
    RobotControlResponse,
    RobotFeedback,
    SimulatorCommand,
    SimulatorResponse,
    Team,
)
from omni_mj.live.wire.vision import SIMULATED_VISION_PORT, VISION_GROUP, VisionPacket
from omni_mj.scenarios.settings import CYCLE_RATE_HZ

GEOMETRY_CYCLES = CYCLE_RATE_HZ  # from one packet of the geometry to the next
PACE_CYCLES = 4  # from one look at the clock to the next
AT_ONCE = 64  # packets read from a socket before the others have their turn
INVITED_S = 0.2  # in lockstep, until the first command: what cameras saw is sent again so often
CHECKED_S = 0.1  # how long nothing else is looked after at most
BOTH = {Team.BLUE, Team.YELLOW}
REMEMBERED = 100_000  # sendings whose lateness is kept


class Ports(NamedTuple):
    """Where is listened and sent.

    Args:
        control, blue, yellow: ports; 0 takes a free one.
        vision: where detections go.
        interface: by which; loopback keeps all on this computer.
    """

    control: int = SIMULATOR_PORT
    blue: int = BLUE_PORT
    yellow: int = YELLOW_PORT
    vision: Address = Address(VISION_GROUP, SIMULATED_VISION_PORT)
    interface: str = LOOPBACK


class Port(Receiver):
    """A port that answers."""

    def reply(self, data: bytes, to: Address) -> None:
        """Send from here to whoever asked."""
        self._socket.sendto(data, to)

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()


class Server:
    """Serves until it is told to stop.

    Args:
        pitch: what is served.
        ports: where.
        speed: times as fast as real time.
        lockstep: teams that must command before the first camera takes its next image: "" for none, so that time goes
            by itself; "any": each packet to a team makes a step; "both": a packet to each.
        tell: called with what people should know, in words.
        after_frame: called after every 1/60 s of simulated time.

    Attributes:
        after_frame: as given.
        vision: where detections go.
        notes: of what was wrong, told once and counted.
        counts: of packets and what was wrong with them.
        lateness: of detections that were sent, s of our time after they were due.

    Raises:
        OmniError: a port is taken, or there is no such interface.
    """

    def __init__(
        self,
        pitch: Pitch,
        ports: Ports | None = None,
        speed: float = 1.0,
        lockstep: str = "",
        tell: Callable[[str], None] = lambda text: None,
        after_frame: Callable[[], None] = lambda: None,
    ) -> None:
        self.pitch, self._lockstep, self.after_frame = pitch, lockstep, after_frame
        self.notes, self.counts = Notes(tell), Counter[str]()
        self.lateness = deque[float](maxlen=REMEMBERED)
        ports = ports or Ports()
        self.vision, self._sockets = ports.vision, list[Port]()
        self._sender = sender(ports.interface)
        try:
            for port in (ports.control, ports.blue, ports.yellow):
                self._sockets.append(Port(Address(ports.interface, port), ports.interface))
        except BaseException:
            self.close()
            raise
        self._control, *teams = self._sockets
        self._teams = dict(zip(teams, (Team.BLUE, Team.YELLOW), strict=True))
        self._epoch = 0.0  # in stamps, of the simulated time 0
        self._pace = Pace(speed, time.monotonic())
        self._outbox: list[tuple[float, int, Image]] = []
        self._images, self._newest = 0, dict[int, bytes]()
        self._geometry_due, self._called, self._invited = 0, set[Team](), -math.inf

    @property
    def ports(self) -> tuple[int, int, int]:
        """The ports that are listened to: control, blue, yellow."""
        control, blue, yellow = (each.address.port for each in self._sockets)
        return control, blue, yellow

    @property
    def in_real_time(self) -> bool:
        """Whether time goes by itself."""
        return not self._lockstep

    @property
    def time_goes(self) -> str:
        """How time goes, in words."""
        if self._lockstep:
            return (
                f"an image for each packet to {'either team' if self._lockstep == 'any' else 'both teams'} (lockstep)"
            )
        return f"{self._pace.speed:g} times as fast as real time" if self._pace.speed else "paused"

    @property
    def lost_s(self) -> float:
        """By how much simulated time fell behind because this computer was too slow, s."""
        return self._pace.lost_s

    def run(self, check: Callable[[], None] = lambda: None, until_s: float = math.inf) -> None:
        """Serve until simulated time is over, or `check`, which is called often, raises something."""
        self._pace.change(self._pace.speed, time.monotonic(), self.pitch.cycle)
        if not self._lockstep:  # stamps are of the world's clock then; in lockstep they are the same in all runs
            self._epoch = time.time() - self.pitch.time_s
        self._look()
        while self.pitch.time_s < until_s:
            check()
            if self._lockstep:
                self._wait(time.monotonic() + CHECKED_S)
                self._invite()
            else:
                self._turn()

    def close(self) -> None:
        """Free the ports."""
        self._sender.close()
        for port in self._sockets:
            port.close()

    def _turn(self) -> None:
        """Simulate what is due, then wait for packets until more is."""
        now = time.monotonic()
        due = self._pace.due(now)
        if self._pace.slip(now, self.pitch.cycle):
            lost = "this computer is too slow for this speed; simulated time falls behind"
            self.notes.add("too slow", lost)
            due = self.pitch.cycle
        self._advance(min(due, self.pitch.cycle + CYCLES))
        wake = min(self._pace.when(min(self.pitch.cycle + PACE_CYCLES, self.pitch.due)), self._next_sending())
        self._wait(min(wake, now + CHECKED_S))

    def _next_sending(self) -> float:
        return self._pace.when(math.ceil(self._outbox[0][0] * CYCLE_RATE_HZ - 1e-6)) if self._outbox else math.inf

    def _advance(self, until: int) -> None:
        """Simulate up to a cycle."""
        pitch = self.pitch
        while pitch.cycle < until:
            pitch.step()
            if pitch.due <= pitch.cycle:
                self._look()
            elif self._outbox:
                self._send_due()
            if pitch.cycle % CYCLES == 0:
                self.after_frame()

    def _look(self) -> None:
        """Take the images that are due, and send what is."""
        for image in self.pitch.look():
            self._images += 1
            if math.isinf(image.sent):
                self.counts["packets of cameras lost"] += 1
            else:
                heapq.heappush(self._outbox, (image.sent, self._images, image))
        self._send_due()

    def _send_due(self) -> None:
        while self._outbox and self._outbox[0][0] <= self.pitch.time_s + 1e-9:
            due, _, image = heapq.heappop(self._outbox)
            self._newest[image.camera] = encode(VisionPacket(self.pitch.detection(image, self._epoch)))
            self._send(self._newest[image.camera])
            self.lateness.append(time.monotonic() - self._pace.when(due * CYCLE_RATE_HZ))
        if self.pitch.cycle >= self._geometry_due:
            self._geometry_due = self.pitch.cycle + GEOMETRY_CYCLES
            self._send(encode(VisionPacket(geometry=self.pitch.geometry())))

    def _send(self, data: bytes) -> None:
        try:
            self._sender.sendto(data, self.vision)
            self.counts["vision packets sent"] += 1
        except OSError as error:
            self.notes.add("vision not sent", f"cannot send to {self.vision}: {error.strerror}")

    def _wait(self, until: float) -> None:
        """Handle packets that come until then, s of our clock; it returns after the first ones."""
        ready, _, _ = select.select(self._sockets, [], [], max(until - time.monotonic(), 0.0))
        for port in ready:
            if not self._lockstep:  # what comes now acts in the cycle that begins next
                self._advance(min(self._pace.due(time.monotonic()), self.pitch.cycle + CYCLES))
            for data, _, source in islice(port.packets(), AT_ONCE):
                try:
                    answer = self._simulator(data) if port is self._control else self._robots(self._teams[port], data)
                except WireError as error:
                    self.notes.add("bad packets", f"a packet from {source} is skipped: {error}")
                    continue
                try:
                    port.reply(answer, source)
                except OSError as error:
                    self.notes.add("answers not sent", f"cannot answer {source}: {error.strerror}")

    def _simulator(self, data: bytes) -> bytes:
        """Obey a command to the simulator, and answer it."""
        command = decode(SimulatorCommand, data)
        self.counts["simulator commands"] += 1
        wishes = control.obey(self.pitch, command)
        if wishes.speed is not None and self._lockstep:
            wishes.refused.append(Refusal("LOCKSTEP", "in lockstep, time goes by commands"))
        elif wishes.speed is not None:
            self._pace.change(wishes.speed, time.monotonic(), self.pitch.cycle)
        if wishes.vision_port is not None:
            self.vision = Address(self.vision.host, wishes.vision_port)
        if wishes.geometry:
            self._geometry_due = self.pitch.cycle
        if self._lockstep:
            self._again()
        return encode(SimulatorResponse(tuple(refusal.error for refusal in wishes.refused)))

    def _robots(self, team: Team, data: bytes) -> bytes:
        """Obey commands to robots, and answer them; in lockstep, after the step that they make."""
        control = decode(RobotControl, data)
        self.counts[f"{team.name.lower()} commands"] += 1
        refused, commanded = self.pitch.command(team, control.robot_commands)
        for refusal in refused:
            self.notes.add(f"refused: {refusal.code}", refusal.text)
        if any(command.kick_speed or command.dribbler_speed for command in control.robot_commands):
            if not self.notes.counts["kicks"]:  # said once, to either side
                refused.append(Refusal("NO_KICK", "robots here neither kick nor dribble; they only move"))
            self.notes.add("kicks", "kicks and dribblers are ignored: robots here only move")
        self._called.add(team)
        if self._lockstep == "any" or (self._lockstep and self._called == BOTH):
            self._called.clear()
            self._advance(self.pitch.first_due)
        feedback = tuple(RobotFeedback(number, False) for number in commanded)
        return encode(RobotControlResponse(tuple(refusal.error for refusal in refused), feedback))

    def _invite(self) -> None:
        """In lockstep, let those who come later see what there is, until the first command."""
        commanded = self.counts["blue commands"] + self.counts["yellow commands"]
        if not commanded and time.monotonic() - self._invited > INVITED_S:
            self._invited = time.monotonic()
            self._again()

    def _again(self) -> None:
        """Send once more what cameras saw last, and the geometry."""
        self._send(encode(VisionPacket(geometry=self.pitch.geometry())))
        for data in self._newest.values():
            self._send(data)

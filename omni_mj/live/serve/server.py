"""`serve`: the pitch behind the sockets of the league's simulators, in real time or in lockstep with commands."""

import math
import select
import time
from collections import Counter
from collections.abc import Callable

from omni_mj.live.notes import Notes
from omni_mj.live.serve import control
from omni_mj.live.serve.cameras import CYCLES
from omni_mj.live.serve.commands import Refusal
from omni_mj.live.serve.pace import Pace
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.serve.ports import Listener, Port, Ports, Stream
from omni_mj.live.serve.publisher import Publisher
from omni_mj.live.sockets import Address
from omni_mj.live.wire import WireError, decode, encode
from omni_mj.live.wire.simulation import (
    RobotControl,
    RobotControlResponse,
    RobotFeedback,
    SimulatorCommand,
    SimulatorResponse,
    SyncRequest,
    SyncResponse,
    Team,
)
from omni_mj.live.wire.vision import Detection
from omni_mj.scenarios.settings import CYCLE_RATE_HZ

PACE_CYCLES = 4  # from one look at the clock to the next at least, while nothing comes and nothing is due
INVITED_S = 0.2  # in lockstep, until the first command: what cameras saw is sent again so often
CHECKED_S = 0.1  # how long nothing else is looked after at most
BOTH = {Team.BLUE, Team.YELLOW}
LONGEST_STEP_S = 10.0  # of a request in the synchronous mode


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
        publisher: of what cameras see.
        notes: of what was wrong, told once and counted.
        counts: of packets and what was wrong with them.

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
        ports = ports or Ports()
        self._ports, self._listeners, self._streams = list[Port](), list[Listener](), list[Stream]()
        self._pace = Pace(speed, time.monotonic())
        self.publisher = Publisher(pitch, ports.vision, ports.interface, self._pace, self.notes, self.counts)
        try:
            for number, team in ((ports.control, None), (ports.blue, Team.BLUE), (ports.yellow, Team.YELLOW)):
                self._ports.append(Port(Address(ports.interface, number), ports.interface, team))
                if lockstep:
                    self._listeners.append(Listener(self._ports[-1]))
        except BaseException:
            self.close()
            raise
        self._called, self._invited, self._rest = set[Team](), -math.inf, 0.0

    @property
    def ports(self) -> tuple[int, int, int]:
        """The ports that are listened to: control, blue, yellow."""
        control, blue, yellow = (each.address.port for each in self._ports)
        return control, blue, yellow

    @property
    def in_real_time(self) -> bool:
        """Whether time goes by itself."""
        return not self._lockstep

    @property
    def time_goes(self) -> str:
        """How time goes, in words."""
        if self._lockstep:
            teams = "either team" if self._lockstep == "any" else "both teams"
            return f"an image for each packet to {teams}, and steps by TCP (lockstep)"
        return f"{self._pace.speed:g} times as fast as real time" if self._pace.speed else "paused"

    @property
    def lost_s(self) -> float:
        """By how much simulated time fell behind because this computer was too slow, s."""
        return self._pace.lost_s

    def run(self, check: Callable[[], None] = lambda: None, until_s: float = math.inf) -> None:
        """Serve until simulated time is over, or `check`, which is called often, raises something."""
        self.publisher.look()
        self._pace.change(self._pace.speed, time.monotonic(), self.pitch.cycle)
        # In lockstep stamps are the same in all runs.
        self.publisher.begin(time.time() - self.pitch.time_s if self.in_real_time else 0.0)
        while self.pitch.time_s < until_s:
            check()
            if self._lockstep:
                self._wait(time.monotonic() + CHECKED_S)
                self._invite()
            else:
                self._turn()

    def close(self) -> None:
        """Free the ports."""
        self.publisher.close()
        for each in self._doors:
            each.close()

    @property
    def _doors(self) -> list[Port | Listener | Stream]:
        """All by which somebody may come."""
        return [*self._ports, *self._listeners, *self._streams]

    def _turn(self) -> None:
        """Simulate what is due, then wait for packets until more is."""
        pitch, pace, now = self.pitch, self._pace, time.monotonic()
        due = pace.due(now)
        if pace.slip(now, pitch.cycle):
            lost = "this computer is too slow for this speed; simulated time falls behind"
            self.notes.add("too slow", lost)
            due = pitch.cycle
        self._advance(min(due, pitch.cycle + CYCLES))
        # Half of what is left to the next image is simulated at a time: few wakings, and little left when it is due.
        left = pitch.due - pitch.cycle
        wake, sending = pitch.cycle + min(left, max(left // 2, PACE_CYCLES)), self.publisher.due
        self._wait(min(pace.when(wake if sending is None else min(wake, sending)), now + CHECKED_S))

    def _advance(self, until: int) -> None:
        """Simulate up to a cycle."""
        pitch, publisher = self.pitch, self.publisher
        while pitch.cycle < until:
            frame, sending = pitch.cycle // CYCLES * CYCLES + CYCLES, publisher.due
            pitch.advance(max(min(until, frame, pitch.due, frame if sending is None else sending), pitch.cycle + 1))
            if pitch.due <= pitch.cycle:
                publisher.look()
            elif publisher.due is not None:
                publisher.send()
            if pitch.cycle % CYCLES == 0:
                self.after_frame()

    def _wait(self, until: float) -> None:
        """Handle packets that come until then, s of our clock; it returns after the first ones."""
        ready, _, _ = select.select(self._doors, [], [], max(until - time.monotonic(), 0.0))
        for each in ready:
            if isinstance(each, Listener):
                self._welcome(each)
                continue
            if not self._lockstep:  # what comes now acts in the cycle that begins next
                self._advance(min(self._pace.due(time.monotonic()), self.pitch.cycle + CYCLES))
            if isinstance(each, Stream):
                self._converse(each)
                continue
            for data, source in each.requests():
                try:
                    answer = self._simulator(data) if each.team is None else self._robots(each.team, data)
                except WireError as error:
                    self.notes.add("bad packets", f"a packet from {source} is skipped: {error}")
                    continue
                try:
                    each.reply(answer, source)
                except OSError as error:
                    self.notes.add("answers not sent", f"cannot answer {source}: {error.strerror}")

    def _welcome(self, listener: Listener) -> None:
        """Let a client of the synchronous mode in."""
        try:
            self._streams.append(listener.accept())
        except OSError as error:
            self.notes.add("clients lost", f"a client left before it was let in: {error.strerror}")

    def _converse(self, stream: Stream) -> None:
        """Do what a client of the synchronous mode asks; hang up where it cannot be understood, or has gone."""
        try:
            for request in stream.requests():
                stream.reply(self._sync(stream.team, request))
            return
        except WireError as error:
            self.notes.add("bad packets", f"{stream.address} is hung up on: {error}")
        except OSError:
            pass
        self._streams.remove(stream)
        stream.close()

    def _sync(self, team: Team | None, data: bytes) -> bytes:
        """Obey a request of the synchronous mode, step, and answer with what cameras sent meanwhile."""
        request = decode(SyncRequest, data)
        self.counts["synchronous requests"] += 1
        answer = RobotControlResponse()
        refused = self._obey(request.simulator_command) if request.simulator_command else []
        if request.robot_control is not None and team is None:
            refused.append(Refusal("NO_TEAM", "commands to robots go to a team's port"))
        elif request.robot_control is not None and team is not None:
            answer = self._command(team, request.robot_control)
        self.publisher.detections = sent = list[Detection]()
        step = request.sim_step or 0.0
        if 0 <= step <= LONGEST_STEP_S:
            cycles = round(step * CYCLE_RATE_HZ + self._rest)
            self._rest += step * CYCLE_RATE_HZ - cycles
            self._advance(self.pitch.cycle + cycles)
        else:
            refused.append(Refusal("STEP", f"a step takes 0 to {LONGEST_STEP_S:g} s, not {step:g}"))
        self.publisher.detections = None
        errors = *answer.errors, *(refusal.error for refusal in refused)
        return encode(SyncResponse(tuple(sent), answer._replace(errors=errors)))

    def _simulator(self, data: bytes) -> bytes:
        """Obey a command to the simulator, and answer it."""
        refused = self._obey(decode(SimulatorCommand, data))
        if self._lockstep:
            self.publisher.again()
        return encode(SimulatorResponse(tuple(refusal.error for refusal in refused)))

    def _obey(self, command: SimulatorCommand) -> list[Refusal]:
        """Obey a command to the simulator; say what is refused."""
        self.counts["simulator commands"] += 1
        wishes = control.obey(self.pitch, command)
        if wishes.speed is not None and self._lockstep:
            wishes.refused.append(Refusal("LOCKSTEP", "in lockstep, time goes by commands"))
        elif wishes.speed is not None:
            self._pace.change(wishes.speed, time.monotonic(), self.pitch.cycle)
        if wishes.vision_port is not None:
            self.publisher.to = self.publisher.to._replace(port=wishes.vision_port)
        if wishes.geometry:
            self.publisher.resized()
        return wishes.refused

    def _robots(self, team: Team, data: bytes) -> bytes:
        """Obey commands to robots, and answer them; in lockstep, after the step that they make."""
        answer = self._command(team, decode(RobotControl, data))
        self._called.add(team)
        if self._lockstep == "any" or (self._lockstep and self._called == BOTH):
            self._called.clear()
            self._advance(self.pitch.first_due)
        return encode(answer)

    def _command(self, team: Team, control: RobotControl) -> RobotControlResponse:
        """Pass commands on to robots."""
        self.counts[f"{team.name.lower()} commands"] += 1
        refused, commanded = self.pitch.command(team, control.robot_commands)
        for refusal in refused:
            self.notes.add(f"refused: {refusal.code}", refusal.text)
        if any(command.kick_speed or command.dribbler_speed for command in control.robot_commands):
            if not self.notes.counts["kicks"]:  # said once, to either side
                refused.append(Refusal("NO_KICK", "robots here neither kick nor dribble; they only move"))
            self.notes.add("kicks", "kicks and dribblers are ignored: robots here only move")
        feedback = tuple(RobotFeedback(number, False) for number in commanded)
        return RobotControlResponse(tuple(refusal.error for refusal in refused), feedback)

    def _invite(self) -> None:
        """In lockstep, let those who come later see what there is, until the first command."""
        kinds = "blue commands", "yellow commands", "synchronous requests"
        if not any(self.counts[kind] for kind in kinds) and time.monotonic() - self._invited > INVITED_S:
            self._invited = time.monotonic()
            self.publisher.again()

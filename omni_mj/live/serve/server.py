"""The served pitch behind the sockets of the league's simulators, in real time or in lockstep with commands."""

import math
import selectors
import socket
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice
from typing import Any

from omni_control.errors import OmniError
from omni_mj.live.serve import control
from omni_mj.live.serve.cameras import CYCLES_PER_FRAME
from omni_mj.live.serve.commands import Refusal
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.serve.publisher import Pace, Publisher
from omni_mj.live.sockets import LOOPBACK, Address, Receiver, Stream, listen, reason
from omni_mj.live.wire import WireError, parse
from omni_mj.live.wire.simulation_pb2 import (
    RobotControl,
    RobotControlResponse,
    RobotFeedback,
    SimulatorCommand,
    SimulatorError,
    SimulatorResponse,
    SyncRequest,
    SyncResponse,
    Team,
)
from omni_mj.live.wire.vision_pb2 import Detection, Geometry
from omni_mj.scenarios.settings import CYCLE_RATE_HZ

MIN_SPAN_CYCLES = 4  # simulated at a time while nothing comes and nothing is due
BURST = 64  # datagrams read from one port before the others have their turn
REPEAT_S = 0.2  # in lockstep, between repetitions of the last images until the first command
CHECK_S = 0.1  # for which nothing else is looked after at most
MAX_SPEED = 1000.0  # simulated seconds per second
MAX_STEP_S = 10.0  # of a request in the synchronous mode
BOTH_TEAMS = {Team.BLUE, Team.YELLOW}


class Server:
    """Serves until it is told to stop.

    Args:
        pitch: What is served.
        ports: Of the simulator, the blue and the yellow robots; 0 takes a free one.
        vision: Where detections go.
        interface: Address of the network interface; loopback keeps everything on this computer.
        speed: Simulated seconds per second.
        lockstep: "" if time goes by itself; "any" if each packet to a team makes a step to the first camera's next
            image; "both" if a packet to each team does.

    Attributes:
        after_frame: Called after every 1/60 s of simulated time; set it before `run`.
        ports: That are listened to: control, blue, yellow.
        publisher: Of what cameras see.
        pace: Of simulated time.
        notes: What went wrong.
        counts: Of packets.

    Raises:
        OmniError: A port is taken, or there is no such interface.
    """

    def __init__(
        self,
        pitch: Pitch,
        ports: Sequence[int],
        vision: Address,
        interface: str = LOOPBACK,
        speed: float = 1.0,
        lockstep: str = "",
    ) -> None:
        self.pitch, self.lockstep, self.notes, self.pace = pitch, lockstep, pitch.notes, Pace(speed)
        self.after_frame: Callable[[], None] = lambda: None
        self.publisher = Publisher(pitch, vision, interface, self.pace)
        self.counts: Counter[str] = self.publisher.counts
        self._selector = selectors.DefaultSelector()
        self.ports = list[int]()
        try:
            for number, team in zip(ports, (None, Team.BLUE, Team.YELLOW), strict=True):
                port = Receiver(Address(interface, number), interface)
                self._register(port, self._answer, team)
                self.ports.append(port.address.port)
                if lockstep:
                    self._register(listen(port.address), self._accept, team)
        except BaseException:
            self.close()
            raise
        self._heard_teams, self._repeated_at, self._cycle_remainder = set[int](), -math.inf, 0.0

    def run(self, check: Callable[[], None] = lambda: None, until_s: float = math.inf) -> None:
        """Serve until simulated time is over, or `check`, which is called often, raises something."""
        pitch = self.pitch
        if not self.lockstep:  # in lockstep time stamps are the same in all runs
            pitch.epoch_s = time.time() - pitch.time_s
        self.pace.change(self.pace.speed, time.monotonic(), pitch.cycle)
        self.publisher.update()
        while pitch.time_s < until_s:
            check()
            if self.lockstep:
                self._wait(time.monotonic() + CHECK_S)
                self._repeat_until_first_command()
            else:
                self._simulate_due_cycles()

    def close(self) -> None:
        """Free the ports."""
        self.publisher.close()
        for key in list(self._selector.get_map().values()):
            key.fileobj.close()  # type: ignore[union-attr]
        self._selector.close()

    def _simulate_due_cycles(self) -> None:
        """Simulate what is due, then wait for packets until more is."""
        pitch, now = self.pitch, time.monotonic()
        due = self.pace.cycle_at(now)
        if self.pace.skip_delay(now, pitch.cycle):
            text = "this computer is too slow for this speed; simulated time falls behind"
            self.notes.add("too slow", text)
            due = pitch.cycle
        self._advance(min(due, pitch.cycle + CYCLES_PER_FRAME))
        # Half of what is left to the next packet at a time: few wakings, and little left when it is due.
        left = self.publisher.due - pitch.cycle
        wake = pitch.cycle + min(left, max(left // 2, MIN_SPAN_CYCLES))
        self._wait(min(self.pace.time_of(wake), now + CHECK_S))

    def _advance(self, until: int) -> list[Detection]:
        """Simulate up to a cycle. Return the detections that were sent meanwhile."""
        pitch, detections = self.pitch, list[Detection]()
        while pitch.cycle < until:
            frame_end = (pitch.cycle // CYCLES_PER_FRAME + 1) * CYCLES_PER_FRAME
            pitch.advance(max(int(min(until, frame_end, self.publisher.due)), pitch.cycle + 1))
            if self.publisher.due <= pitch.cycle:
                detections += self.publisher.update()
            if pitch.cycle % CYCLES_PER_FRAME == 0:
                self.after_frame()
        return detections

    def _wait(self, until: float) -> None:
        """Handle packets that come until then (`time.monotonic`). Return after the first ones."""
        for key, _ in self._selector.select(max(until - time.monotonic(), 0.0)):
            if not self.lockstep:  # what comes now acts in the cycle that begins next
                due = self.pace.cycle_at(time.monotonic())
                self._advance(min(due, self.pitch.cycle + CYCLES_PER_FRAME))
            key.data()

    def _register(self, port: Any, handle: Callable[[Any, int | None], None], team: int | None) -> None:
        """Call `handle` whenever something comes to a socket of a team, or, if it is None, of the simulator."""
        self._selector.register(port, selectors.EVENT_READ, partial(handle, port, team))

    def _answer(self, port: Receiver, team: int | None) -> None:
        """Obey and answer datagrams."""
        for data, _, client in islice(port.packets(), BURST):
            try:
                if team is None:
                    answer = SimulatorResponse(errors=self._obey_simulator(parse(SimulatorCommand, data)))
                    if self.lockstep:
                        self.publisher.repeat()
                else:
                    answer = self._command(team, parse(RobotControl, data))
                    self._step_after(team)
            except WireError as error:
                self.notes.add("bad packets", f"a packet from {client} is skipped: {error}")
                continue
            try:
                port.reply(answer.SerializeToString(), client)
            except OSError as error:
                self.notes.add("answers not sent", f"cannot answer {client}: {reason(error)}")

    def _step_after(self, team: int) -> None:
        """In lockstep, make a step if all teams that must have sent commands."""
        self._heard_teams.add(team)
        if self.lockstep == "any" or (self.lockstep and self._heard_teams == BOTH_TEAMS):
            self._heard_teams.clear()
            self._advance(self.pitch.next_leading_image)

    def _accept(self, listener: socket.socket, team: int | None) -> None:
        """Let a client of the synchronous mode in."""
        try:
            self._register(Stream(listener.accept()[0]), self._converse, team)
        except OSError as error:
            self.notes.add("clients lost", f"a client left before it was let in: {reason(error)}")

    def _converse(self, stream: Stream, team: int | None) -> None:
        """Answer a request of the synchronous mode. Hang up if it is malformed, or the client has gone."""
        try:
            stream.reply(self._answer_sync(team, stream.receive(SyncRequest)))
        except (WireError, OSError) as error:
            if isinstance(error, WireError):
                self.notes.add("bad packets", f"{stream.address} is hung up on: {error}")
            self._selector.unregister(stream)
            stream.close()

    def _answer_sync(self, team: int | None, request: SyncRequest) -> SyncResponse:
        self.counts["synchronous requests"] += 1
        answer, errors, cycles = RobotControlResponse(), list[SimulatorError](), 0
        if request.HasField("simulator_command"):
            errors += self._obey_simulator(request.simulator_command)
        if request.HasField("robot_control"):
            if team is None:
                errors.append(SimulatorError(code="NO_TEAM", message="commands to robots go to a team's port"))
            else:
                answer = self._command(team, request.robot_control)
        if 0 <= request.sim_step <= MAX_STEP_S:
            exact = request.sim_step * CYCLE_RATE_HZ + self._cycle_remainder
            cycles = round(exact)
            self._cycle_remainder = exact - cycles
        else:
            text = f"a step takes 0 to {MAX_STEP_S:g} s, not {request.sim_step:g}"
            errors.append(SimulatorError(code="STEP", message=text))
        answer.errors.extend(errors)
        return SyncResponse(detection=self._advance(self.pitch.cycle + cycles), robot_control_response=answer)

    def _obey_simulator(self, command: SimulatorCommand) -> list[SimulatorError]:
        """Obey a command to the simulator. Return what is refused."""
        self.counts["simulator commands"] += 1
        errors = list[SimulatorError]()
        handlers: dict[str, Callable[[Any], None]] = {
            "geometry": self._replace_geometry,
            "vision_port": self._send_vision_to,
            "teleport_ball": partial(control.teleport_ball, self.pitch),
            "simulation_speed": self._change_speed,
        }
        for field, value in command.config.ListFields() + command.control.ListFields():
            try:
                if field.name in control.REFUSED:
                    raise Refusal(*control.REFUSED[field.name])
                if field.name in handlers:
                    handlers[field.name](value)
            except Refusal as refusal:
                errors.append(refusal.error)
        return errors + control.teleport_robots(self.pitch, command.control.teleport_robot)

    def _replace_geometry(self, geometry: Geometry) -> None:
        try:
            self.pitch.resize(geometry.field)
        except OmniError as error:
            raise Refusal("GEOMETRY", str(error)) from None
        self.publisher.send_geometry()

    def _send_vision_to(self, port: int) -> None:
        if not 0 < port < 65_536:
            raise Refusal("VISION_PORT", f"ports are 1 to 65535, not {port}")
        self.publisher.to = self.publisher.to._replace(port=port)

    def _change_speed(self, speed: float) -> None:
        if not 0 <= speed <= MAX_SPEED:
            raise Refusal("SPEED", f"a simulation runs 0 to {MAX_SPEED:g} times as fast as time, not {speed:g}")
        if self.lockstep:
            raise Refusal("LOCKSTEP", "in lockstep, time goes by commands")
        self.pace.change(speed, time.monotonic(), self.pitch.cycle)

    def _command(self, team: int, commands: RobotControl) -> RobotControlResponse:
        """Pass commands on to robots."""
        self.counts[f"{Team.Name(team).lower()} commands"] += 1
        errors, commanded = self.pitch.command(team, commands.robot_commands)
        for error in errors:
            self.notes.add(f"refused: {error.code}", error.message)
        if any(command.kick_speed or command.dribbler_speed for command in commands.robot_commands):
            if not self.notes.counts["kicks"]:  # said once, to either side
                text = "robots here neither kick nor dribble; they only move"
                errors.append(SimulatorError(code="NO_KICK", message=text))
            self.notes.add("kicks", "kicks and dribblers are ignored: robots here only move")
        feedback = [RobotFeedback(id=number, dribbler_ball_contact=False) for number in commanded]
        return RobotControlResponse(errors=errors, feedback=feedback)

    def _repeat_until_first_command(self) -> None:
        """In lockstep, let clients that come later see the last images until the first command."""
        kinds = "blue commands", "yellow commands", "synchronous requests"
        if not any(self.counts[kind] for kind in kinds) and time.monotonic() - self._repeated_at > REPEAT_S:
            self._repeated_at = time.monotonic()
            self.publisher.repeat()

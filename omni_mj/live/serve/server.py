"""The served pitch behind the sockets of the league's simulators, in real time or in lockstep with commands."""

import math
import selectors
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import cast

from omni_mj.config.settings import CYCLE_RATE_HZ
from omni_mj.live.serve.detections import CYCLES_PER_FRAME, Image
from omni_mj.live.serve.served_world import Pitch
from omni_mj.live.serve.simulation_requests import Refusal
from omni_mj.live.sockets import LOOPBACK, Address, Receiver, reason, sender
from omni_mj.live.wire import WireError, parse
from omni_mj.live.wire.league_pb2 import (
    RobotControl,
    RobotControlResponse,
    RobotFeedback,
    SimulatorCommand,
    SimulatorError,
    SimulatorResponse,
    Team,
    VisionPacket,
)

SPAN_CYCLES = 4  # simulated at a time while nothing comes and nothing is due
CHECK_S = 0.1  # for which nothing else is looked after at most
EARLY_S = 1e-9  # by which rounding may have a packet leave
GEOMETRY_CYCLES = CYCLE_RATE_HZ  # from one packet of the geometry to the next
MAX_DELAY_S = 0.1  # of our time, by which the simulation may be late before it gives up catching up
MAX_SPEED = 1000.0  # simulated seconds per second
ASKED = "blue commands", "yellow commands"  # by which time goes in lockstep
# Of a field
FIXED = (
    "is that with which serve was started: see its options --robot, --scenario, --set and --vision"
)


class Server:
    """Serves until it is told to stop.

    Args:
        pitch: What is served.
        ports: Of the simulator, the blue and the yellow robots; 0 takes a free one.
        vision: Where detections go.
        interface: Address of the network interface; loopback keeps everything on this computer.
        speed: Simulated seconds per second; 0 pauses.
        lockstep: Whether time goes by commands: each packet to a team makes a step to the first
            camera's next image.

    Attributes:
        after_frame: Called after every 1/60 s of simulated time; set it before `run`.
        ports: That are listened to: control, blue, yellow.
        notes: Counts of packets, and what went wrong.

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
        lockstep: bool = False,
    ) -> None:
        self.pitch, self.notes, self.vision, self.lockstep = pitch, pitch.notes, vision, lockstep
        self.after_frame: Callable[[], None] = lambda: None
        self._geometry_due = 0
        self._outbox = list[Image]()
        self._newest = dict[int, bytes]()  # camera -> packet
        self.ports = list[int]()
        self._set_speed(speed)
        with ExitStack() as stack:
            self._selector = stack.enter_context(selectors.DefaultSelector())
            self._socket = stack.enter_context(sender(interface))
            for number, team in zip(ports, (None, Team.BLUE, Team.YELLOW), strict=True):
                port = stack.enter_context(Receiver(Address(interface, number), interface))
                self._selector.register(port, selectors.EVENT_READ, team)
                self.ports.append(port.address.port)
            self._stack = stack.pop_all()

    def run(self, check: Callable[[], None] = lambda: None, until_s: float = math.inf) -> None:
        """Serve until simulated time is over, or `check`, which is called often, raises something."""
        pitch = self.pitch
        if not self.lockstep:  # in lockstep time stamps are the same in all runs
            pitch.epoch_s = time.time() - pitch.time_s
        self._set_speed(self.speed)
        self._publish()
        while pitch.time_s < until_s:
            check()
            if not self.lockstep:
                self._simulate_due_cycles()
            elif not self._handle_requests(CHECK_S) and not any(self.notes[kind] for kind in ASKED):
                # Clients that come later see the last images until the first command
                self._repeat()

    def close(self) -> None:
        """Free the ports."""
        self._stack.close()

    def _set_speed(self, speed: float) -> None:
        """Go on at a speed from now."""
        self.speed, self._started = speed, (time.monotonic(), self.pitch.cycle)

    def _time_of(self, cycle: int) -> float:
        """Return when a cycle is due (`time.monotonic`), s; infinity during a pause."""
        time_s, first_cycle = self._started
        return (
            time_s + (cycle - first_cycle) / (self.speed * CYCLE_RATE_HZ)
            if self.speed
            else math.inf
        )

    def _simulate_due_cycles(self) -> None:
        """Simulate what is due, then wait for packets until more is."""
        pitch, delay = self.pitch, time.monotonic() - self._time_of(self.pitch.cycle)
        if delay > MAX_DELAY_S:
            self.notes.add(
                "too slow", "this computer is too slow for this speed; simulated time falls behind"
            )
            self.notes["ms behind"] += round(1e3 * delay)
            self._set_speed(self.speed)
        self._catch_up()
        due = min(camera.due for camera in pitch.cameras)
        if self._outbox:
            due = min(due, math.ceil(self._outbox[0].sent_s * CYCLE_RATE_HZ - 1e-6))
        wake_s = self._time_of(max(min(due, pitch.cycle + SPAN_CYCLES), pitch.cycle + 1))
        self._handle_requests(min(wake_s - time.monotonic(), CHECK_S))

    def _catch_up(self) -> None:
        """Simulate the cycles that are due, at most a frame of them."""
        time_s, first_cycle = self._started
        due = first_cycle + math.floor((time.monotonic() - time_s) * self.speed * CYCLE_RATE_HZ)
        self._advance(min(due, self.pitch.cycle + CYCLES_PER_FRAME))

    def _advance(self, until: int) -> None:
        """Simulate up to a cycle, and send what is due meanwhile."""
        pitch = self.pitch
        while pitch.cycle < until:
            pitch.advance()
            self._publish()
            if pitch.cycle % CYCLES_PER_FRAME == 0:
                self.after_frame()

    def _publish(self) -> None:
        """Take the images that are due and send what is due."""
        for image in self.pitch.take_images():
            if math.isfinite(image.sent_s):
                self._outbox.append(image)
                self._outbox.sort(key=lambda image: image.sent_s)
        while self._outbox and self._outbox[0].sent_s <= self.pitch.time_s + EARLY_S:
            image = self._outbox.pop(0)
            self.pitch.publish(image)
            packet = VisionPacket(detection=image.detection).SerializeToString()
            self._newest[image.detection.camera_id] = packet
            self._send(packet)
        if self.pitch.cycle >= self._geometry_due:
            self._geometry_due = self.pitch.cycle + GEOMETRY_CYCLES
            self._send(VisionPacket(geometry=self.pitch.geometry()).SerializeToString())

    def _repeat(self) -> None:
        """Send the geometry and the last detection of each camera once more."""
        self._send(VisionPacket(geometry=self.pitch.geometry()).SerializeToString())
        for packet in self._newest.values():
            self._send(packet)

    def _send(self, packet: bytes) -> None:
        try:
            self._socket.sendto(packet, self.vision)
            self.notes["vision packets sent"] += 1
        except OSError as error:
            self.notes.add("vision not sent", f"cannot send to {self.vision}: {reason(error)}")

    def _handle_requests(self, seconds: float) -> bool:
        """Handle packets that come within some seconds. Return whether any came."""
        events = self._selector.select(max(seconds, 0.0))
        for key, _ in events:
            if not self.lockstep:  # what comes now acts in the cycle that begins next
                self._catch_up()
            self._answer(cast(Receiver, key.fileobj), key.data)
        return bool(events)

    def _answer(self, port: Receiver, team: int | None) -> None:
        """Obey and answer datagrams to a team, or, if it is None, to the simulator."""
        for data, _, client in port.packets():
            try:
                if team is None:
                    answer = SimulatorResponse(errors=self._obey(parse(SimulatorCommand, data)))
                    if self.lockstep:
                        self._repeat()
                else:
                    answer = self._command(team, parse(RobotControl, data))
                    if self.lockstep:
                        self._advance(self.pitch.cameras[0].due)
                port.sendto(answer.SerializeToString(), client)
            except WireError as error:
                self.notes.add("bad packets", f"a packet from {client} is skipped: {error}")
            except OSError as error:
                self.notes.add("answers not sent", f"cannot answer {client}: {reason(error)}")

    def _obey(self, command: SimulatorCommand) -> list[SimulatorError]:
        """Obey a command to the simulator. Return what is refused."""
        self.notes["simulator commands"] += 1
        errors = self.pitch.teleport(command.control)
        errors += [
            Refusal("CONFIG", f"{field.name} {FIXED}").error
            for field, _ in command.config.ListFields()
        ]
        if command.control.HasField("simulation_speed"):
            speed = command.control.simulation_speed
            if not self.lockstep and 0 <= speed <= MAX_SPEED:
                self._set_speed(speed)
            else:
                reason = f"outside of lockstep, time goes 0 to {MAX_SPEED:g} times as fast as it does, not {speed:g}"
                errors.append(Refusal("SPEED", reason).error)
        return errors

    def _command(self, team: int, commands: RobotControl) -> RobotControlResponse:
        """Pass commands on to robots."""
        self.notes[f"{Team.Name(team).lower()} commands"] += 1
        errors, commanded = self.pitch.command(team, commands.robot_commands)
        for error in errors:
            self.notes.add(f"refused: {error.code}", error.message)
        if any(command.kick_speed or command.dribbler_speed for command in commands.robot_commands):
            self.notes.add("kicks", "robots here neither kick nor dribble; they only move")
        feedback = [RobotFeedback(id=number, dribbler_ball_contact=False) for number in commanded]
        return RobotControlResponse(errors=errors, feedback=feedback)

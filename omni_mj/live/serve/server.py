"""Network server of `serve`: a simulated world behind the league's protocols."""

import math
import re
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack

from omni_mj.config import CYCLE_RATE_HZ, CYCLES_PER_FRAME
from omni_mj.live.serve.detections import Image
from omni_mj.live.serve.inbox import Inbox, Request
from omni_mj.live.serve.served_world import ServedWorld
from omni_mj.live.serve.simulation_requests import (
    MAX_COMMANDS,
    Refusal,
    find_unknown_fields,
)
from omni_mj.live.sockets import LOOPBACK, Address, Receiver, error_reason, open_sender
from omni_mj.live.wire import WireError, parse_message
from omni_mj.live.wire.league_pb2 import (
    RobotControl,
    RobotControlResponse,
    SimulatorCommand,
    SimulatorError,
    SimulatorResponse,
    Team,
    VisionPacket,
)

SPAN_CYCLES = 4  # largest number of cycles simulated at a time while no packet arrives
CHECK_S = 0.1  # longest time between two checks for a stop request
HANDLE_S = 0.002  # time for packets before the simulation goes on, although it is late
EARLY_S = 1e-9  # tolerance for rounding errors of the time at which a packet is due
GEOMETRY_CYCLES = CYCLE_RATE_HZ  # between two packets with the geometry
MAX_START_S = 10.0  # simulated time in which all robots are seen before the first step in lockstep
MAX_DELAY_S = 0.1  # delay after which the simulation no longer tries to catch up
MAX_SPEED = 1000.0  # simulated seconds per second
COMMAND_KINDS = "blue commands", "yellow commands"  # messages that advance time in lockstep
# Refusals that differ in them only are about one topic, which is printed once.
TEAM_OR_NUMBER = re.compile(r"blue|yellow|[-+]?\d[\d.e+-]*")


class Server:
    """Serves a simulated world, in real time or in lockstep with commands.

    Args:
        world: The world to serve.
        ports: Ports of the simulator, the blue and the yellow robots; 0 is any free port.
        vision: Address to which detections are sent.
        interface: Address of the network interface. Loopback keeps packets on this computer.
        speed: Simulated seconds per second; 0 pauses.
        lockstep: Whether each command packet advances time until the first camera sends an image.

    Attributes:
        after_frame: Called after every 1/60 s of simulated time; set it before `run`.
        ports: Ports on which it listens: simulator, blue, yellow.
        messages: Counts of packets and problems.

    Raises:
        OmniError: A port is taken, or there is no such interface.
    """

    def __init__(
        self,
        world: ServedWorld,
        ports: Sequence[int],
        vision: Address,
        interface: str = LOOPBACK,
        speed: float = 1.0,
        lockstep: bool = False,
    ) -> None:
        self.world, self.messages = world, world.messages
        self.vision, self.lockstep = vision, lockstep
        self.after_frame: Callable[[], None] = lambda: None
        self._geometry_due = 0
        self._outbox = list[Image]()
        self._newest = dict[int, bytes]()  # camera -> packet
        self._is_started = False  # nothing is sent before
        self._set_speed(speed)
        with ExitStack() as stack:
            self._socket = stack.enter_context(open_sender(interface))
            self._receivers = dict[int | None, Receiver]()
            teams = None, Team.BLUE, Team.YELLOW
            # Given ports come first, so that no free port is one of them.
            for number, team in sorted(
                zip(ports, teams, strict=True), key=lambda port: port[0] == 0
            ):
                port = stack.enter_context(Receiver(Address(interface, number), interface))
                self._receivers[team] = port
            self.ports = [self._receivers[team].address.port for team in teams]
            self._inbox = Inbox(self._receivers, self.messages)
            stack.callback(self._inbox.close)
            self._stack = stack.pop_all()

    def run(self, check: Callable[[], None] = lambda: None, until_s: float = math.inf) -> None:
        """Serve until a simulated time, or until `check`, which is called often, raises."""
        world = self.world
        if not self.lockstep:  # in lockstep, time stamps are the same in all runs
            world.epoch_s = time.time() - world.time_s
        self._set_speed(self.speed)
        self._is_started = not self.lockstep
        self._publish()
        while not self._is_started and world.time_s < MAX_START_S:
            check()
            if len(self._newest) == len(world.cameras) and world.all_seen:
                break
            self._advance(world.cycle + 1)
        if not self._is_started:
            self._is_started = True
            self._repeat()
        while world.time_s < until_s:
            check()
            if not self.lockstep:
                self._simulate_due_cycles()
            elif not self._handle_requests(CHECK_S) and not any(
                self.messages[kind] for kind in COMMAND_KINDS
            ):
                self._repeat()  # for clients that connect late

    def close(self) -> None:
        """Free the ports."""
        self._stack.close()

    def _set_speed(self, speed: float, now: float | None = None) -> None:
        """Continue at another speed, and relate simulated time to real time anew.

        Args:
            speed: Simulated seconds per second.
            now: The reading of the clock for it, s (`time.monotonic`). Default: a new one.
        """
        now = time.monotonic() if now is None else now
        self.speed, self._started = speed, (now, self.world.cycle)

    def _time_of(self, cycle: int) -> float:
        """Return the time at which a cycle is due (`time.monotonic`), s; infinity in a pause."""
        time_s, first_cycle = self._started
        return (
            time_s + (cycle - first_cycle) / (self.speed * CYCLE_RATE_HZ)
            if self.speed
            else math.inf
        )

    def _simulate_due_cycles(self) -> None:
        """Simulate the cycles that are due, then handle packets until the next cycle is due."""
        world, now = self.world, time.monotonic()
        delay = now - self._time_of(world.cycle)
        if delay > MAX_DELAY_S:
            self.messages.add(
                "times too slow",
                "this computer is too slow; simulated time falls behind",
            )
            self.messages["ms late in all"] += round(1e3 * delay)
            world.epoch_s += delay * self.speed  # time stamps go on with the clock
            self._set_speed(self.speed, now)
        self._catch_up()
        due = min(camera.due for camera in world.cameras)
        if self._outbox:
            due = min(due, math.ceil(self._outbox[0].sent_s * CYCLE_RATE_HZ - 1e-6))
        wake_s = self._time_of(max(min(due, world.cycle + SPAN_CYCLES), world.cycle + 1))
        self._handle_requests(min(wake_s - time.monotonic(), CHECK_S))

    def _catch_up(self) -> None:
        """Simulate the cycles that are due, at most one frame."""
        time_s, first_cycle = self._started
        due = first_cycle + math.floor((time.monotonic() - time_s) * self.speed * CYCLE_RATE_HZ)
        self._advance(min(due, self.world.cycle + CYCLES_PER_FRAME))

    def _advance(self, until: int) -> None:
        """Simulate up to a cycle, and send images when they are due."""
        world = self.world
        while world.cycle < until:
            world.advance()
            self._publish()
            if world.cycle % CYCLES_PER_FRAME == 0:
                self.after_frame()

    def _publish(self) -> None:
        """Take the images that are due, and send the ones whose sending time has come."""
        self._outbox += [image for image in self.world.take_images() if image.sent_s < math.inf]
        self._outbox.sort(key=lambda image: image.sent_s)
        due = dict[int, Image]()  # one of each camera
        for image in self._outbox:
            if image.sent_s <= self.world.time_s + EARLY_S:
                due.setdefault(image.detection.camera_id, image)
        self._outbox = [
            image for image in self._outbox if image is not due.get(image.detection.camera_id)
        ]
        # The first camera is the last one, because its image ends a step in lockstep.
        for camera in sorted(due, reverse=True):
            image = due[camera]
            self.world.publish(image)
            self._newest[camera] = VisionPacket(detection=image.detection).SerializeToString()
            self._send(self._newest[camera])
        if self.world.cycle >= self._geometry_due:
            self._geometry_due = self.world.cycle + GEOMETRY_CYCLES
            self._send(VisionPacket(geometry=self.world.geometry()).SerializeToString())

    def _repeat(self) -> None:
        """Send the geometry and the newest detection of each camera again."""
        self._send(VisionPacket(geometry=self.world.geometry()).SerializeToString())
        for packet in self._newest.values():
            self._send(packet)

    def _send(self, packet: bytes) -> None:
        if not self._is_started:
            return
        try:
            self._socket.sendto(packet, self.vision)
            self.messages["vision packets sent"] += 1
        except OSError as error:
            self.messages.add(
                "vision not sent", f"cannot send to {self.vision}: {error_reason(error)}"
            )

    def _handle_requests(self, seconds: float) -> bool:
        """Handle packets that arrive within some seconds, and return whether any arrived."""
        self._inbox.receive(seconds)
        request = self._inbox.take()
        if request is None:
            return False
        if not self.lockstep:  # a command acts from the next cycle on
            self._catch_up()
        until = time.monotonic() + max(seconds, HANDLE_S)
        while request is not None:
            self._handle(request)
            request = self._inbox.take() if time.monotonic() < until else None
        return True

    def _handle(self, request: Request) -> None:
        """Handle and answer a packet."""
        team, client, data = request
        try:
            response = (
                self._control_simulator(parse_message(SimulatorCommand, data))
                if team is None
                else self._command(team, parse_message(RobotControl, data))
            )
            for error in response.errors:
                topic = TEAM_OR_NUMBER.sub("", error.message)
                self.messages.add(f"refused: {error.code}", f"{client}: {error.message}", topic)
            if self.lockstep and team is None:
                self._repeat()
            elif self.lockstep:
                image = self._newest.get(0)
                while self._newest.get(0) is image:
                    self._advance(self.world.cycle + 1)
            self._receivers[team].sendto(response.SerializeToString(), client)
        except WireError as error:
            self.messages.add("bad packets", f"skipped a packet from {client}: {error}")
        except OSError as error:
            self.messages.add("answers not sent", f"cannot answer {client}: {error_reason(error)}")

    def _control_simulator(self, command: SimulatorCommand) -> SimulatorResponse:
        """Execute a command to the simulator, and return errors for its refused parts."""
        self.messages["simulator commands"] += 1
        control, config = command.control, command.config
        errors = find_unknown_fields(command)
        if error := _check_length(control.teleport_robot, config.robot_specs):
            return SimulatorResponse(errors=[*errors, error])
        errors += self.world.teleport(control)
        errors += self.world.configure(config)
        if 0 < config.vision_port < 65_536:
            self.vision = self.vision._replace(port=config.vision_port)
        elif config.HasField("vision_port"):
            reason = f"vision_port must be 1 to 65535, got {config.vision_port}"
            errors.append(Refusal("CONFIG", reason).error)
        if control.HasField("simulation_speed"):
            speed = control.simulation_speed
            if not self.lockstep and 0 <= speed <= MAX_SPEED:
                if not speed and self.speed:
                    self.messages.add("pauses", "a client pauses the simulation (speed 0)")
                elif speed and not self.speed:
                    text = f"a client ends the pause; the speed is {speed:g} x real time"
                    self.messages.add("ends of pauses", text)
                self._set_speed(speed)
            else:
                reason = f"the speed must be 0 to {MAX_SPEED:g}, without lockstep, got {speed:g}"
                errors.append(Refusal("SPEED", reason).error)
        return SimulatorResponse(errors=errors)

    def _command(self, team: int, control: RobotControl) -> RobotControlResponse:
        """Pass commands to the robots of a team."""
        self.messages[f"{Team.Name(team).lower()} commands"] += 1
        errors, commands = find_unknown_fields(control), control.robot_commands
        if error := _check_length(commands):
            return RobotControlResponse(errors=[*errors, error])
        refusals, feedback = self.world.command(team, commands)
        if any(command.kick_speed or command.dribbler_speed for command in commands):
            self.messages.add("kicks", "kicker and dribbler are not simulated")
        return RobotControlResponse(errors=errors + refusals, feedback=feedback)


def _check_length(*lists: Sequence[object]) -> SimulatorError | None:
    """Return an error if a list of a packet has too many entries, else None."""
    length = max(map(len, lists))
    if length <= MAX_COMMANDS:
        return None
    reason = f"a packet may have at most {MAX_COMMANDS} commands of a kind, got {length}"
    return Refusal("TOO_MANY", reason).error

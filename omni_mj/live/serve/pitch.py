"""What `serve` simulates: robots of both teams on a field, a ball that lies there, and cameras above.

Time is counted in cycles of the wheel loops, 1/960 s. Cameras take images before a cycle begins. A command that comes
before a cycle acts in it, if there is no dead time.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.link.radio import Radio
from omni_mj.live.notes import Notes
from omni_mj.live.serve.cameras import CYCLES_PER_FRAME, FieldCamera, Image, RobotName
from omni_mj.live.serve.commands import (
    HEADING,
    IMAGE_CYCLE,
    Refusal,
    decode_packets,
    empty_packet,
    encode_packet,
)
from omni_mj.live.serve.field import areas, standard_field, surface
from omni_mj.live.serve.world import ServedWorld
from omni_mj.live.wire.simulation_pb2 import RobotCommand, SimulatorError, Team
from omni_mj.live.wire.vision_pb2 import FieldSize, Geometry
from omni_mj.scenarios.faults import of_robot
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import CYCLE_RATE_HZ
from omni_mj.worlds import build

MAX_ROBOTS = 12
CLEARANCE_M = 0.001  # by which hulls may touch
Placement = tuple[Array, Array]  # pose and twist in the world frame, shape (3,) each


class Pitch:
    """The field and everything on it.

    Args:
        scenarios: Team -> scenario of its robots. Settings of the cameras are those of the blue one.
        poses: Robots that stand on the field at the start -> pose, shape (3,); at most 12.
        notes: What people should know.

    Attributes:
        names: Of the robots, by their index in the world.
        rows: One per robot.
        world: What moves.
        cycle: Number of the next cycle.
        epoch_s: Time of a correct clock at simulated time 0, s; set it before the first image.
        size: Of the field.
        ball: Position, shape (2,), m.
        held: What robots hold of the radio.
        measured: Where cameras saw robots last, shape (n, 3). A recorder may reset it to NaN.

    Raises:
        OmniError: Robots cannot share a world, or start in each other or in a wall.
    """

    def __init__(
        self,
        scenarios: Mapping[int, Scenario],
        poses: Mapping[RobotName, Array],
        notes: Notes,
    ) -> None:
        self._scenarios, self.notes = scenarios, notes
        self.cycle, self.epoch_s = 0, 0.0
        self._headings = dict[RobotName, tuple[float, int]]()  # that vision saw last, and the cycles of the images
        self.size, self.ball = standard_field(), np.zeros(2)
        self._reach = {team: build.world(scenario.settings).reach for team, scenario in scenarios.items()}
        self._cameras = list[FieldCamera]()
        self._build(poses)
        self._vision = self.rows[0].settings.vision
        self._cameras += [FieldCamera(number, self.rows) for number in range(self._vision.cameras)]
        self._areas = areas(len(self._cameras), surface(self.size), self._vision.overlap_m)
        for name, obstacle in self._find_obstacles({name: (pose, np.zeros(3)) for name, pose in poses.items()}).items():
            raise OmniError(f"{label(name)} starts in {obstacle}")

    @property
    def time_s(self) -> float:
        """Simulated time, s."""
        return self.cycle / CYCLE_RATE_HZ

    @property
    def next_image(self) -> int:
        """Cycle of the next image of any camera."""
        return min(camera.due for camera in self._cameras)

    @property
    def next_leading_image(self) -> int:
        """Cycle of the next image of the first camera."""
        return self._cameras[0].due

    def take_images(self) -> list[Image]:
        """Return the images that are due."""
        images = []
        for camera, area in zip(self._cameras, self._areas, strict=True):
            if camera.due <= self.cycle:
                poses = np.where(self.world.present[:, None], self.world.pose(), np.nan)
                image = camera.take_image(self.cycle, self.names, poses, self.ball, area, self.epoch_s)
                np.copyto(self.measured, image.poses, where=~np.isnan(image.poses))
                images.append(image)
        return images

    def publish(self, image: Image) -> None:
        """Let teams know an image: they send the headings in it along with commands."""
        for name, heading in zip(image.names, image.poses[:, 2].tolist(), strict=True):
            if not math.isnan(heading) and image.cycle >= self._headings.get(name, (heading, 0))[1]:
                self._headings[name] = heading, image.cycle

    def advance(self, until: int) -> None:
        """Advance to a cycle, in spans that end where a packet arrives or a frame ends."""
        radio, world = self._radio, self.world
        while self.cycle < until:
            arrived, n_delivered = None, 0
            if not radio.quiet:
                packets, is_new, _ = radio.deliver()
                n_delivered = 1
                if is_new.any():
                    compared_at = self.cycle + world.cycles_left % CYCLES_PER_FRAME
                    self.held = arrived = decode_packets(packets, is_new, compared_at)
            count = min(n_delivered + radio.quiet, until - self.cycle, world.cycles_left)
            radio.wait(count - n_delivered)
            if world.cycles_left == CYCLES_PER_FRAME:
                self._last_poses = self.poses()
            for robot, cause in world.advance(count, arrived).items():
                self.notes.add("robot failed", f"{label(self.names[robot])} {cause} at {self.time_s:.3f} s")
            self.cycle += count
            if world.is_unstable:
                self._build(self._last_poses)
                radio, world = self._radio, self.world

    def command(self, team: int, commands: Sequence[RobotCommand]) -> tuple[list[SimulatorError], list[int]]:
        """Send commands to robots of a team.

        Returns:
            Errors, and the numbers of the team's robots that were commanded.
        """
        errors, commanded, receivers = list[SimulatorError](), list[int](), set[int]()
        packets, present = self._packets.copy(), self.poses()
        for command in commands:
            name = team, command.id
            try:
                if name not in present:
                    numbers = (
                        ", ".join(map(str, sorted(number for other, number in present if other == team))) or "none"
                    )
                    raise Refusal("UNKNOWN_ROBOT", f"there is no {label(name)} on the field; there: {numbers}")
                commanded.append(command.id)
                robot = self.names.index(name)
                packet = encode_packet(command, self.world.wheels[robot])
            except Refusal as refusal:
                errors.append(refusal.error)
                continue
            if packet is not None:
                packet[HEADING], packet[IMAGE_CYCLE] = self._headings.get(name, (math.nan, 0))
                packets[robot, : len(packet)] = packet
                receivers.add(robot)
        if receivers:
            self._radio.send(packets, np.array(sorted(receivers)))
        return errors, commanded

    def poses(self) -> dict[RobotName, Array]:
        """Return the poses, shape (3,), of the robots on the field."""
        robots = zip(self.names, self.world.pose(), self.world.present, strict=True)
        return {name: pose for name, pose, is_present in robots if is_present}

    def place(self, placements: Mapping[RobotName, Placement], leaving: set[RobotName]) -> list[SimulatorError]:
        """Put robots down and take others away. What is impossible is refused.

        A robot that the world has no body for makes the world anew without bodies of absent robots. All robots then go
        on from where they are, at rest, as fresh as at the start of a run.
        """
        for name in leaving & set(self.names):
            squad, i = self.world.squad_of[self.names.index(name)]
            squad.remove(i)
        placements, errors = dict(placements), list[SimulatorError]()
        while obstacles := self._find_obstacles(placements):  # a refused robot stays, perhaps in the way of another
            for name, obstacle in obstacles.items():
                errors.append(Refusal("OCCUPIED", f"{label(name)} would stand in {obstacle}").error)
                del placements[name]
        poses = self.poses() | {name: pose for name, (pose, _) in placements.items()}
        for name in list(poses)[MAX_ROBOTS:]:
            reason = f"{label(name)} would be robot {MAX_ROBOTS + 1}; a world has {MAX_ROBOTS}"
            errors.append(Refusal("TOO_MANY", reason).error)
            del placements[name], poses[name]
        if not placements.keys() <= set(self.names):
            self._build(poses)
        for name, (pose, twist) in placements.items():
            squad, i = self.world.squad_of[self.names.index(name)]
            squad.place(i, pose, twist)
            self._headings[name] = float(pose[2]), self.cycle
        return errors

    def resize(self, size: FieldSize) -> None:
        """Replace the field.

        Raises:
            OmniError: There is no such field, or a robot would stand in its walls.
        """
        walls = surface(size)
        for name, pose in self.poses().items():
            if (np.abs(pose[:2]) > walls / 2 - self._reach[name[0]]).any():
                raise OmniError(f"{label(name)} would stand in a wall of a field of {walls[0]:g} x {walls[1]:g} m")
        self.size = size
        self.world.move_walls(walls)
        self._areas = areas(len(self._cameras), walls, self._vision.overlap_m)

    def geometry(self) -> Geometry:
        """Return what SSL-Vision says of field and cameras."""
        return Geometry(field=self.size, calib=[area.calibration(number) for number, area in enumerate(self._areas)])

    def _find_obstacles(self, placements: Mapping[RobotName, Placement]) -> dict[RobotName, str]:
        """Return what robots would stand in if all were placed."""
        poses = self.poses() | {name: pose for name, (pose, _) in placements.items()}
        names, room = list(poses), surface(self.size) / 2
        reach, positions = np.array([self._reach[team] for team, _ in names]), np.array([*poses.values()])
        obstacles = {}
        for name in placements:
            robot = names.index(name)
            distance = np.hypot(*(positions - positions[robot]).T[:2])
            distance[robot] = np.inf
            if (np.abs(positions[robot, :2]) > room - reach[robot] + CLEARANCE_M).any():
                obstacles[name] = f"a wall: the field ends at |x| = {room[0]:g} m and |y| = {room[1]:g} m"
            elif (distance < reach[robot] + reach - CLEARANCE_M).any():
                obstacles[name] = f"a robot that is {distance.min():.3f} m away"
        return obstacles

    def _build(self, poses: Mapping[RobotName, Array]) -> None:
        """Make the world anew with these robots, at rest."""
        self.names = list(poses)
        self.rows = [self._row(place, name) for place, name in enumerate(self.names)]
        self.world = ServedWorld(self.rows, np.array([*poses.values()]), surface(self.size))
        n, packet = len(self.rows), empty_packet(max(self.world.wheels))
        self._packets = np.tile(packet, (n, 1))
        self._radio = Radio(
            [row.settings.radio for row in self.rows],
            [row.noise_seed for row in self.rows],
            [row.faults for row in self.rows],
            CYCLES_PER_FRAME,
            packet,
        )
        self.held = decode_packets(self._packets, np.zeros(n, bool), 0)
        self.measured = np.full((n, 3), np.nan)
        for camera in self._cameras:
            camera.set_robots(self.rows)

    def _row(self, place: int, name: RobotName) -> Row:
        team, number = name
        scenario = self._scenarios[team]
        faults = [fault.replace(robots=()) for fault in of_robot(scenario.settings.fault, number)]
        settings = scenario.settings.replace(fault=faults) if scenario.settings.fault else scenario.settings
        return Row(0, place, Team.Name(team).lower(), scenario.seed, settings, scenario.robot)


def label(name: RobotName) -> str:
    """Return what a robot is called in messages."""
    return f"{Team.Name(name[0]).lower()} {name[1]}"

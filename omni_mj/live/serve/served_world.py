"""World of `serve`: robots of both teams on a field, a ball at rest, and cameras above.

Time is counted in cycles of the wheel loops, 1/960 s. Cameras take images before a cycle begins.
Without dead time, a command acts in the first cycle that begins after its arrival.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, world_to_body
from omni_mj.config import CYCLE_RATE_HZ, CYCLES_PER_FRAME
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario
from omni_mj.config.world_settings import WorldSettings
from omni_mj.live.serve.detections import (
    BALL_RADIUS_M,
    FieldCamera,
    Image,
    RobotName,
    describe_field,
)
from omni_mj.live.serve.served_planar import ServedPlanar
from omni_mj.live.serve.served_plant import ServedPlant
from omni_mj.live.serve.simulation_requests import (
    HEADING,
    IMAGE_CYCLE,
    WHEELS,
    Placement,
    Refusal,
    decode_packets,
    empty_packet,
    encode_packet,
    list_ignored_options,
    read_ball,
    read_teleport,
    robot_label,
)
from omni_mj.live.serve.simulator_config import (
    RobotLimit,
    read_field,
    read_realism,
    read_specs,
)
from omni_mj.live.sockets import MessageCounter
from omni_mj.live.wire.league_pb2 import (
    FieldSize,
    Geometry,
    RobotCommand,
    RobotFeedback,
    SimulatorConfig,
    SimulatorControl,
    SimulatorError,
    Team,
)
from omni_mj.mjcf import world_builder
from omni_mj.network.radio import Radio

PLANTS: dict[str, type[ServedPlant | ServedPlanar]] = {
    "mujoco": ServedPlant,
    "planar": ServedPlanar,
}
MAX_ROBOTS = {"mujoco": 12, "planar": 22}
CLEARANCE_M = 0.001  # allowed overlap of hulls
# Half the width of the dribbler, and how far from it a ball is still in contact.
DRIBBLER_HALF_WIDTH_M, CONTACT_M = 0.035, 0.005


class ServedWorld:
    """The field and everything on it.

    Args:
        scenario: Settings of the robots of both teams, the radio and the cameras.
        poses: Robot name -> start pose, shape (3,), m and rad.
        messages: Counts problems, and reports the first of each kind.

    Attributes:
        names: Names of the robots, in the order of their slots.
        rows: One per robot.
        plant: The simulated robots.
        cameras: The cameras above the field.
        cycle: Number of the next cycle.
        epoch_s: Time of a correct clock at simulated time 0, s; set it before the first image.
        ball: Position of the ball, shape (2,), m.
        applied: Commands that the robots currently apply.
        measured: Newest measured poses, lost images included, shape (n, 3). A recorder may reset
            it to NaN.

    Raises:
        OmniError: A robot starts in another robot or in a wall.
    """

    def __init__(
        self, scenario: Scenario, poses: Mapping[RobotName, Array], messages: MessageCounter
    ) -> None:
        self._scenario, self.messages = scenario, messages
        self.cycle, self.epoch_s, self.ball = 0, 0.0, np.zeros(2)
        # Newest published headings, and the cycles of their images.
        self._headings = dict[RobotName, tuple[float, int]]()
        self._parked = dict[RobotName, Array]()  # poses of robots beyond the walls
        self._limits = dict[RobotName, RobotLimit]()
        self._field_size = describe_field(scenario.settings.world)
        self._has_old_walls = False  # until a robot is placed: the field changed without robots
        self._reach = world_builder.build_world(scenario.settings).hull_radius
        self.cameras = list[FieldCamera]()
        for name in poses:
            if obstacle := self._find_obstacle(name, poses):
                raise OmniError(f"{robot_label(name)} starts in {obstacle}")
        self._build(poses)
        self.cameras += [
            FieldCamera(number, self.rows) for number in range(scenario.settings.vision.cameras)
        ]

    @property
    def plant_name(self) -> str:
        """Name of the plant."""
        return self._scenario.plant

    @property
    def time_s(self) -> float:
        """Simulated time, s."""
        return self.cycle / CYCLE_RATE_HZ

    @property
    def all_seen(self) -> bool:
        """Whether images of all robots on the field were sent."""
        return self.poses().keys() <= self._headings.keys()

    def poses(self) -> dict[RobotName, Array]:
        """Return the poses, shape (3,), of the robots on the field."""
        robots = zip(self.names, self.plant.pose(), self.plant.present, strict=True)
        return {name: pose for name, pose, is_present in robots if is_present}

    def geometry(self) -> Geometry:
        """Return the SSL-Vision message with the geometry of field and cameras."""
        return Geometry(
            field=self._field_size, calib=[camera.calibration() for camera in self.cameras]
        )

    def take_images(self) -> list[Image]:
        """Return the images that are due, and store their poses in `measured`."""
        images = []
        for camera in self.cameras:
            if camera.due <= self.cycle:
                poses = np.where(self.plant.present[:, None], self.plant.pose(), np.nan)
                image = camera.take_image(self.cycle, self.names, poses, self.ball, self.epoch_s)
                np.copyto(self.measured, image.poses, where=~np.isnan(image.poses))
                images.append(image)
        return images

    def publish(self, image: Image) -> None:
        """Store the measured headings of an image that is sent; later commands include them."""
        for name, heading in zip(image.names, image.poses[:, 2].tolist(), strict=True):
            if not math.isnan(heading) and image.cycle >= self._headings.get(name, (heading, 0))[1]:
                self._headings[name] = heading, image.cycle

    def advance(self) -> None:
        """Advance by a cycle.

        If the physics becomes unstable, the world is rebuilt from the poses at the beginning of the
        frame, with robots at rest.
        """
        received, plant = None, self.plant
        packets, is_new, _ = self._radio.deliver()
        if is_new.any():
            self.applied = received = decode_packets(
                packets, is_new, self.cycle + plant.cycles_left
            )
        if not plant.cycles_left:
            self._last_poses = self.poses()
        for robot, cause in plant.advance_cycles(1, received).items():
            self.messages.add(
                "robot failed", f"{robot_label(self.names[robot])} {cause} at {self.time_s:.3f} s"
            )
        self.cycle += 1
        if plant.is_unstable:
            self._build(self._last_poses)

    def command(
        self, team: int, commands: Iterable[RobotCommand]
    ) -> tuple[list[SimulatorError], list[RobotFeedback]]:
        """Send commands to robots of a team.

        Returns:
            Errors, and feedback from the team's robots that got a command, including refused ones
            and those without a velocity.
        """
        errors, feedback, receivers = list[SimulatorError](), list[RobotFeedback](), set[int]()
        packets, present = self._packets.copy(), self.poses()
        for command in commands:
            name = team, command.id
            try:
                if name not in present:
                    location = "is parked beyond the walls" if name in self._parked else "is absent"
                    raise Refusal("UNKNOWN_ROBOT", f"{robot_label(name)} {location}")
                touches_ball = self._touches_ball(name, present[name])
                feedback.append(RobotFeedback(id=command.id, dribbler_ball_contact=touches_ball))
                packet = encode_packet(command, packets.shape[1] - WHEELS)
                if packet is not None and name in self._limits:
                    self._limit_packet(packet, self._limits[name])
            except Refusal as refusal:
                errors.append(refusal.error)
                continue
            if packet is not None:
                packet[HEADING], packet[IMAGE_CYCLE] = self._headings.get(name, (math.nan, 0))
                robot = self.names.index(name)
                packets[robot] = packet
                receivers.add(robot)
        if receivers:
            self._radio.send(packets, np.array(sorted(receivers)))
        return errors, feedback

    def _touches_ball(self, name: RobotName, pose: Array) -> bool:
        """Return whether the ball touches the dribbler of a robot at a pose."""
        x, y = world_to_body([*(self.ball - pose[:2]), 0.0], pose[2])[:2]
        gap = x - self._limits.get(name, RobotLimit()).dribbler
        return bool(0 <= gap <= BALL_RADIUS_M + CONTACT_M and abs(y) <= DRIBBLER_HALF_WIDTH_M)

    def teleport(self, control: SimulatorControl) -> list[SimulatorError]:
        """Place the ball and robots, remove robots, and return errors for refused requests.

        If a new robot has no body in the world, the world is rebuilt with bodies of the present
        robots. They continue at rest from their poses, in the state of the start of a run.
        """
        errors, placements = list_ignored_options(control), dict[RobotName, Placement]()
        if control.HasField("teleport_ball"):
            try:
                self.ball = read_ball(control.teleport_ball, self.ball)
            except Refusal as refusal:
                errors.append(refusal.error)
        for teleport in control.teleport_robot:
            try:
                name, placement = read_teleport(teleport, self._parked | self.poses())
            except Refusal as refusal:
                errors.append(refusal.error)
                continue
            placements.pop(name, None)
            if placement is not None and not self._is_beyond_walls(placement[0]):
                placements[name] = placement
                continue
            self._parked.pop(name, None)
            if placement is not None:
                self._parked[name], twist = placement
                if twist.any():
                    reason = f"{robot_label(name)} is parked beyond the walls, at rest"
                    errors.append(Refusal("OPTION", reason).error)
            if name in self.names:
                self.plant.remove(self.names.index(name))
        refusals, poses = self._refuse_overlaps(placements)
        errors += refusals
        if placements and (self._has_old_walls or not placements.keys() <= set(self.names)):
            self._build(poses)
        for name, (pose, twist) in placements.items():
            self._parked.pop(name, None)
            self.plant.place_robot(self.names.index(name), pose, twist)
            self._headings[name] = float(pose[2]), self.cycle
        return errors

    def _refuse_overlaps(
        self, placements: dict[RobotName, Placement]
    ) -> tuple[list[SimulatorError], dict[RobotName, Array]]:
        """Remove placements in obstacles and of too many robots.

        Returns:
            Errors for the removed placements, and the poses of all robots after the others.
        """
        errors, present_poses = list[SimulatorError](), self.poses()
        max_robots = MAX_ROBOTS[self.plant_name]
        while True:  # a refused robot keeps its pose, which may block another one
            poses = present_poses | {name: pose for name, (pose, _) in placements.items()}
            refusals = {name: self._find_obstacle(name, poses) for name in placements}
            refused = {
                name: f"stand in {obstacle}" for name, obstacle in refusals.items() if obstacle
            }
            refused |= {
                name: f"be one of more than {max_robots} robots"
                for name in list(poses)[max_robots:]
            }
            if not refused:
                return errors, poses
            for name, reason in refused.items():
                errors.append(Refusal("OCCUPIED", f"{robot_label(name)} would {reason}").error)
                del placements[name]

    def _find_obstacle(self, name: RobotName, poses: Mapping[RobotName, Array]) -> str | None:
        """Return "a wall" or "a robot" if the named robot overlaps with one, else None."""
        if self._is_in_wall(poses[name], self._scenario.settings.world):
            return "a wall"
        distances = [
            math.dist(pose[:2], poses[name][:2])
            for other_name, pose in poses.items()
            if other_name != name
        ]
        return (
            "a robot" if min(distances, default=math.inf) < 2 * self._reach - CLEARANCE_M else None
        )

    def configure(self, config: SimulatorConfig) -> list[SimulatorError]:
        """Apply field, robot specs and realism, and return errors for what does not apply."""
        errors = list[SimulatorError]()
        if config.HasField("geometry"):
            try:
                self._change_field(config.geometry.field)
            except Refusal as refusal:
                errors.append(refusal.error)
        settings = self._scenario.settings
        for specs in config.robot_specs:
            try:
                name, self._limits[name], ignored = read_specs(specs, settings, self._limits)
            except Refusal as refusal:
                errors.append(refusal.error)
                continue
            if ignored:
                reason = f"of {robot_label(name)} these specs do not apply: {', '.join(ignored)}"
                errors.append(Refusal("SPECS", reason).error)
        for message in config.realism_config.custom:
            try:
                settings, unknown_fields = read_realism(message, settings)
                errors += unknown_fields
            except Refusal as refusal:
                errors.append(refusal.error)
        if settings != self._scenario.settings:
            self._scenario = self._scenario.replace(settings=settings)
            self._build_links()
        return errors

    def _limit_packet(self, packet: list[float], limit: RobotLimit) -> None:
        """Scale the velocities or rim speeds of a packet to the limits of the robot."""
        rim_speeds = np.array(packet[WHEELS:])
        kinematics = self._scenario.settings.wheels.kinematics
        is_velocity = np.isnan(rim_speeds).all()
        velocity = (
            np.array(packet[:3])
            if is_velocity
            else kinematics.body_twist(rim_speeds / kinematics.radius)
        )
        scale = limit.scale(velocity)
        packet[:3] = [scale * value for value in packet[:3]]
        packet[WHEELS:] = (scale * rim_speeds).tolist()

    def _change_field(self, size: FieldSize) -> None:
        """Change the field. Robots stay where they are, at rest.

        Raises:
            Refusal: The size is not allowed, or a robot would stand in a wall.
        """
        settings, poses = read_field(size, self._scenario.settings), self.poses()
        for name, pose in poses.items():
            if self._is_in_wall(pose, settings.world):
                length, width = settings.world.carpet_size_m
                size_text = f"with margins the field has {length:g} x {width:g} m"
                reason = f"{robot_label(name)} would stand in a wall; {size_text}"
                raise Refusal("GEOMETRY", reason)
        self._field_size = size
        if settings.world == self._scenario.settings.world:
            return
        self._scenario = self._scenario.replace(settings=settings)
        if poses:
            self._build(poses)
        else:
            self._build_links()
            self._has_old_walls = True

    def _is_in_wall(self, pose: Array, world: WorldSettings) -> bool:
        """Return whether a robot at a pose overlaps a wall or is beyond it."""
        limits = np.array(world.carpet_size_m) / 2 - self._reach + CLEARANCE_M
        return bool((np.abs(pose[:2]) > limits).any())

    def _is_beyond_walls(self, pose: Array) -> bool:
        """Return whether a robot at a pose is wholly on the other side of a wall."""
        carpet_size_m = np.array(self._scenario.settings.world.carpet_size_m)
        return bool((np.abs(pose[:2]) > carpet_size_m / 2 + self._reach).any())

    def _build(self, poses: Mapping[RobotName, Array]) -> None:
        """Build a world with robots at rest at these poses."""
        self.names, n, self._has_old_walls = list(poses), len(poses), False
        self._build_links()
        self.plant = PLANTS[self.plant_name](self.rows, np.array([*poses.values()]))
        self.applied = decode_packets(self._packets, np.zeros(n, bool), 0)
        self.measured = np.full((n, 3), np.nan)

    def _build_links(self) -> None:
        """Build the radio, without packets under way, and let the cameras start anew."""
        settings = self._scenario.settings
        self.rows = [self._row(slot, name) for slot, name in enumerate(self.names)]
        n, packet = len(self.rows), empty_packet(len(settings.wheels.azimuths_deg))
        self._packets = np.tile(packet, (n, 1))
        self._radio = Radio(
            [settings.radio] * n,
            [row.noise_seed for row in self.rows],
            [row.faults for row in self.rows],
            CYCLES_PER_FRAME,
            packet,
            jitters_by_tick=True,
        )
        for camera in self.cameras:
            camera.set_robots(self.rows, self.cycle)

    def _row(self, slot: int, name: RobotName) -> Row:
        team, number = name
        scenario = self._scenario
        faults = [
            fault.replace(robots=()) for fault in scenario.settings.fault if fault.affects(number)
        ]
        settings = scenario.settings.replace(fault=faults)
        return Row(0, slot, Team.Name(team).lower(), scenario.seed, settings, scenario.robot)

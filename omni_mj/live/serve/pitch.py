"""What `serve` simulates: the robots of both teams on a field, a ball that lies there, and the cameras above.

Time is counted in cycles of the wheel loops, 1/960 s. Cameras look before a cycle begins; a command that comes before a
cycle, and has no dead time, acts in it.
"""

import math
from collections.abc import Callable, Collection, Container, Sequence

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.link.radio import Radio
from omni_mj.live.serve.cameras import CYCLES, Eye, Image, Name, detection
from omni_mj.live.serve.commands import HEADING, IMAGE, Refusal, nothing, packet, received
from omni_mj.live.serve.field import areas, standard, surface
from omni_mj.live.serve.plant import ServedPlant
from omni_mj.live.wire.simulation import RobotCommand, Team
from omni_mj.live.wire.vision import Detection, FieldSize, Geometry
from omni_mj.scenarios.faults import of_robot
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import CYCLE_RATE_HZ
from omni_mj.worlds import build

MOST = 12  # robots in a world
ROBOT_HEIGHT_M = 0.15  # of the patterns that cameras see


class Pitch:
    """The field and all that is on it.

    Args:
        scenarios: of each team's robots; what concerns cameras is that of the blue one.
        names: robots that stand on the field at the start, with their poses (3,); at most 12.
        tell: called with a kind and words when something happens that people should know.

    Attributes:
        names: of the robots, in the order of their numbers.
        plant: what moves.
        cycle: number of the next cycle.
        due: cycle of the next image of any camera.
        size: of the field.
        ball: where it lies, (2,) m; None if there is none.
        held: what robots hold of the radio.
        measured: where cameras saw robots last, (n, 3); whoever records may forget it, by not a number.

    Raises:
        OmniError: robots that cannot share a world, or start in each other or in a wall.
    """

    def __init__(
        self,
        scenarios: dict[Team, Scenario],
        names: dict[Name, Array],
        tell: Callable[[str, str], None] = lambda kind, text: None,
    ) -> None:
        self._scenarios, self._tell = scenarios, tell
        self.size, self.cycle = standard(), 0
        self.ball: Array | None = np.zeros(2)
        self._vision = scenarios[Team.BLUE].settings.vision
        self._reach = {team: build.world(each.settings).reach for team, each in scenarios.items()}
        self.names = list(names)
        self.rows = self._rows()
        self._eyes = [Eye(number, self.rows) for number in range(self._vision.cameras)]
        self.due = min(eye.due for eye in self._eyes)
        self._build(list(names.values()))
        self._areas = areas(len(self._eyes), self.plant.surface, self._vision.overlap_m)
        places, reach = self.plant.pose()[:, :2], self.plant.reach
        wrong = [self.plant.overlap(robot, places, reach) for robot in range(len(self.names))]
        if any(wrong):
            robot = next(robot for robot, text in enumerate(wrong) if text)
            raise OmniError(f"{label(self.names[robot])} starts in {wrong[robot]}")

    @property
    def time_s(self) -> float:
        """Simulated time, s."""
        return self.cycle / CYCLE_RATE_HZ

    @property
    def first_due(self) -> int:
        """The cycle of the first camera's next image."""
        return self._eyes[0].due

    def look(self) -> list[Image]:
        """The images that are due."""
        images = []
        for eye, area in zip(self._eyes, self._areas, strict=True):
            if eye.due <= self.cycle:
                image = eye.look(self.cycle, self.names, self.plant.pose(), self.plant.present, self.ball, area)
                np.copyto(self.measured, image.poses, where=~np.isnan(image.poses[:, 2:]))
                images.append(image)
        self.due = min(eye.due for eye in self._eyes)
        return images

    def step(self) -> None:
        """Go on by a cycle."""
        self.advance(self.cycle + 1)

    def advance(self, until: int) -> None:
        """Go on up to a cycle: as many at a time as there are until one at which something arrives, or a frame ends."""
        radio, plant = self._radio, self.plant
        while self.cycle < until:
            arrived, quiet = None, radio.quiet
            if quiet:
                count = min(quiet, until - self.cycle, plant.left)
                radio.wait(count)
            else:
                packets, new, _ = radio.deliver()
                if new.any():
                    self.held = arrived = received(packets, new, self.cycle + plant.frame_in)
                count = min(1 + radio.quiet, until - self.cycle, plant.left)
                radio.wait(count - 1)
            if failed := plant.go(count, arrived):
                for robot, cause in failed.items():
                    self._tell("robot failed", f"{label(self.names[robot])} {cause} at {self.time_s:.3f} s")
            self.cycle += count

    def command(self, team: Team, commands: Sequence[RobotCommand]) -> tuple[list[Refusal], list[int]]:
        """Send commands to robots of a team; they act when the radio has brought them.

        Returns:
            What is refused, and the numbers of those robots of the team's that were commanded.
        """
        refused, commanded, to = list[Refusal](), list[int](), list[int]()
        packets, present = self._nothing.copy(), self.plant.present
        for command in commands:
            if (robot := self._find((team, command.id))) is None or not present[robot]:
                there = ", ".join(str(number) for number in self.numbers(team)) or "none"
                text = f"there is no {label((team, command.id))} on the field; there: {there}"
                refused.append(Refusal("UNKNOWN_ROBOT", text))
                continue
            commanded.append(command.id)
            sent = packet(command, self.plant.wheels[robot])
            if isinstance(sent, Refusal):
                refused.append(sent)
            elif sent is not None:
                sent[HEADING], sent[IMAGE] = self._seen[robot]
                packets[robot, : len(sent)] = sent
                to.append(robot)
        if to:
            self._radio.send(packets, np.array(sorted(set(to))))
        return refused, commanded

    def numbers(self, team: Team) -> list[int]:
        """The numbers of a team's robots on the field."""
        here = zip(self.names, self.plant.present, strict=True)
        return sorted(name[1] for name, present in here if present and name[0] == team)

    def place(self, wanted: dict[Name, tuple[Array, Array]], leaving: set[Name]) -> list[Refusal]:
        """Put robots down at poses with twists, (3,) each, and take others away; what cannot be is refused.

        A robot that was not there before makes the world anew if all bodies are in use: all then go on from where they
        are, at rest, with what a run begins with.
        """
        for name in leaving:
            if (robot := self._find(name)) is not None:
                self.plant.remove(robot)
        refused = []
        while wanted:
            blocked = self._blocked(wanted)
            refused += [Refusal("OCCUPIED", f"{label(name)} would stand in {why}") for name, why in blocked.items()]
            wanted = {name: put for name, put in wanted.items() if name not in blocked}
            if not blocked:
                break
        new, lent = list[Name](), False  # those without a body; whether one has the other team's
        for name in [name for name in wanted if self._find(name) is None]:
            if (body := self._free((name[0],), wanted)) is not None:
                self.names[body] = name
            elif len(self.names) + len(new) < MOST:
                new.append(name)
            elif (body := self._free(tuple(Team), wanted)) is not None:
                self.names[body], lent = name, True
            else:
                refused.append(Refusal("TOO_MANY", f"{label(name)} would be robot {MOST + 1}; a world has {MOST}"))
                del wanted[name]
        if new or lent:
            self._grow(new, wanted)
        for name, (pose, twist) in wanted.items():
            robot = self._find(name)
            assert robot is not None
            self.plant.place(robot, pose, twist)
            self._seen[robot] = float(pose[2]), self.cycle
        return refused

    def pose(self, name: Name) -> Array | None:
        """Where a robot is, (3,); None if it is not on the field."""
        robot = self._find(name)
        return None if robot is None or not self.plant.present[robot] else self.plant.pose()[robot]

    def resize(self, size: FieldSize) -> None:
        """Make the field another.

        Raises:
            OmniError: no such field can be, or a robot would stand in its walls.
        """
        walls = surface(size)
        plant = self.plant
        for name, pose, present, reach in zip(self.names, plant.pose(), plant.present, plant.reach, strict=True):
            if present and (np.abs(pose[:2]) > walls / 2 - reach).any():
                raise OmniError(f"{label(name)} would stand in a wall of a field of {walls[0]:g} x {walls[1]:g} m")
        self.size = size
        self.plant.move_walls(*walls)
        self._areas = areas(len(self._eyes), walls, self._vision.overlap_m)

    def geometry(self) -> Geometry:
        """What SSL-Vision says of field and cameras."""
        return Geometry(self.size, tuple(area.calibration(number) for number, area in enumerate(self._areas)))

    def detection(self, image: Image, clock: float) -> Detection:
        """What is sent now of an image, whose headings teams know from then on and send along with commands.

        Args:
            image: of a camera.
            clock: what clocks that are right show at the simulated time 0, s.
        """
        for robot, (name, heading) in enumerate(zip(image.names, image.poses[:, 2].tolist(), strict=True)):
            if not math.isnan(heading) and name == self.names[robot] and image.cycle >= self._seen[robot][1]:
                self._seen[robot] = heading, image.cycle
        offset = self._eyes[image.camera].clock_offset - image.behind
        return detection(image, self._areas[image.camera], clock + offset, ROBOT_HEIGHT_M)

    def _find(self, name: Name) -> int | None:
        try:
            return self.names.index(name)
        except ValueError:
            return None

    def _free(self, teams: Collection[Team], wanted: Container[Name]) -> int | None:
        """The body of a robot of these teams that is away, and stays away."""
        here = enumerate(zip(self.names, self.plant.present, strict=True))
        return next((i for i, (name, on) in here if not on and name[0] in teams and name not in wanted), None)

    def _blocked(self, wanted: dict[Name, tuple[Array, Array]]) -> dict[Name, str]:
        """Why some cannot stand where they are wanted, the others there as well."""
        names = [*self.names, *(name for name in wanted if name not in self.names)]
        places = np.full((len(names), 2), np.nan)
        places[: len(self.names)] = np.where(self.plant.present[:, None], self.plant.pose()[:, :2], np.nan)
        for name, (pose, _) in wanted.items():
            places[names.index(name)] = pose[:2]
        reach = np.array([self._reach[team] for team, _ in names])
        found = {name: self.plant.overlap(names.index(name), places, reach) for name in wanted}
        return {name: why for name, why in found.items() if why}

    def _grow(self, new: Sequence[Name], wanted: dict[Name, tuple[Array, Array]]) -> None:
        """Make the world anew with robots that it had no bodies for."""
        poses, present = list(self.plant.pose()), [*self.plant.present, *[True] * len(new)]
        self.names += new
        self.rows = self._rows()
        for eye in self._eyes:
            eye.watch(self.rows)
        self._build([*poses, *(wanted[name][0] for name in new)])
        self.plant.move_walls(*surface(self.size))
        for robot in np.flatnonzero(~np.array(present)):
            self.plant.remove(int(robot))

    def _build(self, poses: Sequence[Array]) -> None:
        self.plant = ServedPlant(self.rows, np.array(poses, float))
        n, empty = len(self.rows), nothing(max(self.plant.wheels))
        self._nothing = np.tile(empty, (n, 1))
        settings = [row.settings for row in self.rows]
        self._radio = Radio(
            [each.radio for each in settings],
            [row.noise_seed for row in self.rows],
            [row.faults for row in self.rows],
            CYCLES,
            empty,
        )
        self.held = received(self._nothing, np.zeros(n, bool), 0)
        self.measured = np.full((n, 3), np.nan)
        self._seen = [(heading, self.cycle) for heading in self.plant.pose()[:, 2].tolist()]

    def _rows(self) -> list[Row]:
        """A row for each robot."""
        rows = []
        for place, (team, number) in enumerate(self.names):
            chosen = self._scenarios[team]
            own = [fault.replace(robots=()) for fault in of_robot(chosen.settings.fault, number)]
            settings = chosen.settings.replace(fault=own) if own != [*chosen.settings.fault] else chosen.settings
            rows.append(Row(0, place, team.name.lower(), chosen.seed, settings, chosen.robot))
        return rows


def label(name: Name) -> str:
    """What a robot is called in messages."""
    return f"{name[0].name.lower()} {name[1]}"

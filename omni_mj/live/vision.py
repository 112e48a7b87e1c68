"""From packets of SSL-Vision to the poses of a team's robots at a tick."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.live.cameras import Biases, Camera
from omni_mj.live.notes import Notes
from omni_mj.live.wire import WireError, decode
from omni_mj.live.wire.vision import DetectedRobot, Detection, Source, VisionPacket

Colour = Literal["blue", "yellow"]

NEAR_M, FASTEST_M_S = 0.15, 5.0  # from where it should be a robot is at most: this, and what it may have moved unseen
FASTEST = np.array([FASTEST_M_S, FASTEST_M_S, 30.0])  # with which robots are carried on, m/s, m/s, rad/s
MIRRORED_RAD = 2.2  # from where it should face: a pattern that was read the wrong way round is pi away
PERSIST = 15  # ticks for which it is elsewhere, or faces the other way, until that is believed
UNSEEN_S = 0.25  # for which motion is carried on, and after which a heading may be any
FARTHEST_M = 1e3  # from the field's centre; beyond, a packet is none


@dataclass(frozen=True)
class Sighting:
    """What a camera saw of a robot: its pose (3,) m, m, rad; when, s of the camera's clock."""

    camera: int
    pose: Array
    captured: float


class Vision:
    """Robots of a team as all cameras see them.

    Each detection is brought from its time of capture to the tick by the robot's velocity; of what several cameras
    see the mean counts, without their `Camera.bias`. One that is far from where the robot should be is of another
    robot, and is not believed; one that faces the other way is turned. Either is believed when it lasts, as after
    somebody moved the robot.

    Args:
        colour: of the team.
        ids: the robots' numbers, n of them.
        notes: of what was wrong.

    Attributes:
        colour, ids: of the robots that are looked for.
        cameras: by number.
        source: who says that he sends, or None.
        heard: when the last frame came, s of our clock, minus infinity before.
        age: how long before the last tick robots were seen, (n,) s; zero for those that were not.
        brought: by how much they were brought to the tick from there, (n, 3).
    """

    def __init__(self, colour: Colour, ids: Sequence[int], notes: Notes) -> None:
        self.cameras: dict[int, Camera] = {}
        self._senders: dict[int, object] = {}
        self.source: Source | None = None
        self.heard = -math.inf
        self.colour, self._notes, self._biases = colour, notes, Biases()
        self.follow(ids)

    def follow(self, ids: Sequence[int]) -> None:
        """See these robots from now on, wherever they are."""
        self.ids, n = list(ids), len(ids)
        self._pose, self._unseen = np.full((n, 3), np.nan), np.full(n, math.inf)  # the latter in s
        self._fresh: list[dict[int, list[Sighting]]] = [{} for _ in self.ids]
        self._odd, self._turned = np.zeros((2, n), int)
        self.age, self.brought = np.zeros(n), np.zeros((n, 3))

    def believe(self, poses: Array) -> None:
        """Take the robots to be there (n, 3) now; where they are not, nothing is believed."""
        self._pose, self._unseen = poses.copy(), np.where(np.isnan(poses[:, 0]), math.inf, 0.0)

    def add(self, data: bytes, arrival: float, source: object = "") -> tuple[int, Detection] | None:
        """Take in a packet: the camera's number, and what it saw.

        None if it is bad, which is noted; has no detection; or is late, or was here before.
        """
        try:
            packet = decode(VisionPacket, data)
            detection = packet.detection
            if detection is None:
                return None
            _check(detection)
        except WireError as error:
            self._notes.add("bad packet", f"a packet from {source} is skipped: {error}")
            return None
        before, self._senders[detection.camera_id] = self._senders.get(detection.camera_id, source), source
        if source != before:
            text = (
                f"camera {detection.camera_id} is sent by {source} now, by {before} before: a new peer, or two at once"
            )
            self._notes.add("another sender", text)
        self.source = packet.source if packet.source is not None else self.source
        self.heard = arrival
        camera = self.cameras.setdefault(detection.camera_id, Camera())
        restarts = camera.clock.restarts
        fresh = camera.add(detection, arrival)
        if camera.clock.restarts > restarts:
            self._notes.add("restart", f"the clock of camera {detection.camera_id} began anew", always=True)
        if not fresh:
            return None
        for robot in self._own(detection):
            place = self.ids.index(robot.robot_id)  # type: ignore[arg-type]
            pose = np.array([robot.x, robot.y, robot.orientation])
            sighting = Sighting(detection.camera_id, pose, detection.t_capture)
            held = self._fresh[place].setdefault(detection.camera_id, [])
            held[:] = [each for each in held if each.captured == detection.t_capture] + [sighting]
        return detection.camera_id, detection

    def at(self, tick: float, elapsed: float, twist: Array, leader: int | None = None) -> tuple[Array, np.ndarray]:
        """What was seen since the tick before, brought to a tick.

        Args:
            tick: when, s of the clock of the camera `leader`; of ours, if there is none.
            elapsed: since the tick before, s.
            twist: of the robots (n, 3), world frame, m/s and rad/s.
            leader: number of a camera.

        Returns:
            Poses (n, 3), carried on from where it was for a robot that was not seen, not a number if it never was;
            headings count full turns. And which were seen, (n,).
        """
        twist = np.clip(twist, -FASTEST, FASTEST)  # one that is not believed might carry robots away
        self._unseen = self._unseen + elapsed
        carried = np.where((self._unseen < UNSEEN_S)[:, None], elapsed * twist, 0.0)
        self._pose = self._pose + carried
        seen, self.age = np.zeros(len(self.ids), bool), np.zeros(len(self.ids))
        for place, fresh in enumerate(self._fresh):
            found: dict[int, Array] = {}
            since = []
            for number, sightings in fresh.items():
                ages = [min(max(tick - self._time(each, leader), 0.0), UNSEEN_S) for each in sightings]
                poses = [each.pose + age * twist[place] for each, age in zip(sightings, ages, strict=True)]
                near = [(pose, age) for pose, age in zip(poses, ages, strict=True) if self._near(place, pose)]
                if near:
                    expected = np.nan_to_num(self._pose[place, :2])
                    best, age = min(near, key=lambda each: math.dist(each[0][:2], expected))
                    found[number] = self._facing(place, best)
                    since.append(age)
            self._odd[place] = 0 if found else self._odd[place] + bool(fresh)
            if self._odd[place] >= PERSIST:
                self._notes.add("moved", f"robot {self.ids[place]} is elsewhere, as if moved by hand", always=True)
                self._unseen[place], self._odd[place] = math.inf, 0
            if found:
                self._biases.learn(self.cameras, found)
                self._pose[place], self._unseen[place], seen[place] = self._merged(place, found), 0.0, True
                self.age[place] = sum(since) / len(since)
            self._fresh[place] = {}
        self.brought = self.age[:, None] * twist
        return self._pose.copy(), seen

    def _time(self, sighting: Sighting, leader: int | None) -> float:
        """When something was captured, by the leader's clock, or ours."""
        if sighting.camera == leader:
            return sighting.captured
        ours = self.cameras[sighting.camera].clock.ours(sighting.captured)
        return ours if leader is None else self.cameras[leader].clock.theirs(ours)

    def _own(self, detection: Detection) -> Iterator[DetectedRobot]:
        """The robots that are ours, and can be: with a number, a heading, a place on the earth."""
        robots = detection.robots_blue if self.colour == "blue" else detection.robots_yellow
        for robot in robots:
            if robot.robot_id is None or robot.robot_id not in self.ids:
                continue
            if robot.orientation is None:
                self._notes.add("no heading", f"vision sees no heading of robot {robot.robot_id}: it needs a pattern")
                continue
            yield robot

    def _near(self, place: int, pose: Array) -> bool:
        """Whether a robot can be there."""
        expected, unseen = self._pose[place], self._unseen[place]
        if not math.isfinite(unseen) or np.isnan(expected).any():
            return True
        near = math.dist(pose[:2], expected[:2]) <= NEAR_M + FASTEST_M_S * unseen
        if not near:
            self._notes.add("wrong id", f"vision sees robot {self.ids[place]} where it cannot be; it is not believed")
        return near

    def _facing(self, place: int, pose: Array) -> Array:
        """The pose, turned back if it was seen the wrong way round."""
        off = wrap_angle(pose[2] - self._pose[place, 2])
        if self._unseen[place] > UNSEEN_S or not abs(off) > MIRRORED_RAD:
            self._turned[place] = 0
            return pose
        self._turned[place] += 1
        if self._turned[place] > PERSIST * max(len(self.cameras), 1):
            self._turned[place] = 0
            self._notes.add("turned", f"robot {self.ids[place]} faces the other way, as if turned by hand", always=True)
            return pose
        self._notes.add("mirrored", f"vision sees robot {self.ids[place]} the wrong way round; it is turned")
        return pose + np.array([0.0, 0.0, math.pi])

    def _merged(self, place: int, found: dict[int, Array]) -> Array:
        """The mean of what cameras see; its heading counts full turns from the one expected."""
        poses = np.array([pose - self.cameras[number].bias for number, pose in found.items()])
        about = self._pose[place, 2] if np.isfinite(self._pose[place, 2]) else poses[0, 2]
        poses[:, 2] = about + wrap_angle(poses[:, 2] - about)
        return poses.mean(0)


def _check(detection: Detection) -> None:
    """Raise `WireError` for numbers that are no time, no place or no angle."""
    times = detection.t_capture, detection.t_sent
    robots = *detection.robots_blue, *detection.robots_yellow
    values = [value for robot in robots for value in (robot.x, robot.y, robot.orientation or 0.0)]
    if not all(map(math.isfinite, times)) or not all(abs(value) < FARTHEST_M for value in values):
        raise WireError("a time, place or heading is not finite, or out of this world")

"""What packets of SSL-Vision say: cameras with their clocks, robots with their numbers, and noise."""

import math
from collections import defaultdict, deque
from typing import Literal

import numpy as np
from scipy.optimize import minimize_scalar

from omni_control.kinematics import Array, wrap_angle
from omni_mj.live.sockets import Notes
from omni_mj.live.wire import MM_PER_M, WireError, parse
from omni_mj.live.wire.league_pb2 import DetectedRobot, Detection, VisionPacket

Colour = Literal["blue", "yellow"]

WINDOW_FRAMES, FIT_FRAMES = 600, 30  # to which a clock is fitted, and after which again
RATES = 0.2, 5.0  # between which a peer's clock is found
MAX_AGE_S = 0.25  # between capture and tick, or sending; more, or less than none, is of two clocks
MAX_DISTANCE_M = 1e3  # from the field's centre
STORED_FRAMES = 300  # detections of each robot by each camera
STD_OF_MEDIAN = 1.4826  # standard deviation over median magnitude of normal numbers
STD_OF_DIFFERENCES = math.sqrt(
    6.0
)  # standard deviation of a second difference, 1 -2 1, of independent numbers


class Clock:
    """Offset and rate between a peer's clock and ours, from time stamps and arrivals of packets.

    Packets take a while, but none takes less than the least delay, which cannot be observed and
    counts as none. The clocks' line is below all arrivals over their stamps, and nearest to them
    (Moon, Skelly and Towsley, "Estimation and removal of clock skew from network delay
    measurements", INFOCOM 1999).
    """

    def __init__(self) -> None:
        self._packets = deque[tuple[float, float]](maxlen=WINDOW_FRAMES)
        self._slope, self._n_packets = 1.0, 0

    @property
    def rate(self) -> float:
        """Seconds of the peer's clock per second of ours."""
        return 1 / self._slope

    def ours(self, stamp: float) -> float:
        """Return our time, s, of a time of the peer's."""
        return self._arrival + self._slope * (stamp - self._stamp)

    def add(self, stamp: float, arrival: float) -> None:
        """Add a packet, s of each clock."""
        if not self._packets:
            self._stamp, self._arrival = stamp, arrival
        self._packets.append((stamp, arrival))
        self._arrival -= max(self.ours(stamp) - arrival, 0.0)  # faster than any before
        self._n_packets += 1
        if self._n_packets % FIT_FRAMES == 0:
            stamps, arrivals = (np.array(self._packets) - (stamp, arrival)).T
            fit = minimize_scalar(
                lambda slope: (
                    (arrivals - slope * stamps).mean() - (arrivals - slope * stamps).min()
                ),
                bounds=RATES,
                method="bounded",
                options={"xatol": 1e-7},
            )
            self._slope, self._stamp = float(fit.x), stamp
            self._arrival = arrival + float((arrivals - self._slope * stamps).min())


class VisionCamera:
    """Statistics of one camera.

    Attributes:
        clock: Of its time stamps.
        frames: How many came, none twice.
        sent_s: Stamp of the newest, s of its clock.
    """

    def __init__(self) -> None:
        self.clock, self.frames, self.sent_s = Clock(), 0, -math.inf
        self._ages, self._intervals = (
            deque[float](maxlen=WINDOW_FRAMES),
            deque[float](maxlen=WINDOW_FRAMES),
        )

    def add(self, detection: Detection, arrival: float) -> bool:
        """Add a frame. Return whether it is new: neither late nor a repetition."""
        age = detection.t_sent - detection.t_capture
        age = age if 0 <= age <= MAX_AGE_S else 0.0
        sent_s = detection.t_capture + age
        if sent_s <= self.sent_s:
            return False
        self._intervals.append(sent_s - self.sent_s)
        self._ages.append(age)
        self.clock.add(sent_s, arrival)
        self.sent_s = sent_s
        self.frames += 1
        return True

    @property
    def mean_age_s(self) -> float:
        """Mean time between capture and sending, s."""
        return float(np.mean(self._ages))

    @property
    def rate_hz(self) -> float:
        """Frames per second of its own clock by the median interval, whatever stalled in between; 0 if unknown."""
        return 1 / float(np.median(self._intervals))


class Vision:
    """Robots as all cameras see them.

    Args:
        colour: Of the team that is followed.
        notes: What was wrong.

    Attributes:
        colour, notes: As given.
        ids: Numbers of the robots that are followed, n of them.
        cameras: By number.
        sightings: Last poses of every robot, by team, number and camera.
    """

    def __init__(self, colour: Colour, notes: Notes) -> None:
        self.colour, self.notes, self.ids = colour, notes, list[int]()
        self.cameras = defaultdict[int, VisionCamera](VisionCamera)
        self.sightings = defaultdict[tuple[Colour, int, int], deque[Array]](
            lambda: deque(maxlen=STORED_FRAMES)
        )
        self._newest = dict[int, Detection]()  # since the last tick, by camera

    def add(self, data: bytes, arrival: float, sender: object = "") -> bool:
        """Add a packet that came at a time of ours, s. Return whether it has a new detection."""
        try:
            packet = parse(VisionPacket, data)
            detection = packet.detection
            if not packet.HasField("detection"):
                return False
            _check(detection)
        except WireError as error:
            self.notes.add("bad packet", f"a packet from {sender} is skipped: {error}")
            return False
        if not self.cameras[detection.camera_id].add(detection, arrival):
            return False
        self._newest[detection.camera_id] = detection
        teams: tuple[Colour, Colour] = "blue", "yellow"
        for colour in teams:
            for robot in _team_robots(detection, colour):
                self.sightings[colour, robot.robot_id, detection.camera_id].append(
                    _robot_pose(robot)
                )
        return True

    def at(self, now: float, rate: float, expected: Array) -> tuple[Array, Array]:
        """Return what was seen of the robots since the last tick, and its age.

        Of several detections of one number the one nearest to the expected place counts.

        Args:
            now: Our time, s.
            rate: Of the clock by which ages count, over ours.
            expected: Poses, shape (n, 3).

        Returns:
            Poses, shape (n, 3); NaN where none was seen. Ages, shape (n,), s.
        """
        poses, ages = np.full((len(self.ids), 3), np.nan), np.zeros(len(self.ids))
        for i, number in enumerate(self.ids):
            candidates = [
                (_robot_pose(robot), now - self.cameras[camera].clock.ours(detection.t_capture))
                for camera, detection in self._newest.items()
                for robot in _team_robots(detection, self.colour)
                if robot.robot_id == number
            ]
            if candidates:
                distances = [math.dist(pose[:2], expected[i, :2]) for pose, _ in candidates]
                poses[i], age = candidates[int(np.argmin(distances))]
                ages[i] = min(max(age * rate, 0.0), MAX_AGE_S)
        self._newest.clear()
        return poses, ages

    def seen_ids(self) -> list[int]:
        """Return the numbers of the team's robots in order."""
        return sorted({number for colour, number, _ in self.sightings if colour == self.colour})

    def resting_poses(self) -> Array:
        """Return the median poses of the robots that are followed, shape (n, 3)."""
        poses = np.zeros((len(self.ids), 3))
        for pose, number in zip(poses, self.ids, strict=True):
            by_camera = [
                seen for (*name, _), seen in self.sightings.items() if name == [self.colour, number]
            ]
            x, y, heading = np.concatenate(by_camera).T
            pose[:] = (
                np.median(x),
                np.median(y),
                np.arctan2(np.median(np.sin(heading)), np.median(np.cos(heading))),
            )
        return poses

    def noise(self) -> dict[str, float]:
        """Return standard deviations of what is seen of robots, by their settings."""
        tables = [np.array(poses) for poses in self.sightings.values() if len(poses) > 2]
        if not tables:  # of a simulation that waits for commands
            return {}
        position, heading = np.median([deviations(table) for table in tables], axis=0).tolist()
        return {
            "vision.position_noise_m": round(position, 6),
            "vision.heading_noise_rad": round(heading, 5),
        }

    def describe(self) -> list[str]:
        """Return a line for each camera, and for each robot that a camera sees, and how often what was noted."""
        lines = [
            f"camera {number}: {camera.rate_hz:.2f} frames a second of its clock,"
            f" {camera.rate_hz * camera.clock.rate:.2f} of ours; sent {1e3 * camera.mean_age_s:.1f} ms after capture"
            for number, camera in sorted(self.cameras.items())
        ]
        for (colour, number, camera), poses in sorted(self.sightings.items()):
            (x, y, heading), (position, turned) = poses[-1], deviations(np.array(poses))
            lines.append(
                f"{colour} {number}: at {x:.3f}, {y:.3f} m, {math.degrees(heading):.1f}° by camera {camera};"
                f" noise {1e3 * position:.2f} mm, {math.degrees(turned):.2f}°"
            )
        return [*lines, *(f"noted: {kind}, {count} times" for kind, count in self.notes.items())]


def deviations(poses: Array) -> Array:
    """Return standard deviations of position and heading of a robot that rests or moves steadily, shape (2,).

    Args:
        poses: Of a robot, some of which are wrong, shape (frames, 3). Their second differences do
            not contain steady motion. Fewer than three have none; the result is NaN.
    """
    if len(poses) < 3:
        return np.full(2, np.nan)
    differences = np.diff(poses, n=2, axis=0)
    differences[:, 2] = wrap_angle(differences[:, 2])
    x, y, heading = STD_OF_MEDIAN / STD_OF_DIFFERENCES * np.median(np.abs(differences), axis=0)
    return np.array([(x + y) / 2, heading])


def _team_robots(detection: Detection, colour: Colour) -> list[DetectedRobot]:
    """Return the robots of a team whose patterns were recognized."""
    robots = detection.robots_blue if colour == "blue" else detection.robots_yellow
    return [
        robot for robot in robots if robot.HasField("robot_id") and robot.HasField("orientation")
    ]


def _robot_pose(robot: DetectedRobot) -> Array:
    """Return the pose, shape (3,), m, m, rad."""
    return np.array([robot.x / MM_PER_M, robot.y / MM_PER_M, wrap_angle(robot.orientation)])


def _check(detection: Detection) -> None:
    """Raise `WireError` for times, places and headings that are not finite or out of this world."""
    robots = [*detection.robots_blue, *detection.robots_yellow]
    values = np.array(
        [(robot.x / MM_PER_M, robot.y / MM_PER_M, robot.orientation) for robot in robots]
    )
    is_finite = math.isfinite(detection.t_capture) and math.isfinite(detection.t_sent)
    if not is_finite or not (np.abs(values) < MAX_DISTANCE_M).all():
        raise WireError("a time, place or heading is not finite, or out of this world")

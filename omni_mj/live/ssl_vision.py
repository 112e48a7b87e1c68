"""Detections of SSL-Vision: cameras and their clocks, robot poses, measurement noise."""

import math
from collections import defaultdict, deque
from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy.optimize import minimize_scalar

from omni_control.kinematics import Array, wrap_angle
from omni_mj.io.printable_text import format_count
from omni_mj.live.sockets import MessageCounter
from omni_mj.live.wire import MM_PER_M, WireError, parse_message
from omni_mj.live.wire.league_pb2 import DetectedRobot, Detection, VisionPacket

TeamColor = Literal["blue", "yellow"]

WINDOW_FRAMES = 600  # newest frames, to which a clock is fitted
FIT_FRAMES = 30  # number of frames between two fits
# A clock is set anew if all of its newest packets are later than before: its computer has stalled.
RECENT_FRAMES, STALL_S = 60, 0.02
RESTART_S = 1.0  # largest step of time stamps within which they are those of one clock
RATES = 0.2, 5.0  # bounds of the seconds of our clock per second of another clock
# Largest credible time from capture to sending or to use, s. If the time is negative or larger, the
# time stamps are from two different clocks.
MAX_AGE_S = 0.25
MAX_DISTANCE_M = 1e3  # from the field's center
# Of a packet: numbers of cameras and of robots, and robots of a team
MAX_CAMERA, MAX_ROBOT_ID, MAX_TEAM_ROBOTS = 15, 255, 32
CAMERAS_DIFFER_M = 0.1  # most by which cameras that see the same robot differ
STORED_FRAMES = 300  # detections of each robot by each camera
STD_OF_MEDIAN = 1.4826  # standard deviation over median magnitude of normal numbers
# Standard deviation of a second difference, 1 -2 1, of independent numbers
STD_OF_DIFFERENCES = math.sqrt(6.0)


class PeerClock:
    """Offset and rate between another computer's clock and ours, from time stamps of packets.

    The smallest network delay cannot be observed and counts as zero. The estimate is the straight
    line below all points (time stamp, arrival) that is closest to them (Moon, Skelly and Towsley,
    "Estimation and removal of clock skew from network delay measurements", INFOCOM 1999).
    """

    def __init__(self) -> None:
        self._packets = deque[tuple[float, float]](maxlen=WINDOW_FRAMES)
        self._slope, self._n_packets = 1.0, 0

    @property
    def rate(self) -> float:
        """Seconds of the other clock per second of ours."""
        return 1 / self._slope

    def local_time(self, stamp: float) -> float:
        """Return our time of a time stamp of the other clock, s."""
        return self._arrival + self._slope * (stamp - self._stamp)

    def add(self, stamp: float, arrival: float) -> None:
        """Add the time stamp and the arrival of a packet, s of each clock."""
        if not self._packets:
            self._stamp, self._arrival = stamp, arrival
        self._packets.append((stamp, arrival))
        self._arrival -= max(self.local_time(stamp) - arrival, 0.0)  # a smaller delay than before
        self._n_packets += 1
        if self._n_packets % FIT_FRAMES == 0:
            recent = list(self._packets)[-RECENT_FRAMES:]
            earliest = min(late - self._slope * (sent - stamp) for sent, late in recent)
            if earliest - self.local_time(stamp) > STALL_S:
                self._packets = deque(recent, maxlen=WINDOW_FRAMES)
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
        clock: Clock of its time stamps.
        frames: Number of frames received, without repetitions.
        restarts: How often its time stamps went back.
        sent_s: Time stamp of the newest frame, s of its clock.
        age_problem: Why the age of the newest frame counts as zero, or None.
        standstill_s: Time from the newest frame to its last repetition, s; 0 without repetitions.
    """

    def __init__(self) -> None:
        self.clock, self.frames, self.sent_s = PeerClock(), 0, -math.inf
        self.restarts, self.standstill_s, self._arrival = 0, 0.0, math.inf
        self.age_problem: str | None = None
        self._ages = deque[float](maxlen=WINDOW_FRAMES)
        self._intervals = deque[float](maxlen=WINDOW_FRAMES)

    def add(self, detection: Detection, arrival: float) -> bool:
        """Add a frame, and return whether it is newer than all previous ones."""
        age = detection.t_sent - detection.t_capture
        self.age_problem = None
        if not 0 <= age <= MAX_AGE_S:
            self.age_problem = (
                f"stamps say that images are sent {age:.4g} s after capture; only ages from 0 to "
                f"{MAX_AGE_S:g} s are believed"
            )
            age = 0.0
        sent_s = detection.t_capture + age
        if abs(sent_s - self.sent_s) > RESTART_S:
            self.clock = PeerClock()
        if sent_s < self.sent_s - RESTART_S:
            self.restarts += 1
        elif sent_s <= self.sent_s:
            self.standstill_s = arrival - self._arrival
            return False
        else:
            self._intervals.append(sent_s - self.sent_s)
        self.standstill_s, self._arrival = 0.0, arrival
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
        """Frames per second of its own clock, from the median interval; 0 if unknown."""
        return 1 / float(np.median(self._intervals))


class SslVision:
    """Robot poses from the packets of all cameras.

    Args:
        color: Color of the team that is tracked.
        messages: Counts problems with packets.

    Attributes:
        color, messages: As passed.
        ids: Numbers of the n robots that are tracked.
        is_lockstep: Whether time stamps are the simulated time of a simulator that waits for
            commands. The clock of this computer then says nothing about ages.
        cameras: Camera statistics by camera number.
        sightings: Newest poses of every robot, by team, robot number and camera number.
    """

    def __init__(self, color: TeamColor, messages: MessageCounter) -> None:
        self.color, self.messages, self.ids = color, messages, list[int]()
        self.is_lockstep, self._last_tick = False, -math.inf
        self.cameras = defaultdict[int, VisionCamera](VisionCamera)
        self.sightings = defaultdict[tuple[TeamColor, int, int], deque[Array]](
            lambda: deque(maxlen=STORED_FRAMES)
        )
        self._newest = dict[int, Detection]()  # since the last frame of the loop, by camera

    def add(self, data: bytes, arrival: float, sender: object = "") -> bool:
        """Add a packet, and return whether it is a new detection.

        Args:
            data: Bytes of the packet.
            arrival: Time of arrival by our clock, s.
            sender: Sender, for messages about malformed packets.
        """
        try:
            packet = parse_message(VisionPacket, data)
            detection = packet.detection
            if not packet.HasField("detection"):
                return False
            _check(detection)
        except WireError as error:
            self.messages.add("bad packet", f"skipped a packet from {sender}: {error}")
            return False
        camera = self.cameras[detection.camera_id]
        restarts = camera.restarts
        if not camera.add(detection, arrival):
            return False
        if camera.age_problem:
            text = f"camera {detection.camera_id}: {camera.age_problem}"
            self.messages.add("ages not believed", text)
        if camera.restarts > restarts:
            text = f"camera {detection.camera_id}: its time stamps went back; its clock is new"
            self.messages.add("camera restarted", text)
        self._newest[detection.camera_id] = detection
        teams: tuple[TeamColor, TeamColor] = "blue", "yellow"
        for color in teams:
            for robot in _team_robots(detection, color):
                self.sightings[color, robot.robot_id, detection.camera_id].append(
                    _robot_pose(robot)
                )
        return True

    def measurements(self, now: float, rate: float, expected: Array) -> tuple[Array, Array]:
        """Return the poses detected since the last call, and their ages.

        If a robot number was detected more than once, the detection nearest to the expected
        position counts. If a camera sees the robot backwards, that of another camera counts.

        Args:
            now: Our time, or in lockstep the simulated time, s.
            rate: Rate of the clock that measures ages, over ours.
            expected: Expected poses, shape (n, 3), m and rad.

        Returns:
            Poses, shape (n, 3), NaN where no robot was detected. Ages, shape (n,), s.
        """
        poses, ages = np.full((len(self.ids), 3), np.nan), np.zeros(len(self.ids))
        for i, number in enumerate(self.ids):
            candidates = [
                (_robot_pose(robot), self._age(self.cameras[camera], detection, now))
                for camera, detection in self._newest.items()
                for robot in _team_robots(detection, self.color)
                if robot.robot_id == number
            ]
            if candidates:
                poses[i], age = candidates[_choose([pose for pose, _ in candidates], expected[i])]
                ages[i] = min(max(age * rate, 0.0), MAX_AGE_S)
        self._newest.clear()
        self._last_tick = now
        return poses, ages

    def _age(self, camera: VisionCamera, detection: Detection, now: float) -> float:
        """Return the age of the newest detection of a camera, s; see `measurements`.

        In lockstep, cameras with different clocks are known by images that were not sent since the
        last frame. Such images count as sent just now.
        """
        if not self.is_lockstep:
            return now - camera.clock.local_time(detection.t_capture)
        time_since_sent = now - camera.sent_s
        if not 0 <= time_since_sent <= now - self._last_tick:
            time_since_sent = 0.0
        return time_since_sent + camera.sent_s - detection.t_capture

    def seen_ids(self) -> list[int]:
        """Return the sorted numbers of the team's robots that were detected."""
        return sorted({number for color, number, _ in self.sightings if color == self.color})

    def median_poses(self) -> Array:
        """Return the median poses of the tracked robots, shape (n, 3), m and rad."""
        poses = np.zeros((len(self.ids), 3))
        for pose, number in zip(poses, self.ids, strict=True):
            by_camera = [
                history
                for (*name, _), history in self.sightings.items()
                if name == [self.color, number]
            ]
            x, y, heading = np.concatenate(by_camera).T
            median_heading = np.arctan2(np.median(np.sin(heading)), np.median(np.cos(heading)))
            pose[:] = np.median(x), np.median(y), median_heading
        return poses

    def noise(self) -> dict[str, float]:
        """Return standard deviations of the measured poses, by the name of their setting."""
        histories = [np.array(poses) for poses in self.sightings.values() if len(poses) > 2]
        if not histories:  # a simulator that waits for commands
            return {}
        position_noise, heading = np.median(
            [noise_deviations(history) for history in histories], axis=0
        ).tolist()
        return {
            "vision.position_noise_m": round(position_noise, 6),
            "vision.heading_noise_rad": round(heading, 5),
        }

    def describe(self) -> list[str]:
        """Return a line of text for each camera, each detected robot, and each kind of message.

        The noise is unknown (nan) if a simulator waits for commands.
        """
        lines = [
            f"camera {number}: {camera.rate_hz:.2f} Hz by its clock,"
            f" {camera.rate_hz * camera.clock.rate:.2f} Hz by this computer's;"
            f" images are sent {1e3 * camera.mean_age_s:.1f} ms after capture"
            if camera.rate_hz
            else f"camera {number}: waits for commands"
            for number, camera in sorted(self.cameras.items())
        ]
        for (color, number, camera), poses in sorted(self.sightings.items()):
            x, y, heading = poses[-1]
            noise = noise_deviations(np.array(poses))
            lines.append(
                f"{color} {number}: at {x:.3f}, {y:.3f} m, {math.degrees(heading):.1f}°"
                f" by camera {camera}; noise {1e3 * noise[0]:.2f} mm, {math.degrees(noise[1]):.2f}°"
            )
        return lines + [
            f"{kind}: {format_count(count, 'time')}" for kind, count in self.messages.items()
        ]


def noise_deviations(poses: Array) -> Array:
    """Return standard deviations of position and heading noise, shape (2,), m and rad.

    Second differences remove a steady motion. The median is robust against outliers.

    Args:
        poses: Poses of a robot, shape (frames, 3), m and rad. With fewer than three frames the
            result is NaN.
    """
    if len(poses) < 3:
        return np.full(2, np.nan)
    differences = np.diff(poses, n=2, axis=0)
    differences[:, 2] = wrap_angle(differences[:, 2])
    x, y, heading = STD_OF_MEDIAN / STD_OF_DIFFERENCES * np.median(np.abs(differences), axis=0)
    return np.array([(x + y) / 2, heading])


def _choose(poses: Sequence[Array], expected: Array) -> int:
    """Return the index of the detection, of several of a robot number, that counts.

    Args:
        poses: Detected poses, shape (3,) each.
        expected: Expected pose, shape (3,).
    """
    distances = np.array([math.dist(pose[:2], expected[:2]) for pose in poses])
    is_far = distances > distances.min() + CAMERAS_DIFFER_M
    headings = np.array([pose[2] for pose in poses])
    is_backwards = np.abs(wrap_angle(headings - expected[2])) > np.pi / 2
    return int(np.lexsort((distances, is_backwards, is_far))[0])


def _team_robots(detection: Detection, color: TeamColor) -> list[DetectedRobot]:
    """Return the detected robots of a team that have a number and a heading."""
    robots = detection.robots_blue if color == "blue" else detection.robots_yellow
    return [
        robot for robot in robots if robot.HasField("robot_id") and robot.HasField("orientation")
    ]


def _robot_pose(robot: DetectedRobot) -> Array:
    """Return the pose of a detection, shape (3,), m and rad."""
    return np.array([robot.x / MM_PER_M, robot.y / MM_PER_M, wrap_angle(robot.orientation)])


def _check(detection: Detection) -> None:
    """Check the numbers of a detection.

    Raises:
        WireError: A time, position or heading is not finite, a position is too far away, or there
            are too many cameras or robots.
    """
    robots = [*detection.robots_blue, *detection.robots_yellow]
    n_robots = max(len(detection.robots_blue), len(detection.robots_yellow))
    number = max((robot.robot_id for robot in robots), default=0)
    if detection.camera_id > MAX_CAMERA or number > MAX_ROBOT_ID or n_robots > MAX_TEAM_ROBOTS:
        raise WireError(
            f"cameras must have numbers up to {MAX_CAMERA}, robots up to {MAX_ROBOT_ID}, and a"
            f" team at most {MAX_TEAM_ROBOTS} robots"
        )
    values = np.array(
        [(robot.x / MM_PER_M, robot.y / MM_PER_M, robot.orientation) for robot in robots]
    )
    is_finite = math.isfinite(detection.t_capture) and math.isfinite(detection.t_sent)
    if not is_finite or not (np.abs(values) < MAX_DISTANCE_M).all():
        raise WireError(f"times and headings must be finite, positions within {MAX_DISTANCE_M:g} m")

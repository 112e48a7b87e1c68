"""From packets of SSL-Vision to the poses of a team's robots at a tick."""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.live.cameras import BiasLearner, VisionCamera
from omni_mj.live.notes import Notes
from omni_mj.live.wire import MM_PER_M, WireError, parse
from omni_mj.live.wire.vision_pb2 import DetectedRobot, Detection, VisionPacket

Colour = Literal["blue", "yellow"]

NEAR_M, MAX_SPEED_M_S = 0.15, 5.0  # a robot is at most this, and the way it may have gone unseen, from the expectation
MAX_TWIST = np.array([MAX_SPEED_M_S, MAX_SPEED_M_S, 30.0])  # with which robots are carried on, m/s, m/s, rad/s
MIRRORED_RAD = 2.2  # from the expectation; a pattern that was read the wrong way round is pi away
UNSEEN_S = 0.25  # for which motion is carried on, and after which a heading may be any
MAX_DISTANCE_M = 1e3  # from the field's centre


def team_robots(detection: Detection, colour: Colour) -> list[DetectedRobot]:
    """Return the robots of a team whose patterns were recognized."""
    robots = detection.robots_blue if colour == "blue" else detection.robots_yellow
    return [robot for robot in robots if robot.HasField("robot_id") and robot.HasField("orientation")]


def robot_pose(robot: DetectedRobot) -> Array:
    """Return the pose, shape (3,), m, m, rad."""
    return np.array([robot.x / MM_PER_M, robot.y / MM_PER_M, robot.orientation])


class Vision:
    """Robots of a team as all cameras see them.

    Each detection is extrapolated from its time of capture to the tick by the robot's velocity. If several cameras see
    a robot, the mean counts, without their biases. A detection far from the expectation belongs to another robot. One
    that faces the other way was read the wrong way round. Both are ignored until the robot has been unseen for so long
    that it can be there.

    Args:
        colour: Of the team.
        ids: The robots' numbers, n of them.
        notes: What was wrong.

    Attributes:
        colour, ids: Of the robots that are followed.
        notes: As given.
        cameras: By number.
        heard_s: When the last frame came (`time.monotonic`), s; minus infinity before.
        age: How long before the last tick robots were seen, shape (n,), s; zero for those that were not.
        extrapolation: By how much they were moved from there to the tick, shape (n, 3).
    """

    def __init__(self, colour: Colour, ids: Sequence[int], notes: Notes) -> None:
        self.cameras: dict[int, VisionCamera] = {}
        self.heard_s = -math.inf
        self.colour, self.notes, self._bias_learner = colour, notes, BiasLearner()
        self.follow(ids)

    def follow(self, ids: Sequence[int], poses: Array | None = None) -> None:
        """Follow these robots from now on, which are at `poses`, shape (n, 3), or anywhere."""
        self.ids, n = list(ids), len(ids)
        self._pose = np.full((n, 3), np.nan) if poses is None else poses.copy()
        self._unseen_s = np.where(np.isnan(self._pose[:, 0]), math.inf, 0.0)
        self._fresh: dict[int, Detection] = {}  # camera -> newest detection since the last tick
        self.age, self.extrapolation = np.zeros(n), np.zeros((n, 3))

    def add(self, data: bytes, arrival: float, sender: object = "") -> Detection | None:
        """Add a packet. Return its detection, or None if it has none, is late, a repetition or bad."""
        try:
            packet = parse(VisionPacket, data)
            detection = packet.detection
            if not packet.HasField("detection"):
                return None
            _check(detection)
        except WireError as error:
            self.notes.add("bad packet", f"a packet from {sender} is skipped: {error}")
            return None
        number = detection.camera_id
        self.heard_s = arrival
        camera = self.cameras.setdefault(number, VisionCamera())
        restarts = camera.restarts
        is_new = camera.add(detection, arrival)
        if camera.restarts > restarts:
            self.notes.add("restart", f"the clock of camera {number} began anew", always=True)
        if not is_new:
            return None
        self._fresh[number] = detection
        return detection

    def at(self, tick: float, elapsed: float, twist: Array, leader: int | None = None) -> tuple[Array, np.ndarray]:
        """Return where the robots are at a tick.

        Args:
            tick: Time, s of the clock of the camera `leader`; of ours, if there is none.
            elapsed: Since the last tick, s.
            twist: Of the robots, world frame, shape (n, 3), m/s and rad/s.
            leader: Number of a camera.

        Returns:
            Poses, shape (n, 3), extrapolated for robots that were not seen, NaN if they never were; headings count
            full turns. And which were seen, shape (n,).
        """
        twist = np.clip(twist, -MAX_TWIST, MAX_TWIST)  # a wrong one might carry robots away
        self._unseen_s = self._unseen_s + elapsed
        self._pose = self._pose + np.where((self._unseen_s < UNSEEN_S)[:, None], elapsed * twist, 0.0)
        ages = {number: self._age(number, tick, leader) for number in self._fresh}
        seen, self.age = np.zeros(len(self.ids), bool), np.zeros(len(self.ids))
        for i, number in enumerate(self.ids):
            poses = dict[int, Array]()
            for camera, detection in self._fresh.items():
                robots = [robot for robot in team_robots(detection, self.colour) if robot.robot_id == number]
                candidates = [robot_pose(robot) + ages[camera] * twist[i] for robot in robots]
                if plausible := [pose for pose in candidates if self._is_plausible(i, pose)]:
                    expected = np.nan_to_num(self._pose[i, :2])
                    poses[camera] = min(plausible, key=lambda pose: math.dist(pose[:2], expected))
            if poses:
                self._bias_learner.update(self.cameras, poses)
                self._pose[i], self._unseen_s[i], seen[i] = self._mean(i, poses), 0.0, True
                self.age[i] = np.mean([ages[camera] for camera in poses])
        self._fresh = {}
        self.extrapolation = self.age[:, None] * twist
        return self._pose.copy(), seen

    def _age(self, number: int, tick: float, leader: int | None) -> float:
        """Return how long before the tick a camera took its newest image, s."""
        captured = self._fresh[number].t_capture
        if number != leader:
            captured = self.cameras[number].clock.ours(captured)
            captured = captured if leader is None else self.cameras[leader].clock.theirs(captured)
        return min(max(tick - captured, 0.0), UNSEEN_S)

    def _is_plausible(self, i: int, pose: Array) -> bool:
        """Return whether a robot can have a pose, whose heading is not that of a mirrored pattern."""
        unseen_s, expected = self._unseen_s[i], self._pose[i]
        if not math.isfinite(unseen_s) or np.isnan(expected).any():
            return True
        if math.dist(pose[:2], expected[:2]) > NEAR_M + MAX_SPEED_M_S * unseen_s:
            self.notes.add("wrong id", f"vision sees robot {self.ids[i]} where it cannot be; it is not believed")
            return False
        if unseen_s <= UNSEEN_S and abs(wrap_angle(pose[2] - expected[2])) > MIRRORED_RAD:
            self.notes.add("mirrored", f"vision sees robot {self.ids[i]} the wrong way round; it is not believed")
            return False
        return True

    def _mean(self, i: int, poses: dict[int, Array]) -> Array:
        """Return the mean of what cameras see. Its heading counts full turns from the expected one."""
        unbiased = np.array([pose - self.cameras[number].bias_m_m_rad for number, pose in poses.items()])
        reference = self._pose[i, 2] if np.isfinite(self._pose[i, 2]) else unbiased[0, 2]
        unbiased[:, 2] = reference + wrap_angle(unbiased[:, 2] - reference)
        return unbiased.mean(0)


def _check(detection: Detection) -> None:
    """Raise `WireError` for times, places and headings that are not finite or out of this world."""
    robots = [*detection.robots_blue, *detection.robots_yellow]
    values = np.array([robot_pose(robot) for robot in robots] or np.zeros((0, 3)))
    is_finite = math.isfinite(detection.t_capture) and math.isfinite(detection.t_sent)
    if not is_finite or not (np.abs(values) < MAX_DISTANCE_M).all():
        raise WireError("a time, place or heading is not finite, or out of this world")

"""What can be heard of vision: cameras with their rates, robots with their numbers, and noise."""

import math
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np
from scipy.stats import circmean

from omni_control.kinematics import Array
from omni_mj.live.cameras import VisionCamera
from omni_mj.live.vision import Colour, robot_pose, team_robots
from omni_mj.live.wire.vision_pb2 import Detection

MAX_STORED = 300  # detections of each robot by each camera
STD_OF_MEDIAN = 1.4826  # standard deviation over median magnitude of normal numbers
STD_OF_DIFFERENCES = math.sqrt(6.0)  # standard deviation of a second difference, 1 -2 1, of independent numbers

ByCamera = dict[int, deque[Array]]


class RobotSightings:
    """Stores the last detections of all robots of both teams.

    Attributes:
        cameras: Numbers of those that saw a robot.
    """

    def __init__(self) -> None:
        self.cameras = set[int]()
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self._robots = defaultdict[tuple[Colour, int], ByCamera](dict)

    def add(self, detection: Detection) -> None:
        """Add a detection."""
        for colour in get_args(Colour):
            for robot in team_robots(detection, colour):
                self.cameras.add(detection.camera_id)
                by_camera = self._robots[colour, robot.robot_id]
                by_camera.setdefault(detection.camera_id, deque(maxlen=MAX_STORED)).append(robot_pose(robot))

    def ids(self, colour: Colour) -> list[int]:
        """Return the numbers of a team's robots in order."""
        return sorted(number for team, number in self._robots if team == colour)

    def poses(self, colour: Colour, ids: Sequence[int]) -> Array:
        """Return the median poses of robots at rest, shape (n, 3); NaN for those that were not seen."""
        poses = np.full((len(ids), 3), np.nan)
        for pose, number in zip(poses, ids, strict=True):
            if (colour, number) in self._robots:
                table = np.concatenate([np.array(seen) for seen in self._robots[colour, number].values()])
                pose[:] = *np.median(table[:, :2], axis=0), circmean(table[:, 2], np.pi, -np.pi)
        return poses

    def noise(self, colour: Colour, ids: Sequence[int]) -> dict[str, float]:
        """Return standard deviations of what is seen of robots, by their settings; nothing if that is too little."""
        tables = [np.array(seen) for number in ids for seen in self._robots[colour, number].values()]
        deviations = [_deviations(table) for table in tables if len(table) > 2]
        if not deviations:
            return {}
        position, heading = np.median(deviations, axis=0).tolist()
        return {"vision.position_noise_m": round(position, 6), "vision.heading_noise_rad": round(heading, 5)}

    def describe(self) -> list[str]:
        """Return a line for each robot: where it is, and the noise of its detections."""
        lines = []
        for (colour, number), by_camera in sorted(self._robots.items()):
            tables = [np.array(seen) for seen in by_camera.values()]
            x, y, heading = max(tables, key=len)[-1]
            position, turned = np.mean([_deviations(table) for table in tables], axis=0)
            counts = ", ".join(f"{camera}: {len(seen)}" for camera, seen in by_camera.items())
            lines.append(
                f"{colour} {number}: at {x:.3f}, {y:.3f} m, {math.degrees(heading):.1f}°;"
                f" noise {1e3 * position:.2f} mm, {math.degrees(turned):.2f}°; last detections by camera {counts}"
            )
        return lines


def describe_cameras(cameras: Mapping[int, VisionCamera]) -> list[str]:
    """Return a line for each camera: its rate by its clock and by ours, how old its frames are, what was lost."""
    lines = []
    for number, camera in sorted(cameras.items()):
        lost = 100 * camera.lost / max(camera.frames + camera.lost, 1)
        line = (
            f"camera {number}: {camera.stamped_hz:.2f} frames a second of its clock, {camera.received_hz:.2f} of ours;"
            f" sent {1e3 * camera.mean_age_s:.1f} ms after capture; {lost:.1f} % lost"
        )
        if camera.bias_m_m_rad.any():
            line += "; sees robots {:+.0f}, {:+.0f} mm beside the others".format(*1e3 * camera.bias_m_m_rad[:2])
        lines.append(line)
    return lines


def _deviations(table: Array) -> tuple[float, float]:
    """Return standard deviations of position and heading of a robot that rests or moves steadily."""
    position = np.mean([_deviation(table[:, 0]), _deviation(table[:, 1])])
    return float(position), _deviation(np.unwrap(table[:, 2]))


def _deviation(values: Array) -> float:
    """Return the standard deviation of values, shape (frames,), some of which are wrong; NaN for fewer than three.

    Second differences do not contain steady motion.
    """
    if len(values) < 3:
        return math.nan
    return float(STD_OF_MEDIAN / STD_OF_DIFFERENCES * np.median(np.abs(np.diff(values, n=2))))

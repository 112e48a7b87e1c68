"""What there is to hear: cameras with their rates, robots with their numbers, and the noise of what is seen."""

import math
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from omni_control.kinematics import Array, wrap_angle
from omni_mj.live.cameras import Camera
from omni_mj.live.vision import Colour
from omni_mj.live.wire.vision import DetectedRobot, Detection

KEPT = 300  # detections of each robot by each camera
NORMAL = 1.4826  # standard deviation over median magnitude of normal numbers
DIFFERENCES = math.sqrt(6.0)  # standard deviation of a second difference, 1 -2 1, of independent numbers

Seen = deque[tuple[float, float, float]]  # x, y, heading


class Listener:
    """Remembers what was seen lately of all robots of both teams."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._seen: dict[tuple[Colour, int], dict[int, Seen]] = {}

    def __call__(self, camera: int, detection: Detection) -> None:
        """Take in what a camera saw."""
        teams: dict[Colour, tuple[DetectedRobot, ...]] = {
            "blue": detection.robots_blue,
            "yellow": detection.robots_yellow,
        }
        for colour, robots in teams.items():
            for robot in robots:
                if robot.robot_id is not None and robot.orientation is not None:
                    of = self._seen.setdefault((colour, robot.robot_id), {})
                    of.setdefault(camera, deque(maxlen=KEPT)).append((robot.x, robot.y, robot.orientation))

    def ids(self, colour: Colour) -> list[int]:
        """Numbers of a team's robots that were seen, in order."""
        return sorted(number for team, number in self._seen if team == colour)

    def poses(self, colour: Colour, ids: Sequence[int]) -> Array:
        """Where robots rest, by the middle of what was seen (n, 3); not a number for those that were not."""
        found = np.full((len(ids), 3), np.nan)
        for row, number in enumerate(ids):
            if of := self._seen.get((colour, number)):
                table = np.concatenate([np.array(seen) for seen in of.values()])
                found[row] = *np.median(table[:, :2], axis=0), _middle(table[:, 2])
        return found

    def noise(self, colour: Colour, ids: Sequence[int]) -> dict[str, float]:
        """Standard deviations of what is seen of robots, by their settings; nothing if that is too little."""
        tables = [np.array(seen) for number in ids for seen in self._seen[colour, number].values()]
        tables = [table for table in tables if len(table) > 2]
        if not tables:
            return {}
        return {
            "vision.position_noise_m": round(float(np.median([_position(table) for table in tables])), 6),
            "vision.heading_noise_rad": round(float(np.median([_heading(table) for table in tables])), 5),
        }

    def robots(self) -> list[str]:
        """A line for each robot: where it is, by how many detections of which cameras, and their noise."""
        return [_line(*key, self._seen[key]) for key in sorted(self._seen)]


def cameras(found: Mapping[int, Camera]) -> list[str]:
    """A line for each camera: its rate by its clock and by ours, how old its frames are, what was lost."""
    lines = []
    for number, camera in sorted(found.items()):
        age = 1e3 * camera.age_s
        lost = 100 * camera.lost / max(camera.frames + camera.lost, 1)
        rates = f"{camera.stamped_hz:.2f} frames a second of its clock, {camera.received_hz:.2f} of ours"
        line = f"camera {number}: {rates}; sent {age:.1f} ms after capture; {lost:.1f} % lost"
        bias = 1e3 * camera.bias
        line += f"; sees robots {bias[0]:+.0f}, {bias[1]:+.0f} mm beside the others" if camera.bias.any() else ""
        lines.append(line)
    return lines


def noise(values: Array) -> float:
    """Standard deviation of what is seen of a robot that rests or moves steadily, although some of it is wrong.

    The lesser of two: by second differences, to which steady motion adds nothing, and by distances from the median, of
    which fewer are spoiled by one that is wrong.

    Args:
        values: (frames,); not a number if there are fewer than three.
    """
    if len(values) < 3:
        return math.nan
    by_difference = np.median(np.abs(np.diff(values, n=2))) / DIFFERENCES
    return float(NORMAL * min(by_difference, np.median(np.abs(values - np.median(values)))))


def _position(table: Array) -> float:
    return (noise(table[:, 0]) + noise(table[:, 1])) / 2


def _heading(table: Array) -> float:
    return noise(wrap_angle(table[:, 2] - _middle(table[:, 2])))


def _middle(angles: Array) -> float:
    """The one of several angles to which the others are nearest, rad."""
    return float(angles[np.abs(wrap_angle(angles - angles[:, None])).sum(1).argmin()])


def _line(colour: Colour, number: int, of: Mapping[int, Seen]) -> str:
    tables = [np.array(seen) for seen in of.values()]
    x, y, heading = max(tables, key=len)[-1]
    position, turned = (np.mean([measure(table) for table in tables]) for measure in (_position, _heading))
    seen = ", ".join(f"{camera}: {len(table)}" for camera, table in of.items())
    return (
        f"{colour} {number}: at {x:.3f}, {y:.3f} m, {math.degrees(heading):.1f}°; noise {1e3 * position:.2f} mm,"
        f" {math.degrees(turned):.2f}°; last detections by camera {seen}"
    )

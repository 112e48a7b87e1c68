"""Game logs of the Small Size League, `.log` and `.log.gz`: which robots vision saw where and when.

A file is the text SSL_LOG_FILE, a version (1), and messages: time of receipt in ns, kind, size, bytes. Whole numbers
are big-endian, of 4 bytes but for the time's 8. Kinds that count here are 2 and 4, packets of SSL-Vision of 2010 and
2014, whose detections are alike; 6 is an index at the end. Source: RoboCup-SSL/ssl-logtools and ssl-go-tools.
"""

import gzip
import os
import struct
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.live.wire import MM_PER_M, WireError, parse
from omni_mj.live.wire.vision_pb2 import LoggedPacket

HEADER, MESSAGE = struct.Struct(">12si"), struct.Struct(">qii")
MAGIC, VERSION, GZIP = b"SSL_LOG_FILE", 1, b"\x1f\x8b"
VISION, INDEX = (2, 4), 6
LARGEST = 1 << 20  # bytes of a message; datagrams have 65 kB at most
TEAMS = ("yellow", "blue")
RESTART_S = 0.5  # by which a clock must jump against that of the recorder to have been set anew
APART_S = 0.02  # by which clocks of cameras must differ to be two


@dataclass(frozen=True)
class Sightings:
    """Of robots by cameras, N of them, in the order of the file.

    Attributes:
        team: 0 yellow, 1 blue, (N,).
        robot: its number, (N,).
        camera: (N,).
        time: of the image, s of one clock, (N,).
        pose: x, y in m, heading in rad, (N, 3).
        images: times of all images, by camera.
        notes: what was seen in reading, a line each.
    """

    team: Array
    robot: Array
    camera: Array
    time: Array
    pose: Array
    images: dict[int, Array]
    notes: list[str] = field(default_factory=list)

    def of(self, team: int, robot: int) -> "Sightings":
        """Those of one robot."""
        own = (self.team == team) & (self.robot == robot)
        kept = {name: getattr(self, name)[own] for name in ("team", "robot", "camera", "time", "pose")}
        return Sightings(**kept, images=self.images, notes=self.notes)


def read(path: Path) -> Sightings:
    """All that cameras saw.

    Raises:
        OmniError: the file cannot be read, is no game log, is damaged, or has no vision.
    """
    images, seen, notes = array("d"), array("d"), list[str]()
    for receipt, packet in _packets(path, notes):
        if not packet.HasField("detection"):
            continue
        image = packet.detection
        number = len(images) // 4
        images.extend((receipt, image.t_sent, image.t_capture, image.camera_id))
        for team, robots in enumerate((image.robots_yellow, image.robots_blue)):
            for robot in robots:
                if robot.HasField("robot_id") and robot.HasField("orientation"):
                    place = robot.x / MM_PER_M, robot.y / MM_PER_M
                    seen.extend((number, team, robot.robot_id, *place, robot.orientation))
    rows, whole = np.array(images).reshape(-1, 4), np.array(seen).reshape(-1, 6)
    if not len(rows):
        raise OmniError(f"{path.name} holds no images of SSL-Vision" + "".join(f"; {note}" for note in notes))
    whole = whole[np.isfinite(whole).all(1)]
    time = _clock(rows, notes, path.name)
    number, cameras = whole[:, 0].astype(int), rows[:, 3].astype(int)
    by_camera = {int(camera): np.sort(time[cameras == camera]) for camera in np.unique(cameras)}
    return Sightings(whole[:, 1], whole[:, 2], cameras[number], time[number], whole[:, 3:], by_camera, notes)


def _packets(path: Path, notes: list[str]) -> Iterator[tuple[float, LoggedPacket]]:
    """Times of receipt (s) and packets of vision; a file that is cut off ends there, with a note."""
    if not os.path.isfile(path):
        raise OmniError(f"there is no log {path}")
    name, number = path.name, 0
    try:
        with path.open("rb") as plain:
            packed = plain.read(2) == GZIP
        with gzip.open(path) if packed else path.open("rb") as file:
            head = file.read(HEADER.size)
            if not head.startswith(MAGIC) or len(head) < HEADER.size:
                raise OmniError(f"{name} is no game log: it begins with {head[:12]!r}, not {MAGIC!r}")
            if (version := HEADER.unpack(head)[1]) != VERSION:
                raise OmniError(f"{name} is a game log of version {version}; only {VERSION} is known")
            for receipt, kind, data in _messages(file, name):
                number += 1
                if kind in VISION:
                    yield receipt / 1e9, parse(LoggedPacket, data)
    except EOFError:
        notes.append(f"{name} is cut off after {number} messages; what is before counts")
    except WireError as error:
        raise OmniError(f"{name} is damaged: message {number} is no packet of vision: {error}") from None
    except (OSError, zlib.error) as error:
        raise OmniError(f"{name} cannot be read beyond message {number}: {' '.join(str(error).split())}") from None


def _messages(file: "BinaryIO | gzip.GzipFile", name: str) -> Iterator[tuple[int, int, bytes]]:
    number = 0
    while head := file.read(MESSAGE.size):
        number += 1
        if len(head) < MESSAGE.size:
            raise EOFError
        receipt, kind, size = MESSAGE.unpack(head)
        if kind == INDEX:
            return
        if not 0 <= size <= LARGEST or kind < 0:
            raise OmniError(f"{name} is damaged: message {number} is said to be of kind {kind} and {size} bytes")
        data = file.read(size)
        if len(data) < size:
            raise EOFError
        yield receipt, kind, data


def _clock(images: Array, notes: list[str], name: str) -> Array:
    """Times of images on one clock, that of the first: others, and those that were set anew, by times of receipt.

    Args:
        images: time of receipt, sent, taken, and the camera, (N, 4).
        notes: to which what was seen is added.
        name: of the file.
    """
    receipt, sent, taken, cameras = images.T
    ahead, time = receipt - sent, taken.copy()
    first = None
    for camera in np.unique(cameras):
        own = np.flatnonzero(cameras == camera)
        starts = np.flatnonzero(np.abs(np.diff(ahead[own])) > RESTART_S) + 1
        for part in np.split(own, starts):
            offset = float(np.median(ahead[part]))
            first = offset if first is None else first
            if abs(offset - first) > APART_S:
                time[part] += offset - first
        if len(starts):
            notes.append(
                f"{name}: the clock of camera {camera:.0f} jumped {len(starts)} times; times of receipt bridge it"
            )
    return time

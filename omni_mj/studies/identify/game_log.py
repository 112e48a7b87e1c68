"""Robots in game logs of the Small Size League, `.log` and `.log.gz`.

A file is the text SSL_LOG_FILE, a version (1), and messages: time of receipt in ns, kind, size,
bytes. Numbers are big-endian, of 4 bytes but for the time's 8. Kinds 2 and 4 are packets of
SSL-Vision of 2010 and 2014, whose detections are alike. Source: RoboCup-SSL/ssl-logtools.
"""

import gzip
import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from omni_control.errors import OmniError, printable
from omni_control.kinematics import Array
from omni_mj.live.wire import MM_PER_M, WireError, parse
from omni_mj.live.wire.league_pb2 import LoggedPacket

HEADER, MESSAGE = struct.Struct(">12si"), struct.Struct(">qii")
START = HEADER.pack(b"SSL_LOG_FILE", 1)
VISION = (2, 4)
LARGEST = 1 << 20  # bytes of a message; datagrams have 65 kB at most


def read(path: Path) -> dict[str, dict[int, Array]]:
    """Return what cameras saw: robot (such as ":blue:3"), camera -> time in s and pose, (F, 4).

    A file that is cut off counts as far as it goes.

    Raises:
        OmniError: The file cannot be read, or is damaged.
    """
    if not os.path.isfile(path):
        raise OmniError(f"there is no log {path}")
    seen: dict[str, dict[int, list[tuple[float, ...]]]] = defaultdict(lambda: defaultdict(list))
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            if file.read(HEADER.size) != START:
                raise OmniError(f"{path.name} is no game log of version 1")
            for data in _packets(file):
                image = parse(LoggedPacket, data).detection
                for team, robots in (("yellow", image.robots_yellow), ("blue", image.robots_blue)):
                    for r in robots:
                        if r.HasField("robot_id") and r.HasField("orientation"):
                            sighting = image.t_capture, r.x / MM_PER_M, r.y / MM_PER_M, r.orientation
                            seen[f":{team}:{r.robot_id}"][image.camera_id].append(sighting)
    except EOFError:
        pass  # cut off in a packed file
    except (OSError, zlib.error, WireError) as error:
        raise OmniError(f"{path.name} is damaged: {printable(str(error))}") from None
    return {robot: {camera: np.array(rows) for camera, rows in cameras.items()} for robot, cameras in seen.items()}


def _packets(file: "BinaryIO | gzip.GzipFile") -> Iterator[bytes]:
    """Yield the packets of vision, up to the end or to where the file is cut off."""
    while len(head := file.read(MESSAGE.size)) == MESSAGE.size:
        _, kind, size = MESSAGE.unpack(head)
        if not 0 <= size <= LARGEST:
            raise WireError(f"a message has {size} bytes")
        data = file.read(size)
        if len(data) == size and kind in VISION:
            yield data

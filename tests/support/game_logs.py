"""What the tests of game logs share: files as recorders of the league write them, by hand, of given poses."""

import gzip
import struct
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from serving import vision

EPOCH_S = 1_700_000_000.0
Robots = Mapping[tuple[str, int], NDArray]  # team and number -> poses (F, 3), not a number where it is not seen


def image(
    number: int,
    taken: float,
    robots: Robots,
    camera: int = 0,
    sent: float | None = None,
    offset: tuple[float, float] = (0, 0),
) -> bytes:
    """The packet of one camera's image, which sees all robots that are somewhere, off by a constant."""
    teams: dict[str, list[tuple[int, float, float, float]]] = {"yellow": [], "blue": []}
    for (team, robot), pose in robots.items():
        if np.isfinite(pose).all():
            x, y, heading = (float(value) for value in pose)
            heading = float(np.arctan2(np.sin(heading), np.cos(heading)))
            teams[team].append((robot, x + offset[0], y + offset[1], heading))
    sent = taken + 0.005 if sent is None else sent
    return vision(number, teams["blue"], yellow=teams["yellow"], camera=camera, captured=taken, sent=sent)


def message(receipt_s: float, data: bytes, kind: int = 4) -> bytes:
    """As in the file."""
    return struct.pack(">qii", round(receipt_s * 1e9), kind, len(data)) + data


def whole(messages: Iterable[bytes]) -> bytes:
    """The file."""
    return struct.pack(">12si", b"SSL_LOG_FILE", 1) + b"".join(messages)


def write(path: Path, messages: Iterable[bytes]) -> Path:
    """Write a game log, packed if its name says so."""
    data = whole(messages)
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)
    return path


def of(times: NDArray, robots: Robots, epoch: float = EPOCH_S) -> list[bytes]:
    """Messages of one camera that sees all, with a referee's in between."""
    frames = []
    for number, time in enumerate(times):
        now = {robot: poses[number] for robot, poses in robots.items()}
        taken = epoch + float(time)
        frames.append(message(taken + 0.006, image(number, taken, now)))
        if number % 50 == 0:
            frames.append(message(taken + 0.007, b"\x08\x01", kind=3))
    return frames

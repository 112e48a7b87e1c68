"""Robots in game logs of the Small Size League, `.log` and `.log.gz`.

A file is the text SSL_LOG_FILE, a version (1), and messages: time of receipt in ns, kind, size, bytes. Whole numbers
are big-endian, of 4 bytes but for the time's 8. Kinds 2 and 4 are packets of SSL-Vision of 2010 and 2014, whose
detections are alike; 6 is an index at the end. Source: RoboCup-SSL/ssl-logtools and ssl-go-tools.

Cameras that overlap differ by centimetres, so that a robot is followed in one camera as long as that sees it. Where
another takes over, and where the robot or vision's clock jumps, the log is cut.
"""

import gzip
import os
import struct
import zlib
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
HOLD_S = 0.1  # without a sighting by a camera, from which on another takes over
FASTEST_M_S, NEAR_M, TRIES = 10.0, 0.05, 5  # a sighting farther off is a mistake; that many in a row are not
BREAK_S = 1.0  # put between what does not belong together
LEAST_S, JUMP_S = 1e-3, 0.5  # between two images; by which a clock jumps against the recorder's


@dataclass(frozen=True)
class Track:
    """A robot over time.

    Attributes:
        name: of file and robot.
        clock: vision's, (F,) s; time: from 0 on, with a gap wherever the track is cut, (F,) s.
        pose: (F, 3).
        notes: a line each.
    """

    name: str
    clock: Array
    time: Array
    pose: Array
    notes: list[str] = field(default_factory=list)

    def commanded(self, table: Array, file: str) -> tuple["Track", Array]:
        """Return the track where commands are known, and the mean command from each line to the next, (F, 3).

        Args:
            table: time by vision's clock and twist of each command, which acts until the next, (N, 4).
            file: named in messages.

        Raises:
            OmniError: the clocks have nothing in common.
        """
        sent, period = table[:, 0], float(np.median(np.diff(self.clock)))
        known = (self.clock >= sent[0]) & (self.clock + period <= sent[-1] + 0.1)
        if known.sum() < 2:
            raise OmniError(
                f"{file}: commands from {sent[0]:.3f} to {sent[-1]:.3f} s, but images from {self.clock.min():.3f} to "
                f"{self.clock.max():.3f} s; time_s must be of the clock of vision, t_capture in s"
            )
        clock, time = self.clock[known], self.time[known]
        ends = np.append(sent, max(sent[-1], clock.max()) + BREAK_S)
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(table[:, 1:] * np.diff(ends)[:, None], axis=0)])
        step = np.clip(np.append(np.diff(time), period), LEAST_S, 3 * period)  # not over a gap
        moved = [np.interp(clock + step, ends, one) - np.interp(clock, ends, one) for one in total.T]
        return Track(self.name, clock, time, self.pose[known], self.notes[:-1]), np.stack(moved, 1) / step[:, None]


def follow(path: Path, team: str | None, number: int | None) -> Track:
    """Follow a robot through a game log.

    Args:
        path: of the log.
        team: yellow or blue.
        number: of the robot. Without both, the log must hold one robot only.

    Raises:
        OmniError: the log cannot be read, or it is not clear which robot is meant.
    """
    notes = list[str]()
    rows = np.array(list(_sightings(path, notes))).reshape(-1, 8)
    if not len(rows):
        raise OmniError(f"{path.name} holds no images of SSL-Vision" + "".join(f"; {note}" for note in notes))
    rows = rows[np.isfinite(rows).all(1)]
    robots = {(int(t), int(r)): rows[(rows[:, 0] == t) & (rows[:, 1] == r)] for t, r in np.unique(rows[:, :2], axis=0)}
    chosen = [(t, r) for t, r in robots if team in (None, TEAMS[t]) and number in (None, r)]
    if len(chosen) != 1:
        moves = "; ".join(f"{TEAMS[t]} {r} {_moves(seen)}" for (t, r), seen in robots.items())
        asked = " ".join(str(word) for word in (team, number) if word is not None)
        what = f"{'several are' if chosen else 'there is no'} {asked}" if asked else "which robot is meant"
        example = next((f"{TEAMS[t]}:{r}" for t, r in robots), "yellow:3")
        raise OmniError(
            f"{path.name}: {what}; name one, as {path.name}:{example}, or --team and --id; it holds {moves or 'none'}"
        )
    name = f"{path.name} ({TEAMS[chosen[0][0]]} {chosen[0][1]})"
    believed, cuts = _track(robots[chosen[0]])
    time = believed[:, 3] - believed[0, 3] + BREAK_S * np.cumsum(cuts)
    time -= np.cumsum(cuts * np.diff(believed[:, 3], prepend=believed[0, 3]))
    if cuts.any():
        notes.append(
            f"{name}: cut {cuts.sum()} times, where another camera takes over, or the robot or the clock jumps"
        )
    speed = np.hypot(*np.diff(believed[:, 5:7], axis=0).T) / np.maximum(np.diff(time), LEAST_S)
    fast = np.quantile(speed, 0.99) if len(speed) else 0.0
    notes.append(
        f"{name}: poses alone, up to {fast:.2f} m/s (99 %), tell nothing of latency, gains, creep, lags or drag; give "
        "commands: LOG,commands.csv"
    )
    return Track(name, believed[:, 3], time, believed[:, 5:], notes)


def _moves(seen: Array) -> str:
    """Say how long a robot is seen, and how far it goes: steps of 0.2 s that are longer than noise."""
    time, position = seen[:, 3] - seen[0, 3], seen[:, 5:7]
    steps = np.unique(np.searchsorted(np.maximum.accumulate(time), np.arange(0, time.max() + 1e-9, 0.2)))
    lengths = np.hypot(*np.diff(position[steps], axis=0).T)
    return f"moves {lengths[lengths > 0.02].sum():.1f} m in {time.max():.0f} s"


def _track(seen: Array) -> tuple[Array, Array]:
    """Return the sightings that are believed, and before which of them the track is cut."""
    believed, cuts, elsewhere = [seen[0]], [False], 0
    for row in seen[1:]:
        last = believed[-1]
        step, received = row[3] - last[3], row[4] - last[4]
        jumped = abs(step - received) > JUMP_S
        if not jumped and (step < LEAST_S or (row[2] != last[2] and received < HOLD_S)):
            continue
        away = np.hypot(*(row[5:7] - last[5:7])) > FASTEST_M_S * max(step, LEAST_S) + NEAR_M
        elsewhere = elsewhere + 1 if away and not jumped else 0
        if 0 < elsewhere < TRIES and row[2] == last[2]:
            continue
        cuts.append(bool(jumped or elsewhere or row[2] != last[2]))
        believed.append(row)
        elsewhere = 0
    return np.array(believed), np.array(cuts)


def _sightings(path: Path, notes: list[str]) -> Iterator[tuple[float, ...]]:
    """Yield team, number, camera, time of the image and of receipt in s, and pose; note where a file is cut off."""
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
                image = parse(LoggedPacket, data if kind in VISION else b"").detection
                for team, robots in enumerate((image.robots_yellow, image.robots_blue)):
                    for r in robots:
                        if r.HasField("robot_id") and r.HasField("orientation"):
                            place = r.x / MM_PER_M, r.y / MM_PER_M, r.orientation
                            yield (team, r.robot_id, image.camera_id, image.t_capture, receipt / 1e9, *place)
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

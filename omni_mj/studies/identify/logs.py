"""Read logs of robots: CSV, Parquet and game logs; docs/identify.md names the columns.

From trajectory.parquet of omni-mj, `vision_*` where valid, `command_*` and `wheel_angle_*` are
taken. Each controller, seed and place is a log of its own.

A game log of the Small Size League is the text SSL_LOG_FILE, a version (1), and messages: time of
receipt in ns, kind, size, bytes. Numbers are big-endian, of 4 bytes but for the time's 8. Kinds 2
and 4 are packets of SSL-Vision of 2010 and 2014, whose detections are alike. Source:
RoboCup-SSL/ssl-logtools.
"""

import gzip
import os
import re
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from omni_control.errors import OmniError, choose, printable
from omni_control.kinematics import Array
from omni_mj import parquet
from omni_mj.live.wire import MM_PER_M, WireError, parse
from omni_mj.live.wire.league_pb2 import LoggedPacket

if TYPE_CHECKING:
    import pyarrow as pa

    Columns = dict[str, pa.ChunkedArray]

POSE = ("x_m", "y_m", "heading_rad")
VISION = ("vision_x_m", "vision_y_m", "vision_heading_rad")
OURS = ("command_vx_m_s", "command_vy_m_s", "command_w_rad_s")
WORLD = ("vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s")
BODY = ("vx_cmd_body_m_s", "vy_cmd_body_m_s", "w_cmd_rad_s")
WHEELS = ("wheel_{}_rad", "wheel_angle_{}_rad", "wheel_{}_rad_s")
INPUTS = f"commands ({', '.join(WORLD)}; or {', '.join(BODY)}) or wheels (wheel_1_rad or wheel_1_rad_s, ...)"
LEAST_LINES = 30
GAP = 3.5  # periods without a line, from which a log is cut in two
GAME = re.compile(r"(?P<file>.+\.log(?:\.gz)?)(?P<robot>:(?:yellow|blue):\d+)?(?:,(?P<commands>.+))?")
HEADER, MESSAGE = struct.Struct(">12si"), struct.Struct(">qii")
START = HEADER.pack(b"SSL_LOG_FILE", 1)
PACKETS = (2, 4)
LARGEST = 1 << 20  # bytes of a message; datagrams have 65 kB at most


@dataclass(frozen=True)
class RobotLog:
    """F lines of one robot.

    Attributes:
        name: File, and the row in it.
        time: Increasing, (F,) s.
        pose: Measured, world frame, heading continuous, (F, 3). NaN where the robot was not seen.
        command: Twists that act until the next line, (F, 3), or None.
        in_body: Whether commands are along the body's axes.
        wheels: Mean speeds from each line to the next, (F, W) rad/s, or None.
        notes: Remarks on the data.
    """

    name: str
    time: Array
    pose: Array
    command: Array | None
    in_body: bool
    wheels: Array | None
    notes: Sequence[str] = ()


def read(word: Path | str) -> list[RobotLog]:
    """Return the logs in a file.

    Args:
        word: Path of a CSV or Parquet file; or of a game log, with a robot and a file of the
            commands that were sent to it: `GAME.log.gz:blue:3,commands.csv`.

    Raises:
        OmniError: The file cannot be read, columns are missing, or time does not increase.
    """
    if game := GAME.fullmatch(str(word)):
        return _read_game(Path(game["file"]), game["robot"], game["commands"])
    path = Path(word)
    columns = _table(path)
    angles, wheels = _wheel_names(columns)
    command = _command_names(columns)
    _require(path, columns, ("time_s", *POSE), [*command, *wheels])
    pose = _numbers(path, columns, VISION if columns.keys() >= set(VISION) else POSE)
    if "vision_valid" in columns:
        pose[~columns["vision_valid"].to_numpy().astype(bool)] = np.nan
    time, commands, wheel_values = (_numbers(path, columns, names) for names in (["time_s"], command, wheels))
    keys = [columns[key].to_pylist() for key in ("controller", "seed", "place") if key in columns]
    rows = np.array([" ".join(map(str, row)) for row in zip(*keys, strict=True)] or [""] * len(time), str)
    logs = []
    for row in dict.fromkeys(rows.tolist()) or [""]:
        lines = np.flatnonzero(rows == row)
        name = f"{path.name} ({row})" if row else path.name
        logs.append(
            _clean(
                RobotLog(
                    name,
                    time[lines, 0],
                    pose[lines],
                    commands[lines] if command else None,
                    command == BODY,
                    _mean_speeds(time[lines, 0], wheel_values[lines], angles) if wheels else None,
                )
            )
        )
    return logs


def integrate(time: Array, inputs: Array) -> BSpline:
    """Return the integral over time of inputs (F, K), each of which acts until the next line."""
    ends = np.append(time, time[-1] + 1)
    total = np.cumsum(np.diff(ends)[:, None] * inputs, axis=0)
    return make_interp_spline(ends, np.concatenate([np.zeros_like(total[:1]), total]), k=1)


def _read_game(path: Path, robot: str | None, commands: str | None) -> list[RobotLog]:
    """Return the logs of a robot in a game log: one for each camera and each start of vision."""
    sightings = _read_sightings(path)
    if robot not in sightings or commands is None:
        raise OmniError(
            f"{path.name}: name a robot and a file of the commands that it was sent, as "
            f"{path.name}:yellow:3,commands.csv; robots are {', '.join(sightings) or 'not in it'}"
        )
    table = Path(commands)
    columns = _table(table)
    names = _command_names(columns)
    _require(table, columns, ("time_s",), names)
    values = _numbers(table, columns, ("time_s", *names))
    _check_time(table.name, values[:, 0])
    total = integrate(values[:, 0], values[:, 1:])
    logs = []
    for camera, seen in sightings[robot].items():
        for piece in np.split(seen, np.flatnonzero(np.diff(seen[:, 0]) < 0) + 1):
            known = piece[np.isfinite(piece).all(1) & (piece[:, 0] >= values[0, 0]) & (piece[:, 0] <= values[-1, 0])]
            if len(known) >= LEAST_LINES:
                clock = known[:, 0]
                period = np.median(np.diff(clock))
                step = np.clip(np.diff(clock, append=clock[-1] + period), 1e-3, GAP * period)
                twist = (total(clock + step) - total(clock)) / step[:, None]
                name = f"{path.name} ({robot[1:].replace(':', ' ')}, camera {camera})"
                logs.append(_clean(RobotLog(name, clock, known[:, 1:], twist, names == BODY, None)))
    if not logs:
        raise OmniError(
            f"{table.name}: fewer than {LEAST_LINES} images of {path.name} are within its times; time_s must be "
            "by the clock of vision, t_capture in s"
        )
    return logs


def _read_sightings(path: Path) -> dict[str, dict[int, Array]]:
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
        if len(data) == size and kind in PACKETS:
            yield data


def _clean(log: RobotLog) -> RobotLog:
    """Return a log without repeated lines and poses, with continuous headings.

    Raises:
        OmniError: There are too few lines, times are wrong, or commands are missing.
    """
    _check_time(log.name, log.time, least_step=0.0)
    new = np.diff(log.time, prepend=-np.inf) > 0
    if new.sum() < LEAST_LINES:
        raise OmniError(f"{log.name}: {new.sum()} times are too few; at least {LEAST_LINES}")
    time, pose = log.time[new], log.pose[new]
    held = np.append(False, (np.diff(pose, axis=0) == 0).all(1))
    pose[held] = np.nan
    known = np.isfinite(pose[:, 2])
    pose[known, 2] = np.unwrap(pose[known, 2])
    inputs = [None if values is None else values[new] for values in (log.command, log.wheels)]
    for what, values in zip(("commands", "wheels"), inputs, strict=True):
        if values is not None and not np.isfinite(values).all():
            raise OmniError(f"{log.name}: {what} are missing in line {np.argmin(np.isfinite(values).all(1)) + 1}")
    notes = []
    if (~new).any():
        notes.append(f"{log.name}: {(~new).sum()} lines have the time of the line before; left out")
    if held.any():
        notes.append(f"{log.name}: {held.sum()} lines repeat the pose of the line before; taken as not seen")
    return RobotLog(log.name, time, pose, inputs[0], log.in_body, inputs[1], notes)


def _check_time(name: str, time: Array, least_step: float = 1e-9) -> None:
    if not np.isfinite(time).all():
        raise OmniError(f"{name}: time_s is missing in line {np.argmin(np.isfinite(time)) + 1}")
    if (bad := np.diff(time) < least_step).any():
        raise OmniError(f"{name}: time_s does not increase from line {bad.argmax() + 1} to {bad.argmax() + 2}")


def _require(path: Path, columns: "Columns", needed: Sequence[str], inputs: Sequence[str]) -> None:
    for name in needed:
        if name not in columns:
            raise OmniError(f"{path.name}: column {name} is missing; {choose(name, columns)}")
    if not inputs:
        raise OmniError(f"{path.name}: neither commands nor wheels; give {INPUTS}")


def _command_names(columns: "Columns") -> Sequence[str]:
    return next((names for names in (OURS, WORLD, BODY) if columns.keys() >= set(names)), ())


def _wheel_names(columns: "Columns") -> tuple[bool, list[str]]:
    """Return whether columns of wheels are angles, and their names."""
    for pattern in WHEELS:
        if names := list(takewhile(columns.__contains__, map(pattern.format, count(1)))):
            return pattern.endswith("_rad"), names
    return False, []


def _mean_speeds(time: Array, values: Array, angles: bool) -> Array:
    """Return mean speeds from each line to the next; the last line repeats the one before."""
    with np.errstate(divide="ignore", invalid="ignore"):  # lines of the same time are left out later
        means = np.diff(values, axis=0) / np.diff(time)[:, None] if angles else (values[1:] + values[:-1]) / 2
    return np.concatenate([means, means[-1:]])


def _table(path: Path) -> "Columns":
    """Return the columns of a CSV or Parquet file by their names in lower case.

    Raises:
        OmniError: There is no such file, or it is no table.
    """
    import pyarrow as pa

    readers = {".csv": _read_csv, ".parquet": parquet.read}
    if path.suffix.lower() not in readers:
        raise OmniError(f"{path}: a log is a .csv or .parquet file with named columns, or a game log, .log or .log.gz")
    if not os.path.isfile(path):
        raise OmniError(f"there is no log {path}")
    try:
        table = readers[path.suffix.lower()](path)
        names = [printable(name).strip("# \"'").lower() for name in table.column_names]
    except (pa.ArrowException, OSError, UnicodeError) as error:
        raise OmniError(f"{path} cannot be read: {printable(str(error))}") from None
    return dict(zip(names, table.columns, strict=True))


def _read_csv(path: Path) -> "pa.Table":
    """Read a CSV file separated by commas, semicolons or tabs; the latter two may have decimal commas."""
    import pyarrow as pa
    import pyarrow.csv

    with path.open(encoding="utf-8", errors="replace") as text:
        header, row = text.readline(), text.readline()
    separator = max(",;\t", key=header.count)
    with pa.OSFile(os.fsencode(path)) as file:  # as in `omni_mj.parquet`
        return pyarrow.csv.read_csv(
            file,
            parse_options=pa.csv.ParseOptions(delimiter=separator),
            convert_options=pa.csv.ConvertOptions(decimal_point="," if separator != "," and "," in row else "."),
        )


def _numbers(path: Path, columns: "Columns", names: Sequence[str]) -> Array:
    """Return columns of numbers, (F, names)."""
    import pyarrow as pa

    values = [np.zeros((len(columns["time_s"]), 0))]
    for name in names:
        try:
            values.append(columns[name].cast("float64").to_numpy()[:, None])
        except pa.ArrowException as error:
            raise OmniError(f"{path.name}: column {name} must hold numbers: {printable(str(error), 200)}") from None
    return np.concatenate(values, axis=1)

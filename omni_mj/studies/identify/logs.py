"""Logs of robots: CSV, Parquet or game logs, read into `Log`s; docs/identify.md names the columns.

Of our own trajectory.parquet `vision_*` where valid, `command_*` and `wheel_angle_*` are taken, each controller, seed
and place by itself.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import count, pairwise, takewhile
from pathlib import Path

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.studies.identify import game_log, tables

POSE = ("x_m", "y_m", "heading_rad")
VISION = ("vision_x_m", "vision_y_m", "vision_heading_rad")
OURS = ("command_vx_m_s", "command_vy_m_s", "command_w_rad_s")
WORLD = ("vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s")
BODY = ("vx_cmd_body_m_s", "vy_cmd_body_m_s", "w_cmd_rad_s")
ANGLES, SPEEDS = ("wheel_{}_rad", "wheel_angle_{}_rad"), ("wheel_{}_rad_s", "wheel_speed_{}_rad_s")
USED = re.compile(r"time_s|received_s|(vision_)?(x_m|y_m|heading_rad)|.*cmd.*|command_.*|wheel_.*")
GAP = 3.5  # periods without a line, from which a log is cut in two
LEAST_LINES = 30
GAME = re.compile(r"(?P<file>.+\.log(?:\.gz)?)(?::(?P<team>yellow|blue|):(?P<robot>\d*))?(?:,(?P<commands>.+))?")


@dataclass(frozen=True)
class Log:
    """F lines of one robot.

    Attributes:
        name: of the file, and of the row in it.
        time: increasing, (F,) s.
        pose: measured, world frame, heading continuous, (F, 3); not a number where there was none.
        command: twists (F, 3), or None; in_body: whether they are along the body's axes.
        wheels: mean speeds from each line to the next, (F, W) rad/s, or None.
        notes: a line each.
        received: when the robot got each line's command, (F,) s by any clock; not a number if never; or None.
    """

    name: str
    time: Array
    pose: Array
    command: Array | None
    in_body: bool = False
    wheels: Array | None = None
    notes: list[str] = field(default_factory=list)
    received: Array | None = None

    def __post_init__(self) -> None:
        """Unwrap headings, and note gaps."""
        known = np.isfinite(self.pose[:, 2])
        self.pose[known, 2] = np.unwrap(self.pose[known, 2])
        if gaps := [self.time[piece.start] - self.time[piece.start - 1] for piece in self.pieces()[1:]]:
            longest, at = max(gaps), self.time[self.pieces()[1 + int(np.argmax(gaps))].start]
            self.notes.append(f"{self.name}: {len(gaps)} gaps, the longest of {longest:.3g} s before {at:.3f} s")

    @property
    def period(self) -> float:
        """Median time from line to line, s."""
        return float(np.median(np.diff(self.time)))

    def pieces(self) -> list[slice]:
        """Return the lines between gaps."""
        cuts = np.flatnonzero(np.diff(self.time) > GAP * self.period) + 1
        return [slice(a, b) for a, b in pairwise([0, *cuts.tolist(), len(self.time)])]


def read(path: Path) -> list[Log]:
    """Return the logs in a file.

    Args:
        path: of a CSV or Parquet file, or of a game log, with the robot and a file of commands:
            `GAME.log.gz:blue:3,commands.csv`.

    Raises:
        OmniError: it cannot be read, columns are missing, or time does not increase.
    """
    if game := GAME.fullmatch(str(path)):
        return [_game(**game.groupdict())]
    columns = tables.read(path)
    for name in ("time_s", *POSE):
        if name not in columns:
            near = get_close_matches(name, columns, 1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise OmniError(
                f"{path.name}: column {name} is missing; {hint}necessary are time_s, {', '.join(POSE)}, and commands "
                f"({', '.join(WORLD)}; or {', '.join(BODY)}) or wheels (wheel_1_rad or wheel_1_rad_s, ...)"
            )
    if _commands(columns) is None and _first_numbered(columns, ANGLES + SPEEDS) is None:
        raise OmniError(
            f"{path.name}: neither commands nor wheels; give {', '.join(WORLD)} (along the field's axes), or "
            f"{', '.join(BODY)} (along the robot's), or wheel_1_rad or wheel_1_rad_s, ..."
        )
    tables.numeric(path, columns, filter(USED.fullmatch, columns))
    return [
        _log(name, {key: values[lines] for key, values in columns.items()}) for name, lines in _rows(path.name, columns)
    ]


def of_robot(path: Path, team: str | None, number: int | None) -> Path:
    """Return a game log with its robot, in a form that `read` takes; other logs as they are."""
    game = GAME.fullmatch(str(path))
    if game is None or game["team"] or (team is None and number is None):
        return path
    commands = f",{game['commands']}" if game["commands"] else ""
    return Path(f"{game['file']}:{team or ''}:{'' if number is None else number}{commands}")


def _game(file: str, team: str | None, robot: str | None, commands: str | None) -> Log:
    track, sent, in_body = game_log.follow(Path(file), team or None, int(robot) if robot else None), None, False
    if commands:
        path = Path(commands)
        columns = tables.read(path)
        if "time_s" not in columns or (named := _commands(columns)) is None:
            raise OmniError(f"{path.name}: commands are time_s and {', '.join(WORLD)}, or {', '.join(BODY)}")
        tables.numeric(path, columns, ("time_s", *named))
        table = _stack(columns, ("time_s", *named))
        _increases(path.name, table[:, 0])
        if not np.isfinite(table).all():
            raise OmniError(f"{path.name}: lines with missing numbers; each needs {', '.join(('time_s', *named))}")
        track, sent = track.commanded(table, path.name)
        in_body = named is BODY
    if len(track.time) < LEAST_LINES:
        raise OmniError(f"{track.name}: {len(track.time)} images of it are too few; at least {LEAST_LINES}")
    return Log(track.name, track.time, track.pose, sent, in_body, None, track.notes)


def _log(name: str, columns: dict[str, np.ndarray]) -> Log:
    notes = list[str]()
    if len(columns["time_s"]) >= LEAST_LINES:
        again = np.append(False, np.diff(columns["time_s"]) == 0)
        for values in columns.values():
            empty = values != values
            again[1:] &= (values[1:] == values[:-1]) | (empty[1:] & empty[:-1])
        if again.any():
            notes.append(f"{name}: {again.sum()} lines are there twice; once is enough")
            columns = {key: values[~again] for key, values in columns.items()}
    time = columns["time_s"].astype(float)
    if len(time) < LEAST_LINES:
        raise OmniError(f"{name}: {len(time)} lines are too few; at least {LEAST_LINES}")
    _increases(name, time)
    pose = _stack(columns, VISION if all(key in columns for key in VISION) else POSE)
    if "vision_valid" in columns:
        pose[~columns["vision_valid"].astype(bool)] = np.nan
    held = _held(time, pose)
    if held.any():
        pose[held] = np.nan
        notes.append(f"{name}: {held.sum()} lines repeat the pose before them while the robot moves; taken as not seen")
    named = _commands(columns)
    command = None if named is None else _stack(columns, named)
    received = columns["received_s"].astype(float) if "received_s" in columns and named else None
    return Log(name, time, pose, command, named is BODY, _wheels(time, columns), notes, received)


def _rows(name: str, columns: Mapping[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and lines of each controller, seed and place of a recording of ours, else all lines."""
    keys = [key for key in ("controller", "seed", "place") if key in columns]
    whose = np.array([" ".join(map(str, line)) for line in zip(*(columns[key] for key in keys), strict=True)])
    for one in dict.fromkeys(whose.tolist()):
        yield f"{name} ({one})", np.flatnonzero(whose == one)
    if not keys:
        yield name, np.arange(len(columns["time_s"]))


def _commands(columns: Mapping[str, np.ndarray]) -> tuple[str, ...] | None:
    return next((names for names in (OURS, WORLD, BODY) if all(name in columns for name in names)), None)


def _stack(columns: Mapping[str, np.ndarray], names: tuple[str, ...]) -> Array:
    return np.stack([columns[name].astype(float) for name in names], axis=1)


def _first_numbered(columns: Mapping[str, np.ndarray], names: tuple[str, ...]) -> Array | None:
    """Return columns 1, 2, ... of the first of these names that is there, (F, n), or None."""
    for name in names:
        if names_found := tuple(takewhile(columns.__contains__, map(name.format, count(1)))):
            return _stack(columns, names_found)
    return None


def _increases(name: str, time: Array) -> None:
    if (lost := ~np.isfinite(time)).any():
        raise OmniError(f"{name}: time_s is missing in line {lost.argmax() + 1}")
    if (bad := np.diff(time) <= 0).any():
        at = bad.argmax()
        what = "stands still (too few digits?)" if time[at] == time[at + 1] else "goes back"
        message = f"time_s does not increase from line {at + 1} to {at + 2}, it {what}"
        raise OmniError(f"{name}: {message}: {time[at]:.10g}, {time[at + 1]:.10g}")


def _held(time: Array, pose: Array) -> np.ndarray:
    """Return which lines repeat a pose while the robot moves, as recorders do that are faster than the camera, (F,)."""
    same = np.append(False, (np.diff(pose, axis=0) == 0).all(1))
    window = max(1, round(0.1 / float(np.median(np.diff(time)))))
    lines = np.arange(len(time))
    far, near = np.minimum(lines + window, len(time) - 1), np.maximum(lines - window, 0)
    moved = np.hypot(*(pose[far, :2] - pose[near, :2]).T) + 0.1 * np.abs(pose[far, 2] - pose[near, 2])
    held = same & (moved > 0.05 * (time[far] - time[near]))
    return held & (held.mean() > 0.02)


def _wheels(time: Array, columns: Mapping[str, np.ndarray]) -> Array | None:
    """Return mean speeds from each line to the next; the last line has that before."""
    angles, speeds = _first_numbered(columns, ANGLES), _first_numbered(columns, SPEEDS)
    if angles is not None:
        means = np.diff(angles, axis=0) / np.diff(time)[:, None]
    elif speeds is not None:
        means = (speeds[1:] + speeds[:-1]) / 2
    else:
        return None
    return np.concatenate([means, means[-1:]])

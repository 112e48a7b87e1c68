"""Logs of robots: CSV, Parquet or game logs, read into `Log`s, with a clear line for what they cannot be.

| columns | meaning |
|---|---|
| `time_s` | when the camera saw the pose of this line, and when its command was sent |
| `x_m, y_m, heading_rad` | the pose that was measured, world frame; empty where there was none |
| `vx_cmd_world_m_s, vy_cmd_world_m_s, w_cmd_rad_s` | commanded velocity along the field's axes |
| `vx_cmd_body_m_s, vy_cmd_body_m_s, w_cmd_rad_s` | or along the robot's own, x forward, y to the left |
| `wheel_1_rad, ...` or `wheel_1_rad_s, ...` | angles, or speeds, of the wheels behind the gear, in the file's order |
| `current_1_a, ...` and `voltage_1_v, ...` | of the motors, at the time of the line, signs as the wheels' |
| `coasting` | 1 where motors carry no current, and the robot rolls out |

Our own trajectory.parquet is one too: of it `vision_*`, where valid, `command_*` and `wheel_angle_*` are taken, each
controller, seed and place by itself. Game logs of the league have poses alone (`game_log`, `game_robot`).
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from omni_control.errors import OmniError, choose
from omni_control.kinematics import Array
from omni_mj.studies.identify import game_robot, tables, units
from omni_mj.studies.identify.motor_columns import Motors

POSE = ("x_m", "y_m", "heading_rad")
VISION = ("vision_x_m", "vision_y_m", "vision_heading_rad")
OURS = ("command_vx_m_s", "command_vy_m_s", "command_w_rad_s")
WORLD = ("vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s")
BODY = ("vx_cmd_body_m_s", "vy_cmd_body_m_s", "w_cmd_rad_s")
RECEIVED = "received_s"
NAMES = ("time_s", RECEIVED, *POSE, *WORLD, *BODY[:2], "wheel_1_rad", "wheel_1_rad_s")
GAP = 3.5  # periods without a line, from which on a log is cut in two
LEAST_LINES = 30
TOLD = 3  # gaps that are named
MOTOR = re.compile(r"(mean_)?(current_\d+_a|voltage_\d+_v)")
GAME = re.compile(r"(?P<file>.+\.log(?:\.gz)?)(?::(?P<team>yellow|blue|):(?P<robot>\d*))?(?:,(?P<commands>.+))?")


@dataclass(frozen=True)
class Log:
    """One robot's lines, F of them, in time.

    Attributes:
        name: of the file, and of the row in it.
        time: (F,) s, increasing.
        pose: measured (F, 3), world frame, heading continuous; not a number where there was none.
        command: (F, 3) or None.
        in_body: whether the command is in the body's axes; else in the world's.
        wheels: speeds (F, wheels) rad/s, means from each line to the next, or None.
        notes: what was seen in reading it, a line each.
        motors: what was measured of them, or None.
        received: when the robot got each line's command, by any clock, (F,) s, not a number if never; or None.
    """

    name: str
    time: Array
    pose: Array
    command: Array | None
    in_body: bool
    wheels: Array | None
    notes: list[str] = field(default_factory=list)
    motors: Motors | None = None
    received: Array | None = None

    @property
    def period(self) -> float:
        """The median time from line to line, s."""
        return float(np.median(np.diff(self.time)))

    def pieces(self) -> list[slice]:
        """Stretches of lines without a gap."""
        cuts = np.flatnonzero(np.diff(self.time) > GAP * self.period) + 1
        edges = [0, *cuts.tolist(), len(self.time)]
        return [slice(a, b) for a, b in pairwise(edges)]

    def part(self, lines: slice) -> "Log":
        """Some lines of it."""
        command, wheels = (None if each is None else each[lines] for each in (self.command, self.wheels))
        time, pose = self.time[lines], self.pose[lines]
        return replace(self, time=time, pose=pose, command=command, wheels=wheels, notes=[], motors=None, received=None)


def read(path: Path) -> list[Log]:
    """The logs in a file.

    Args:
        path: of a CSV or Parquet file, or of a game log, with the robot and a file of commands: `GAME.log.gz:blue:3`,
            `GAME.log.gz:blue:3,commands.csv`.

    Raises:
        OmniError: it cannot be read, columns are missing, time does not increase, or units cannot be those said.
    """
    if game := GAME.fullmatch(str(path)):
        return [_game(**game.groupdict())]
    columns = tables.read(path)
    _whole(path, columns)
    logs = []
    for name, lines in _rows(path.name, columns):
        logs.append(_log(name, {key: values[lines] for key, values in columns.items()}))
    return logs


def of_robot(path: Path, team: str | None, number: int | None) -> Path:
    """A game log with the robot that is meant, in a form that `read` takes; other logs as they are."""
    game = GAME.fullmatch(str(path))
    if game is None or game["team"] or (team is None and number is None):
        return path
    commands = f",{game['commands']}" if game["commands"] else ""
    return Path(f"{game['file']}:{team or ''}:{'' if number is None else number}{commands}")


def files(log: Path) -> tuple[str, list[Path]]:
    """What a log is read from: the word that `read` takes, with {} in place of each file; and these."""
    game = GAME.fullmatch(str(log))
    if game is None:
        return "{}", [log]
    robot = "" if game["team"] is None else f":{game['team']}:{game['robot']}"
    commands = [Path(game["commands"])] if game["commands"] else []
    return "{}" + robot + ",{}" * len(commands), [Path(game["file"]), *commands]


def _game(file: str, team: str | None, robot: str | None, commands: str | None) -> Log:
    """A robot of a game log."""
    name, found = game_robot.track(Path(file), team or None, int(robot) if robot else None)
    command, in_body, more = None, False, list[str]()
    if commands:
        path = Path(commands)
        columns = tables.read(path)
        named = next((names for names in (WORLD, BODY) if all(each in columns for each in names)), None)
        if named is None or "time_s" not in columns:
            raise OmniError(f"{path.name}: commands are time_s and {', '.join(WORLD)}, or {', '.join(BODY)}")
        tables.numeric(path, columns, ("time_s", *named))
        wanted = {each: columns[each].astype(float) for each in ("time_s", *named)}
        _increases(path.name, wanted["time_s"])
        if not np.isfinite(np.stack(list(wanted.values()))).all():
            raise OmniError(f"{path.name}: lines with missing numbers; each needs {', '.join(wanted)}")
        found, command = game_robot.with_commands(found, wanted, named, path.name)
        in_body = named is BODY
    elif len(found.time) >= LEAST_LINES:
        more = game_robot.seen_of(found, name)
    if len(found.time) < LEAST_LINES:
        raise OmniError(f"{name}: {len(found.time)} images of it are too few; at least {LEAST_LINES}")
    log = Log(name, game_robot.apart(found), found.pose, command, in_body, None, [*found.notes, *more])
    return _ready(log)


def _whole(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Tell what columns are missing, or hold no numbers."""
    for name in ("time_s", *POSE):
        if name not in columns:
            have = f"did you mean {near}? " if (near := _near(name, columns)) else ""
            raise OmniError(
                f"{path.name}: column {name} is missing; {have}necessary are time_s, {', '.join(POSE)}, and commands "
                f"({', '.join(WORLD)}; or {', '.join(BODY)}) or wheels (wheel_1_rad or wheel_1_rad_s, ...)"
            )
    of_wheels = [name for ending in ("_rad", "_rad_s") for name in wheel_columns(columns, ending)]
    if not of_wheels and not any(all(name in columns for name in names) for names in (OURS, WORLD, BODY)):
        raise OmniError(
            f"{path.name}: neither commands nor wheels; give {', '.join(WORLD)} (along the field's axes), or "
            f"{', '.join(BODY)} (along the robot's), or wheel_1_rad or wheel_1_rad_s, ..."
        )
    of_motors = [name for name in columns if MOTOR.fullmatch(name)]
    tables.numeric(path, columns, (*NAMES, *OURS, *VISION, *of_wheels, *of_motors))


def _near(name: str, columns: Mapping[str, np.ndarray]) -> str:
    hint = choose(name, columns)
    return hint.split("'")[1] if hint.startswith("did you mean") else ""


def wheel_columns(columns: Mapping[str, np.ndarray], ending: str) -> list[str]:
    """Names of the columns of wheels 1, 2, ..., as far as there are."""
    for stem in ("wheel_", "wheel_angle_" if ending == "_rad" else "wheel_speed_"):
        names = list[str]()
        while (name := f"{stem}{len(names) + 1}{ending}") in columns:
            names.append(name)
        if names:
            return names
    return []


def _rows(name: str, columns: Mapping[str, np.ndarray]) -> Iterator[tuple[str, np.ndarray]]:
    """Lines of each controller, seed and place; of all, where the log is no recording of ours."""
    keys = [key for key in ("controller", "seed", "place") if key in columns]
    if not keys:
        yield name, np.arange(len(columns["time_s"]))
        return
    whose = [" ".join(map(str, line)) for line in zip(*(columns[key] for key in keys), strict=True)]
    for one in dict.fromkeys(whose):
        yield f"{name} ({one})", np.flatnonzero(np.array(whose) == one)


def _log(name: str, columns: dict[str, np.ndarray]) -> Log:
    time = columns["time_s"].astype(float)
    if len(time) < LEAST_LINES:
        raise OmniError(f"{name}: {len(time)} lines are too few; at least {LEAST_LINES}")
    time, columns, notes = _once(name, time, columns)
    _increases(name, time)
    pose = np.stack([columns[key].astype(float) for key in POSE], axis=1)
    if all(key in columns for key in VISION):
        pose = np.stack([columns[key].astype(float) for key in VISION], axis=1)
        if "vision_valid" in columns:
            pose[~columns["vision_valid"].astype(bool)] = np.nan
    command, in_body = None, False
    for names in (OURS, WORLD, BODY):
        if all(key in columns for key in names):
            command, in_body = np.stack([columns[key].astype(float) for key in names], axis=1), names is BODY
            break
    held = _held(time, pose)
    if held.any():
        pose[held] = np.nan
        notes.append(f"{name}: {held.sum()} lines repeat the pose before them while the robot moves; taken as not seen")
    wheels, motors = _wheels(time, columns), Motors.of(columns)
    received = columns[RECEIVED].astype(float) if RECEIVED in columns and command is not None else None
    return _ready(Log(name, time, pose, command, in_body, wheels, notes, motors, received))


def _ready(log: Log) -> Log:
    """With continuous headings and notes of its gaps, if its units can be those said."""
    units.check(log, LEAST_LINES)
    log.pose[:, 2] = _continuous(log.pose[:, 2])
    gaps = [piece.start for piece in log.pieces()[1:]]
    for start in gaps[:TOLD]:
        before, after = log.time[start - 1], log.time[start]
        log.notes.append(
            f"{log.name}: a gap of {after - before:.3g} s at {before:.3f} s; what is on its two sides is apart"
        )
    if len(gaps) > TOLD:
        log.notes.append(f"{log.name}: {len(gaps) - TOLD} more gaps")
    return log


def _once(name: str, time: Array, columns: dict[str, np.ndarray]) -> tuple[Array, dict[str, np.ndarray], list[str]]:
    """Lines without those that are all as the one before."""
    same = np.append(False, np.diff(time) == 0)
    for values in columns.values():
        again = values[1:] == values[:-1]
        if values.dtype.kind == "f":
            again |= np.isnan(values[1:]) & np.isnan(values[:-1])
        same[1:] &= again
    if not same.any():
        return time, columns, []
    kept = {key: values[~same] for key, values in columns.items()}
    return time[~same], kept, [f"{name}: {same.sum()} lines are there twice; once is enough"]


def _increases(name: str, time: Array) -> None:
    if (lost := ~np.isfinite(time)).any():
        raise OmniError(f"{name}: time_s is missing in line {int(np.argmax(lost)) + 1}")
    bad = np.flatnonzero(~(np.diff(time) > 0))
    if bad.size:
        at, what = bad[0] + 1, "stands still (too few digits?)" if time[bad[0]] == time[bad[0] + 1] else "goes back"
        raise OmniError(
            f"{name}: time_s does not increase from line {at} to {at + 1}, it {what}: {time[at - 1]:.10g}, "
            f"{time[at]:.10g}"
        )


def _held(time: Array, pose: Array) -> np.ndarray:
    """Which lines repeat a pose that was seen before, as recorders do that are faster than the camera, (F,).

    Of a robot that rests, nothing is held: without noise, one pose is as good as another.
    """
    same = np.append(False, (np.diff(pose, axis=0) == 0).all(1))
    window = max(1, round(0.1 / float(np.median(np.diff(time)))))
    far, near = np.minimum(np.arange(len(time)) + window, len(time) - 1), np.maximum(np.arange(len(time)) - window, 0)
    moved = np.hypot(*(pose[far, :2] - pose[near, :2]).T) + 0.1 * np.abs(pose[far, 2] - pose[near, 2])
    held = same & (moved > 0.05 * (time[far] - time[near]))
    return held if held.mean() > 0.02 else np.zeros(len(time), bool)


def _wheels(time: Array, columns: Mapping[str, np.ndarray]) -> Array | None:
    """Mean speeds from each line to the next; the last line's is that before."""
    if names := wheel_columns(columns, "_rad"):
        angles = np.stack([columns[name].astype(float) for name in names], axis=1)
        means = np.diff(angles, axis=0) / np.diff(time)[:, None]
    elif names := wheel_columns(columns, "_rad_s"):
        speeds = np.stack([columns[name].astype(float) for name in names], axis=1)
        means = (speeds[1:] + speeds[:-1]) / 2
    else:
        return None
    return np.concatenate([means, means[-1:]])


def _continuous(heading: Array) -> Array:
    """Without jumps of whole turns, across lines without a pose too."""
    there = np.isfinite(heading)
    heading = heading.copy()
    heading[there] = np.unwrap(heading[there])
    return heading

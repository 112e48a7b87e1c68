"""Logs of robots: CSV or Parquet with named columns, read into `Log`s, with a clear line for what they cannot be.

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
controller, seed and place by itself.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from omni_control.errors import OmniError, choose
from omni_control.kinematics import Array
from omni_mj.studies.identify.motor_columns import Motors

POSE = ("x_m", "y_m", "heading_rad")
VISION = ("vision_x_m", "vision_y_m", "vision_heading_rad")
OURS = ("command_vx_m_s", "command_vy_m_s", "command_w_rad_s")
WORLD = ("vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s")
BODY = ("vx_cmd_body_m_s", "vy_cmd_body_m_s", "w_cmd_rad_s")
NAMES = ("time_s", *POSE, *WORLD, *BODY[:2], "wheel_1_rad", "wheel_1_rad_s")
GAP = 3.5  # periods without a line, from which on a log is cut in two
LEAST_LINES = 30


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
    """

    name: str
    time: Array
    pose: Array
    command: Array | None
    in_body: bool
    wheels: Array | None
    notes: list[str] = field(default_factory=list)
    motors: Motors | None = None

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
        return replace(self, time=time, pose=pose, command=command, wheels=wheels, notes=[], motors=None)


def read(path: Path) -> list[Log]:
    """The logs in a file.

    Raises:
        OmniError: it cannot be read, columns are missing, time does not increase, or units cannot be those said.
    """
    columns = _columns(path)
    _whole(path, columns)
    logs = []
    for name, lines in _rows(path.name, columns):
        logs.append(_log(name, {key: values[lines] for key, values in columns.items()}))
    return logs


def _columns(path: Path) -> dict[str, np.ndarray]:
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    if not path.is_file():
        raise OmniError(f"there is no log {path}")
    try:
        if path.suffix == ".parquet":
            table = pa.parquet.read_table(path)
        elif path.suffix == ".csv":
            table = pa.csv.read_csv(path)
        else:
            raise OmniError(f"{path}: a log is a .csv or .parquet file with named columns")
    except (pa.ArrowException, OSError) as error:
        raise OmniError(f"{path} cannot be read: {' '.join(str(error).split())}") from None
    return {name: table[name].to_numpy() for name in table.column_names}


def _whole(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Tell what columns are missing, or hold no numbers."""
    for name in ("time_s", *POSE):
        if name not in columns:
            have = f"did you mean {near}? " if (near := _near(name, columns)) else ""
            raise OmniError(
                f"{path.name}: column {name} is missing; {have}necessary are time_s, {', '.join(POSE)}, and commands "
                f"({', '.join(WORLD)}; or {', '.join(BODY)}) or wheels (wheel_1_rad or wheel_1_rad_s, ...)"
            )
    wheels = any(wheel_columns(columns, ending) for ending in ("_rad", "_rad_s"))
    if not wheels and not any(all(name in columns for name in names) for names in (OURS, WORLD, BODY)):
        raise OmniError(
            f"{path.name}: neither commands nor wheels; give {', '.join(WORLD)} (along the field's axes), or "
            f"{', '.join(BODY)} (along the robot's), or wheel_1_rad or wheel_1_rad_s, ..."
        )
    for name in columns:
        if name in NAMES and columns[name].dtype.kind not in "fiu":
            raise OmniError(f"{path.name}: column {name} holds something else than numbers")


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


def _log(name: str, columns: Mapping[str, np.ndarray]) -> Log:
    time = columns["time_s"].astype(float)
    if len(time) < LEAST_LINES:
        raise OmniError(f"{name}: {len(time)} lines are too few; at least {LEAST_LINES}")
    bad = np.flatnonzero(~(np.diff(time) > 0))
    if bad.size:
        at = bad[0] + 1
        raise OmniError(f"{name}: time_s does not increase from line {at} to {at + 1}: {time[at - 1]:g}, {time[at]:g}")
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
    log = Log(name, time, pose, command, in_body, _wheels(time, columns), motors=Motors.of(columns))
    _units(log)
    log.pose[:, 2] = _continuous(pose[:, 2])
    for piece in log.pieces()[1:]:
        before, after = time[piece.start - 1], time[piece.start]
        log.notes.append(
            f"{name}: a gap of {after - before:.3g} s at {before:.3f} s; what is on its two sides is apart"
        )
    return log


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


def _units(log: Log) -> None:
    """Raise where numbers cannot be in the units that the columns' names say."""
    seen = np.isfinite(log.pose).all(1)
    if seen.sum() < LEAST_LINES:
        raise OmniError(f"{log.name}: {seen.sum()} lines with a pose are too few; at least {LEAST_LINES}")
    if not 1e-3 <= log.period <= 0.5:
        hint = "in ms?" if log.period > 0.5 else "in another unit than s?"
        raise OmniError(f"{log.name}: {log.period:g} s from line to line; is time_s {hint}")
    heading, steps = log.pose[seen, 2], np.diff(log.time[seen])
    jumps = np.abs(np.diff(heading))
    if np.abs(heading[0]) > 2.1 * np.pi or (np.abs(jumps - 360) < 20).any() or _fast(jumps / steps, 45):
        raise OmniError(f"{log.name}: headings of up to {np.abs(heading).max():.0f} rad; is heading_rad in degrees?")
    moved = np.hypot(*np.diff(log.pose[seen, :2], axis=0).T) / steps
    if _fast(moved, 10):
        raise OmniError(f"{log.name}: speeds of {np.quantile(moved, 0.95):.0f} m/s; are x_m and y_m in mm?")
    if log.command is None:
        return
    if not np.isfinite(log.command).all():
        raise OmniError(f"{log.name}: commands are missing in line {np.argmin(np.isfinite(log.command).all(1)) + 1}")
    if _fast(np.hypot(*log.command[:, :2].T), 10):
        raise OmniError(f"{log.name}: commands of {np.abs(log.command[:, :2]).max():.0f} m/s; are they in mm/s?")
    if _fast(np.abs(log.command[:, 2]), 60):
        raise OmniError(
            f"{log.name}: turn rates of {np.abs(log.command[:, 2]).max():.0f} rad/s; are they in degrees/s?"
        )


def _fast(values: Array, limit: float) -> bool:
    """Whether more than one in twenty is above a limit: single jumps are not a matter of units."""
    return bool(np.quantile(values, 0.95) > limit)

"""Read logs of robots: CSV and Parquet; docs/how-to/identify-a-robot.md names the columns.

From trajectory.parquet of omni-mj, `vision_*` where valid, `command_*` and `wheel_angle_*` are
taken. Each controller, seed and place is a log of its own.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count, takewhile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from omni_control.errors import OmniError, suggest_names, to_printable
from omni_control.kinematics import Array
from omni_mj import parquet

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


@dataclass(frozen=True)
class RobotLog:
    """F lines of one robot.

    Attributes:
        name: File, and the row in it.
        time: Increasing, (F,) s.
        pose: Measured, world frame, heading continuous, (F, 3). NaN where the robot was not seen.
        inputs: By source: "wheels", mean speeds from each line to the next, (F, W) rad/s;
            "commands", twists that act until the next line, (F, 3).
        in_body: Whether commands are along the body's axes.
    """

    name: str
    time: Array
    pose: Array
    inputs: Mapping[str, Array]
    in_body: bool


def read(file: Path | str) -> list[RobotLog]:
    """Return the logs in a CSV or Parquet file.

    Raises:
        OmniError: The file cannot be read, columns are missing, or time does not increase.
    """
    path = Path(file)
    columns = _table(path)
    angles, wheels = _wheel_names(columns)
    command = next((names for names in (OURS, WORLD, BODY) if columns.keys() >= set(names)), ())
    for name in ("time_s", *POSE):
        if name not in columns:
            raise OmniError(
                f"{path.name}: column {name} is missing; {suggest_names(name, columns)}"
            )
    if not command and not wheels:
        raise OmniError(f"{path.name}: neither commands nor wheels; give {INPUTS}")
    pose = _numbers(path, columns, VISION if columns.keys() >= set(VISION) else POSE)
    if "vision_valid" in columns:
        pose[~columns["vision_valid"].to_numpy().astype(bool)] = np.nan
    time = _numbers(path, columns, ["time_s"])[:, 0]
    named = {"wheels": wheels, "commands": command}
    inputs = {source: _numbers(path, columns, names) for source, names in named.items() if names}
    keys = [columns[key].to_pylist() for key in ("controller", "seed", "slot") if key in columns]
    rows = np.array(
        [" ".join(map(str, row)) for row in zip(*keys, strict=True)] or [""] * len(time), str
    )
    logs = []
    for row in dict.fromkeys(rows.tolist()) or [""]:
        lines = np.flatnonzero(rows == row)
        own = {source: values[lines] for source, values in inputs.items()}
        if wheels:
            own["wheels"] = _mean_speeds(time[lines], own["wheels"], angles)
        name = f"{path.name} ({row})" if row else path.name
        logs.append(_clean(RobotLog(name, time[lines], pose[lines], own, command == BODY)))
    return logs


def integrate(time: Array, inputs: Array) -> BSpline:
    """Return the integral over time of inputs (F, K), each of which acts until the next line."""
    ends = np.append(time, time[-1] + 1)
    total = np.cumsum(np.diff(ends)[:, None] * inputs, axis=0)
    return make_interp_spline(ends, np.concatenate([np.zeros_like(total[:1]), total]), k=1)


def _clean(log: RobotLog) -> RobotLog:
    """Return a log without repeated lines and poses, with continuous headings.

    Raises:
        OmniError: There are too few lines, times are wrong, or commands are missing.
    """
    if not np.isfinite(log.time).all():
        raise OmniError(
            f"{log.name}: time_s is missing in line {np.argmin(np.isfinite(log.time)) + 1}"
        )
    if (back := np.diff(log.time) < 0).any():
        raise OmniError(
            f"{log.name}: time_s does not increase from line {back.argmax() + 1} to {back.argmax() + 2}"
        )
    new = np.diff(log.time, prepend=-np.inf) > 0
    if new.sum() < LEAST_LINES:
        raise OmniError(f"{log.name}: {new.sum()} times are too few; at least {LEAST_LINES}")
    time, pose = log.time[new], log.pose[new]
    held = np.append(False, (np.diff(pose, axis=0) == 0).all(1))
    pose[held] = np.nan
    known = np.isfinite(pose[:, 2])
    pose[known, 2] = np.unwrap(pose[known, 2])
    inputs = {source: values[new] for source, values in log.inputs.items()}
    for source, values in inputs.items():
        if not np.isfinite(values).all():
            raise OmniError(
                f"{log.name}: {source} are missing in line {np.argmin(np.isfinite(values).all(1)) + 1}"
            )
    return replace(log, time=time, pose=pose, inputs=inputs)


def _wheel_names(columns: "Columns") -> tuple[bool, list[str]]:
    """Return whether columns of wheels are angles, and their names."""
    for pattern in WHEELS:
        if names := list(takewhile(columns.__contains__, map(pattern.format, count(1)))):
            return pattern.endswith("_rad"), names
    return False, []


def _mean_speeds(time: Array, values: Array, angles: bool) -> Array:
    """Return mean speeds from each line to the next; the last line repeats the one before."""
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # lines of the same time are left out later
        means = (
            np.diff(values, axis=0) / np.diff(time)[:, None]
            if angles
            else (values[1:] + values[:-1]) / 2
        )
    return np.concatenate([means, means[-1:]])


def _table(path: Path) -> "Columns":
    """Return the columns of a CSV or Parquet file by their names in lower case.

    Raises:
        OmniError: There is no such file, or it is no table.
    """
    import pyarrow as pa

    readers = {".csv": _read_csv, ".parquet": parquet.read_table}
    if path.suffix.lower() not in readers:
        raise OmniError(f"{path}: a log is a .csv or .parquet file with named columns")
    if not os.path.isfile(path):
        raise OmniError(f"there is no log {path}")
    try:
        table = readers[path.suffix.lower()](path)
        names = [to_printable(name).strip("# \"'").lower() for name in table.column_names]
    except (pa.ArrowException, OSError, UnicodeError) as error:
        raise OmniError(f"{path} cannot be read: {to_printable(str(error))}") from None
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
            convert_options=pa.csv.ConvertOptions(
                decimal_point="," if separator != "," and "," in row else "."
            ),
        )


def _numbers(path: Path, columns: "Columns", names: Sequence[str]) -> Array:
    """Return columns of numbers, (F, names)."""
    import pyarrow as pa

    values = [np.zeros((len(columns["time_s"]), 0))]
    for name in names:
        try:
            values.append(columns[name].cast("float64").to_numpy()[:, None])
        except pa.ArrowException as error:
            raise OmniError(
                f"{path.name}: column {name} must hold numbers: {to_printable(str(error), 200)}"
            ) from None
    return np.concatenate(values, axis=1)

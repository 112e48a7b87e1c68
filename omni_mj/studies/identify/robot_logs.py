"""Read logs of robots from CSV and Parquet files.

docs/how-to/identify-a-robot.md names the columns. A trajectory.parquet of omni-mj is read too: its
columns `vision_*` (where valid), `command_*` and `wheel_angle_*`. Each controller, seed and slot is
a separate log.
"""

import csv
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
from scipy.interpolate import BSpline, make_interp_spline

from omni_control.errors import OmniError, suggest_names, to_printable
from omni_control.kinematics import Array
from omni_mj.config import toml_files
from omni_mj.io import parquet

Columns = dict[str, pa.ChunkedArray]

POSE_COLUMNS = ("x_m", "y_m", "heading_rad")
VISION_COLUMNS = ("vision_x_m", "vision_y_m", "vision_heading_rad")
TRAJECTORY_COMMANDS = ("command_vx_m_s", "command_vy_m_s", "command_w_rad_s")  # world frame
WORLD_COMMANDS = ("vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s")
BODY_COMMANDS = ("vx_cmd_body_m_s", "vy_cmd_body_m_s", "w_cmd_rad_s")
WHEEL_PATTERNS = ("wheel_{}_rad", "wheel_angle_{}_rad", "wheel_{}_rad_s")
INPUTS_TEXT = (
    f"commands ({', '.join(WORLD_COMMANDS)}; or {', '.join(BODY_COMMANDS)}) or wheels "
    "(wheel_1_rad or wheel_1_rad_s, ...)"
)
# Names of the columns that are read
KNOWN_COLUMN = re.compile(
    "|".join(
        ["time_s", *POSE_COLUMNS, *VISION_COLUMNS, "vision_valid", "controller", "seed", "slot"]
        + [*TRAJECTORY_COMMANDS, *WORLD_COMMANDS, *BODY_COMMANDS]
        + [pattern.format(r"\d+") for pattern in WHEEL_PATTERNS]
    )
)
# Unit of a column -> unit in which it is read, and factor
UNITS = {
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "ns": ("s", 1e-9),
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "deg": ("rad", np.pi / 180),
    "mm_s": ("m_s", 1e-3),
    "deg_s": ("rad_s", np.pi / 180),
    "rpm": ("rad_s", np.pi / 30),
}
SEPARATORS = ",;\t| "
MAX_HEADER_LINES, MAX_HEADER_BYTES = 50, 100_000  # at the start of a file, with column names
MIN_LINES = 30
MAX_GAP_PERIODS = 3.5  # a longer gap splits a log
MIN_PERIOD_S, MAX_PERIOD_S = 5e-4, 0.5  # from line to line


@dataclass(frozen=True)
class RobotLog:
    """Log of one robot with F lines.

    Attributes:
        name: File name; with controller, seed and slot if the file has several robots.
        time: Increasing times of the lines, (F,) s.
        pose: Measured poses with unwrapped headings, world frame, (F, 3). NaN without a detection.
        inputs: Mapping from source to inputs. "wheels": mean wheel speeds from each line to the
            next, (F, W) rad/s. "commands": twists that act until the next line, (F, 3).
        in_body: Whether commands are in the body frame.
    """

    name: str
    time: Array
    pose: Array
    inputs: dict[str, Array]
    in_body: bool


def read_logs(file: Path | str) -> list[RobotLog]:
    """Read the logs in a CSV or Parquet file, one log per robot.

    Raises:
        OmniError: The file cannot be read, columns or values are missing, or time does not
            increase.
    """
    path = Path(file)
    columns = _read_columns(path)
    is_angle, wheels = _wheel_columns(path, columns)
    command_sets = (TRAJECTORY_COMMANDS, WORLD_COMMANDS, BODY_COMMANDS)
    command = next((names for names in command_sets if columns.keys() >= set(names)), ())
    for name in ("time_s", *POSE_COLUMNS):
        if name not in columns:
            choices = suggest_names(name, columns)
            raise OmniError(f"{path.name}: column {name} is missing; {choices}")
    if not command and not wheels:
        raise OmniError(f"{path.name}: neither commands nor wheels; give {INPUTS_TEXT}")
    has_vision = columns.keys() >= set(VISION_COLUMNS)
    pose = _to_numbers(path, columns, VISION_COLUMNS if has_vision else POSE_COLUMNS)
    if "vision_valid" in columns:
        pose[~columns["vision_valid"].to_numpy().astype(bool)] = np.nan
    time = _to_numbers(path, columns, ["time_s"])[:, 0]
    sources = {"wheels": wheels, "commands": command}
    inputs = {
        source: _to_numbers(path, columns, names) for source, names in sources.items() if names
    }
    robots = _robot_names(columns, len(time))
    logs = []
    for robot in dict.fromkeys(robots.tolist()) or [""]:
        lines = np.flatnonzero(robots == robot)
        robot_inputs = {source: values[lines] for source, values in inputs.items()}
        name = f"{path.name} ({robot})" if robot else path.name
        in_body = command == BODY_COMMANDS
        log = _clean(RobotLog(name, time[lines], pose[lines], robot_inputs, in_body))
        if wheels:
            speeds = _mean_speeds(log.time, log.inputs["wheels"], is_angle)
            log = replace(log, inputs=log.inputs | {"wheels": speeds})
        logs.append(log)
    return logs


def has_pose(pose: Array) -> np.ndarray:
    """Return whether each line has a pose, (F,), for poses (F, 3)."""
    return np.asarray(np.isfinite(pose).all(1))


def integrate_inputs(time: Array, inputs: Array) -> BSpline:
    """Return the integral of inputs (F, K) as a function of time.

    Each input acts until the time of the next line, the last one for 1 s.
    """
    ends = np.append(time, time[-1] + 1)
    total = np.cumsum(np.diff(ends)[:, None] * inputs, axis=0)
    return make_interp_spline(ends, np.pad(total, [(1, 0), (0, 0)]), k=1)


def integrate_windows(time: Array, inputs: Array, start: Array, window: float) -> Array:
    """Return the integrals of inputs over windows, (..., K).

    Args:
        time: Times of the lines, (F,) s.
        inputs: Inputs (F, K); see `integrate_inputs`.
        start: Start times of the windows, (...) s.
        window: Duration of each window, s.
    """
    integral = integrate_inputs(time, inputs)
    return integral(start + window) - integral(start)


def _robot_names(columns: Columns, lines: int) -> np.ndarray:
    """Return controller, seed and slot of each line as text; empty without such columns."""
    keys = [columns[key].to_pylist() for key in ("controller", "seed", "slot") if key in columns]
    names = [" ".join(map(str, values)) for values in zip(*keys, strict=True)]
    return np.array(names or [""] * lines, str)


def _clean(log: RobotLog) -> RobotLog:
    """Return a log with unwrapped headings, without repeated lines and poses.

    Raises:
        OmniError: There are too few lines, times are not valid, or commands are missing.
    """
    _require_finite(f"{log.name}: time_s is", log.time)
    decreases = np.diff(log.time) < 0
    if decreases.any():
        line = decreases.argmax() + 1
        raise OmniError(f"{log.name}: time_s does not increase from line {line} to {line + 1}")
    is_new = np.diff(log.time, prepend=-np.inf) > 0
    if is_new.sum() < MIN_LINES:
        raise OmniError(f"{log.name}: {is_new.sum()} times are too few; at least {MIN_LINES}")
    time, pose = log.time[is_new], log.pose[is_new]
    period = float(np.median(np.diff(time)))
    if not MIN_PERIOD_S <= period <= MAX_PERIOD_S:
        raise OmniError(f"{log.name}: {period:g} s from line to line; time_s must be in s")
    pose[~np.isfinite(pose)] = np.nan
    is_repeated = (np.diff(pose, axis=0) == 0).all(1)
    pose[1:][is_repeated] = np.nan
    has_heading = np.isfinite(pose[:, 2])
    pose[has_heading, 2] = np.unwrap(pose[has_heading, 2])
    inputs = {source: values[is_new] for source, values in log.inputs.items()}
    for source, values in inputs.items():
        _require_finite(f"{log.name}: {source} are", values)
    return replace(log, time=time, pose=pose, inputs=inputs)


def _require_finite(subject: str, values: Array) -> None:
    """Raise OmniError, which starts with a subject, if a line (F, ...) has no finite value."""
    invalid_indices = np.argwhere(~np.isfinite(values))
    if invalid_indices.size:
        raise OmniError(f"{subject} missing or infinite in line {invalid_indices[0, 0] + 1}")


def _wheel_columns(path: Path, columns: Columns) -> tuple[bool, list[str]]:
    """Return whether the columns of wheels hold angles, and the names of these columns.

    Raises:
        OmniError: The numbers of wheels do not start with 1, or one is missing.
    """
    for pattern in WHEEL_PATTERNS:
        present = sorted(filter(re.compile(pattern.format(r"\d+")).fullmatch, columns))
        names = [pattern.format(i + 1) for i in range(len(present))]
        if set(names) != set(present):
            raise OmniError(
                f"{path.name}: columns {', '.join(present)}: wheels are numbered from 1, "
                "without gaps"
            )
        if names:
            return pattern.endswith("_rad"), names
    return False, []


def _mean_speeds(time: Array, values: Array, is_angle: bool) -> Array:
    """Return mean speeds from each line to the next; the last line repeats the previous one.

    Args:
        time: Times of the lines, (F,) s.
        values: Wheel angles in rad, or wheel speeds in rad/s, (F, W). Angles that all lie within
            one turn are unwrapped.
        is_angle: Whether the values are angles.
    """
    if is_angle:
        if np.ptp(values) <= 2 * np.pi:
            values = np.unwrap(values, axis=0)
        means = np.diff(values, axis=0) / np.diff(time)[:, None]
    else:
        means = (values[1:] + values[:-1]) / 2
    return np.concatenate([means, means[-1:]])


def _read_columns(path: Path) -> Columns:
    """Return the columns of a CSV or Parquet file by their names in lower case, in SI units.

    Raises:
        OmniError: The file does not exist, is not a table, or has a known column twice.
    """
    readers = {".csv": _read_csv, ".parquet": parquet.read_table}
    if path.suffix.lower() not in readers:
        raise OmniError(f"{path}: a log is a .csv or .parquet file with named columns")
    if not os.path.isfile(path):
        raise OmniError(f"there is no log {path}")
    try:
        arrow_table = readers[path.suffix.lower()](path)
        names, factors = zip(*map(_normalize_name, arrow_table.column_names), strict=True)
    except (pa.ArrowException, OSError, ValueError, csv.Error) as error:
        raise OmniError(f"{path} cannot be read: {to_printable(str(error), 200)}") from None
    for name in filter(KNOWN_COLUMN.fullmatch, names):
        if names.count(name) > 1:
            raise OmniError(f"{path.name}: column {name} is there twice; leave one")
    columns = dict(zip(names, arrow_table.columns, strict=True))
    for name, factor in zip(names, factors, strict=True):
        if factor != 1:
            columns[name] = pa.chunked_array([factor * _to_numbers(path, columns, [name])[:, 0]])
    return columns


def _normalize_name(name: str) -> tuple[str, float]:
    """Return a column's name with the unit in which it is read, and the factor to this unit.

    The name is in lower case, without comment signs, quotes and spaces. `Heading [deg]` becomes
    heading_rad, with the factor pi / 180.
    """
    name = re.sub(r"\s*[\[(](.*)[\])]$", r"_\1", name.strip("# \"'").lower())
    name = to_printable(name.replace("/", "_").replace("°", "deg"))
    name = re.sub(r"_([a-z]+(?:_s)?)_\1$", r"_\1", name)  # x_m [m]
    for unit, (si_unit, factor) in UNITS.items():
        si_name = name.removesuffix(unit) + si_unit
        if name.endswith(f"_{unit}") and KNOWN_COLUMN.fullmatch(si_name):
            return si_name, factor
    return name, 1.0


def _read_csv(path: Path) -> pa.Table:
    """Read a CSV file.

    The line with the names and the separator are those with the most known names. The decimal
    separator is the one with which most known columns are numbers.
    """
    with path.open("rb") as file:
        head = file.read(MAX_HEADER_BYTES)
    # Only the first lines are decoded here. Arrow decodes the others.
    lines = re.split(r"\r?\n|\r", toml_files.decode_utf8(head, "replace"))
    choices = [
        (number, separator, next(csv.reader([line.lstrip("# ")], delimiter=separator), []))
        for number, line in enumerate(lines[:MAX_HEADER_LINES])
        for separator in SEPARATORS
    ]
    number, separator, names = max(choices, key=lambda choice: _count_known_names(choice[2]))
    if not any(lines[number + 1 :]):
        raise ValueError("Empty CSV file: no line below the names of columns")
    arrow_tables = []
    for decimal_point in ".,":
        with pa.OSFile(os.fsencode(path)) as file:  # as in `omni_mj.io.parquet`
            arrow_table = pa.csv.read_csv(
                file,
                read_options=pa.csv.ReadOptions(skip_rows=number + 1, column_names=names),
                parse_options=pa.csv.ParseOptions(delimiter=separator),
                convert_options=pa.csv.ConvertOptions(decimal_point=decimal_point),
            )
        arrow_tables.append(arrow_table)
    return max(arrow_tables, key=_count_number_columns)


def _count_known_names(names: Iterable[str]) -> int:
    """Return how many names are those of columns that `identify` reads."""
    return sum(KNOWN_COLUMN.fullmatch(_normalize_name(name)[0]) is not None for name in names)


def _count_number_columns(arrow_table: pa.Table) -> int:
    """Return the number of known columns that hold numbers."""
    return _count_known_names(
        field.name for field in arrow_table.schema if not pa.types.is_string(field.type)
    )


def _to_numbers(path: Path, columns: Columns, names: Sequence[str]) -> Array:
    """Return columns as numbers, (F, names).

    Raises:
        OmniError: A column holds values that are not numbers.
    """
    values = []
    for name in names:
        try:
            values.append(columns[name].cast("float64").to_numpy())
        except pa.ArrowException as error:
            reason = to_printable(str(error), 200)
            raise OmniError(f"{path.name}: column {name} must hold numbers: {reason}") from None
    return np.column_stack(values)

"""Read logs of robots from CSV and Parquet files.

docs/how-to/identify-a-robot.md names the columns. A trajectory.parquet of omni-mj is read too: its
columns `vision_*` (where valid), `command_*` and `wheel_angle_*`. Each controller, seed and slot is
a separate log.
"""

import csv
import os
import re
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
from scipy.interpolate import BSpline, make_interp_spline

from omni_control.errors import MAX_LINE_LENGTH, OmniError, list_first, suggest_names, to_printable
from omni_control.kinematics import Array
from omni_mj.config import toml_files
from omni_mj.io import parquet
from omni_mj.io.free_memory import require_memory
from omni_mj.io.printable_text import format_count
from omni_mj.studies.identify.measured_lines import (
    ROUNDING,
    find_measured_lines,
    find_step,
    interpolate_measurements,
    restore_even_times,
)

Columns = dict[str, np.ndarray]

POSE_COLUMNS = ("x_m", "y_m", "heading_rad")
VISION_COLUMNS = ("vision_x_m", "vision_y_m", "vision_heading_rad")
TRAJECTORY_COMMANDS = ("command_vx_m_s", "command_vy_m_s", "command_w_rad_s")  # world frame
WORLD_COMMANDS = ("vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s")
BODY_COMMANDS = ("vx_cmd_body_m_s", "vy_cmd_body_m_s", "w_cmd_rad_s")
WHEEL_PATTERNS = ("wheel_{}_rad", "wheel_angle_{}_rad", "wheel_{}_rad_s")
ROBOT_COLUMNS = ("controller", "seed", "slot")
DATE_COLUMNS = ("time", "timestamp")  # read as time_s if they hold dates
DATE_TYPES = (pa.timestamp("ns"), pa.timestamp("ns", "UTC"), pa.duration("ns"))
INPUTS_TEXT = (
    f"commands ({', '.join(WORLD_COMMANDS)}; or {', '.join(BODY_COMMANDS)}) or wheels "
    "(wheel_1_rad or wheel_1_rad_s, ...)"
)
# Names of the columns that are read
KNOWN_COLUMN = re.compile(
    "|".join(
        ["time_s", *POSE_COLUMNS, *VISION_COLUMNS, "vision_valid", *ROBOT_COLUMNS]
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
MAX_NAME_LENGTH = 100  # of a column that is read
BLOCK_BYTES = 1 << 20  # of a CSV file, which Arrow reads at once; a line must be shorter
MIN_LINES, MAX_LINES = 30, 5_000_000
MAX_STEPS = {"positions": (0.1, "m"), "headings": (0.2, "rad"), "wheel speeds": (10.0, "rad/s")}
# Values in larger steps, and inputs that are held for more lines, get a remark.
FINE_TIME_STEP_S, FINE_SPEED_STEP_RAD_S, MAX_HOLD = 2e-3, 2.0, 1.5
COARSE = "; finer ones give better results"
FINE_STEP_M = 1e-4  # of positions in finer steps, an exact repetition is never a measurement
MAX_WRAPPED_RAD = 2 * np.pi + 0.01  # range of wheel angles within one turn, rounded
MAX_UNWRAPPED_RAD = 2.5  # change from line to line; from pi on, the direction is ambiguous
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
        pose_steps: Steps of measured poses in m, m and rad, (3,); see `find_step`.
        remarks: Remarks about coarse times and inputs, one line each.
    """

    name: str
    time: Array
    pose: Array
    inputs: dict[str, Array]
    in_body: bool
    pose_steps: Array = field(default_factory=lambda: np.zeros(3))
    remarks: tuple[str, ...] = ()

    def select(self, lines: np.ndarray | list[int]) -> "RobotLog":
        """Return the log with some of its lines, given by numbers or as a mask."""
        inputs = {source: values[lines] for source, values in self.inputs.items()}
        return replace(self, time=self.time[lines], pose=self.pose[lines], inputs=inputs)

    def add_remark(self, remark: str) -> "RobotLog":
        """Return the log with another remark."""
        return replace(self, remarks=(*self.remarks, f"{self.name}: {remark}"))


class Source(NamedTuple):
    """Column of a file.

    Attributes:
        name: Its name in the file.
        factor: Factor to SI units; 0 for dates, which need no unit.
    """

    name: str
    factor: float


class CsvHeader(NamedTuple):
    """Start of a CSV file.

    Attributes:
        names: Names of the columns.
        n_lines: Number of lines of the file.
        line: Number of the line with the names, from 0.
        separator: Separator of columns.
        decimal_point: Decimal separator of numbers.
    """

    names: Sequence[str]
    n_lines: int
    line: int
    separator: str
    decimal_point: str


def read_logs(file: Path | str) -> list[RobotLog]:
    """Read the logs in a CSV or Parquet file, one log per robot.

    Raises:
        OmniError: The file cannot be read, is too large, columns or values are missing, or time
            does not increase.
    """
    path = Path(file)
    columns = _read_columns(path)
    is_angle, wheels = _wheel_columns(columns)
    command = _command_columns(columns)
    pose = _stack_columns(columns, _pose_columns(columns))
    if "vision_valid" in columns:
        pose[columns["vision_valid"] != 1] = np.nan
    sources = {"wheels": wheels, "commands": command}
    inputs = {source: _stack_columns(columns, names) for source, names in sources.items() if names}
    all_robots = RobotLog(path.name, columns["time_s"], pose, inputs, command == BODY_COMMANDS)
    logs = []
    for robot, lines in _group_lines(columns).items():
        log = all_robots.select(lines)
        if robot:
            log = replace(log, name=f"{path.name} ({robot})")
        # A drive of external robots has columns for wheels, without values.
        known_inputs = {
            source: values for source, values in log.inputs.items() if not np.isnan(values).all()
        }
        if not known_inputs:
            raise OmniError(
                f"{log.name}: {' and '.join(inputs)} have no values; give {INPUTS_TEXT}"
            )
        logs.append(_clean(replace(log, inputs=known_inputs), is_angle))
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


def _group_lines(columns: Columns) -> dict[str, list[int]]:
    """Return a mapping from controller, seed and slot to the lines that have them.

    Without such columns, all lines belong to the key "".
    """
    keys = [columns[key] for key in ROBOT_COLUMNS if key in columns]
    groups = dict[str, list[int]]()
    for line in range(len(columns["time_s"])):
        robot = to_printable(" ".join(str(key[line]) for key in keys), 100)
        groups.setdefault(robot, []).append(line)
    return groups


def _clean(log: RobotLog, is_angle: bool) -> RobotLog:
    """Return a log with unwrapped headings and mean wheel speeds, without repeated lines.

    Poses that were not measured become NaN. Wheels that were not measured are interpolated.

    Args:
        log: The log, with wheel angles or speeds in place of mean speeds.
        is_angle: Whether it has wheel angles.

    Raises:
        OmniError: There are too few lines, times are not valid, values are too coarse, or inputs
            are missing.
    """
    log = _clean_times(log)
    pose = np.where(np.isfinite(log.pose), log.pose, np.nan)
    steps = np.array([find_step(values) for values in pose.T])
    _check_step(log.name, "positions", max(steps[:2]))
    _check_step(log.name, "headings", steps[2])
    has_heading = np.isfinite(pose[:, 2])
    pose[has_heading, 2] = np.unwrap(pose[has_heading, 2])
    is_measured = find_measured_lines(pose, steps)
    if steps[:2].max() < FINE_STEP_M:
        is_measured[1:] &= (np.diff(pose, axis=0) != 0).any(1)
    pose[~is_measured] = np.nan
    for source, values in log.inputs.items():
        _require_finite(f"{log.name}: {source} are", values)
        change_times = log.time[1:][(np.diff(values, axis=0) != 0).any(1)]
        hold = np.median(np.diff(change_times)) if len(change_times) > 1 else 0.0
        if MAX_HOLD * np.median(np.diff(log.time)) < hold < MAX_PERIOD_S:
            log = log.add_remark(
                f"{source} change every {hold:.2g} s; delays are uncertain by half of that if the "
                "log lacks values"
            )
    log = replace(log, pose=pose, pose_steps=steps)
    return _compute_mean_speeds(log, is_angle) if "wheels" in log.inputs else log


def _clean_times(log: RobotLog) -> RobotLog:
    """Return a log with increasing times. Evenly spaced times that were rounded are restored.

    Raises:
        OmniError: Times are missing, decrease, or have another unit; there are too few lines.
    """
    _require_finite(f"{log.name}: time_s is", log.time)
    intervals = np.diff(log.time)
    if (intervals < 0).any():
        line = (intervals < 0).argmax() + 1
        raise OmniError(f"{log.name}: time_s does not increase from line {line} to {line + 1}")
    has_same_pose = (np.diff(np.nan_to_num(log.pose), axis=0) == 0).all(1)
    n_times = 1 + int((intervals > 0).sum())
    if n_times < MIN_LINES:
        raise OmniError(
            f"{log.name}: time_s has {format_count(n_times, 'different value')} in "
            f"{format_count(len(log.time), 'line')}; at least {MIN_LINES} are needed"
        )
    log = log.select(np.append(True, (intervals > 0) | ~has_same_pose))
    intervals = np.diff(log.time, prepend=log.time[0])
    step = find_step(intervals[intervals <= MAX_PERIOD_S])
    # Intervals of one step are exact.
    if step > FINE_TIME_STEP_S and not np.isclose(np.median(intervals), step):
        log = log.add_remark(f"times in steps of {step:.2g} s{COARSE}")
    log = replace(log, time=restore_even_times(log.time, step))
    log = log.select(np.diff(log.time, prepend=-np.inf) > 0)
    _check_period(log.name, float(np.median(np.diff(log.time))))
    return log


def _check_period(name: str, period: float) -> None:
    """Raise OmniError if the time in s from line to line is not valid.

    Args:
        name: Name of the log.
        period: The time.
    """
    if MIN_PERIOD_S <= period <= MAX_PERIOD_S:
        return
    hints = [
        f"; did you mean time_{unit}?"
        for unit, (si_unit, factor) in UNITS.items()
        if si_unit == "s" and MIN_PERIOD_S <= factor * period <= MAX_PERIOD_S
    ]
    raise OmniError(
        f"{name}: time_s grows by {period:g} s from line to line, but "
        f"{MIN_PERIOD_S:g} to {MAX_PERIOD_S:g} s are allowed{''.join(hints)}"
    )


def _check_step(name: str, quantity: str, step: float) -> None:
    """Raise OmniError if the steps of a quantity, a key of `MAX_STEPS`, are too coarse."""
    max_step, unit = MAX_STEPS[quantity]
    if step > max_step * (1 + ROUNDING):
        raise OmniError(
            f"{name}: {quantity} in steps of {step:.3g} {unit} tell too little; steps of at most "
            f"{max_step:g} {unit} are needed"
        )


def _require_finite(subject: str, values: Array) -> None:
    """Raise OmniError, which starts with a subject, if a line (F, ...) has no finite value."""
    invalid_indices = np.argwhere(~np.isfinite(values))
    if invalid_indices.size:
        raise OmniError(f"{subject} missing or infinite in line {invalid_indices[0, 0] + 1}")


def _wheel_columns(names: Collection[str]) -> tuple[bool, list[str]]:
    """Return whether the columns of wheels hold angles, and the names of these columns.

    Raises:
        OmniError: The numbers of wheels do not start with 1, or one is missing.
    """
    for pattern in WHEEL_PATTERNS:
        present = sorted(filter(re.compile(pattern.format(r"\d+")).fullmatch, names))
        expected = [pattern.format(i + 1) for i in range(len(present))]
        if set(expected) != set(present):
            raise OmniError(
                f"columns {list_first(present)}: wheels are numbered from 1, without gaps"
            )
        if expected:
            return pattern.endswith("_rad"), expected
    return False, []


def _command_columns(names: Collection[str]) -> Sequence[str]:
    """Return the columns of commands, or none."""
    for command in (TRAJECTORY_COMMANDS, WORLD_COMMANDS, BODY_COMMANDS):
        if set(command) <= set(names):
            return command
    return ()


def _pose_columns(names: Collection[str]) -> Sequence[str]:
    """Return the columns of poses."""
    return VISION_COLUMNS if set(VISION_COLUMNS) <= set(names) else POSE_COLUMNS


def _stack_columns(columns: Columns, names: Sequence[str]) -> Array:
    """Return columns side by side, (F, names)."""
    return np.column_stack([columns[name] for name in names])


def _compute_mean_speeds(log: RobotLog, is_angle: bool) -> RobotLog:
    """Return a log with mean wheel speeds from each line to the next.

    The last line repeats the previous one. A logger that repeats wheels ends after their last
    measurement, so the lines after it are left out. Angles of a wheel that all lie within one turn
    are unwrapped.

    Args:
        log: The log, with wheel angles in rad, or wheel speeds in rad/s.
        is_angle: Whether it has angles.

    Raises:
        OmniError: Angles within one turn change too fast to be unwrapped, or steps are too coarse.
    """
    values, time_unit = log.inputs["wheels"], 1.0
    steps = np.array([find_step(column) for column in values.T])
    if is_angle:
        time_unit = float(np.median(np.diff(log.time)))
        is_wrapped = np.ptp(values, axis=0) <= MAX_WRAPPED_RAD
        values = np.where(is_wrapped, np.unwrap(values, axis=0), values)
        fastest = np.abs(np.diff(values[:, is_wrapped], axis=0)).max(initial=0.0)
        if fastest > MAX_UNWRAPPED_RAD:
            raise OmniError(
                f"{log.name}: wheel angles within one turn change by up to {fastest:.2g} rad from "
                f"line to line, but at most {MAX_UNWRAPPED_RAD:g} rad are unambiguous; count "
                "turns, or measure more often"
            )
    step = float(steps.max()) / time_unit
    _check_step(log.name, "wheel speeds", step)
    if step > FINE_SPEED_STEP_RAD_S:
        log = log.add_remark(f"wheel speeds in steps of {step:.2g} rad/s{COARSE}")
    values = interpolate_measurements(log.time, values, steps)
    if is_angle:
        means = np.diff(values, axis=0) / np.diff(log.time)[:, None]
    else:
        means = (values[1:] + values[:-1]) / 2
    speeds = np.concatenate([means, means[-1:]])
    log = replace(log, inputs=log.inputs | {"wheels": speeds})
    return log.select(np.isfinite(speeds).all(1))


def _read_columns(path: Path) -> Columns:
    """Return the known columns of a CSV or Parquet file by their names in lower case, in SI units.

    Raises:
        OmniError: The file does not exist, is not a table, is too large, lacks a column, or has a
            known column twice.
    """
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise OmniError(f"{path}: a log is a .csv or .parquet file with named columns")
    if not os.path.isfile(path):
        raise OmniError(f"there is no log {path}")
    try:
        header = _read_csv_header(path) if suffix == ".csv" else parquet.read_header(path)
        sources = _find_known_columns(header.names)
        if header.n_lines > MAX_LINES:
            raise OmniError(f"{header.n_lines} lines are too many; at most {MAX_LINES}")
        names = [source.name for source in sources.values()]
        if isinstance(header, CsvHeader):
            arrow_table = _read_csv(path, header, names)
        else:
            arrow_table = parquet.read_table(path, names)
        return {
            known_name: _to_array(arrow_table[source.name], known_name, source)
            for known_name, source in sources.items()
        }
    except (pa.ArrowException, OSError, ValueError, csv.Error) as error:
        raise OmniError(f"{path.name}: {to_printable(str(error), MAX_LINE_LENGTH)}") from None


def _find_known_columns(names: Sequence[str]) -> dict[str, Source]:
    """Return a mapping from each known column to its source in a file with given names.

    Raises:
        OmniError: A known column is there twice, or a required one is missing.
    """
    normalized = [_normalize_name(name) for name in names]
    sources = dict[str, Source]()
    for name, (known_name, factor) in zip(names, normalized, strict=True):
        if not KNOWN_COLUMN.fullmatch(known_name):
            continue
        if known_name in sources:
            raise OmniError(f"column {known_name} is there twice; leave one")
        sources[known_name] = Source(name, factor)
    for name, (other_name, _) in zip(names, normalized, strict=True):
        if other_name in DATE_COLUMNS:
            sources.setdefault("time_s", Source(name, 0.0))
    for name in ("time_s", *_pose_columns(sources)):
        if name not in sources:
            raise OmniError(
                f"column {name} is missing; {suggest_names(name, [name for name, _ in normalized])}"
            )
    if not _command_columns(sources) and not _wheel_columns(sources)[1]:
        raise OmniError(f"neither commands nor wheels; give {INPUTS_TEXT}")
    return sources


def _normalize_name(name: str) -> tuple[str, float]:
    """Return a column's name with the unit in which it is read, and the factor to this unit.

    The name is in lower case, without comment signs, quotes and spaces. `Heading [deg]` becomes
    heading_rad, with the factor pi / 180.
    """
    if len(name) > MAX_NAME_LENGTH:
        return name, 1.0
    name = re.sub(r"\s*[\[(](.*)[\])]$", r"_\1", name.strip("# \"'").lower())
    name = to_printable(name.replace("/", "_").replace("°", "deg"))
    name = re.sub(r"_([a-z]+(?:_s)?)_\1$", r"_\1", name)  # x_m [m]
    for unit, (si_unit, factor) in UNITS.items():
        si_name = name.removesuffix(unit) + si_unit
        if name.endswith(f"_{unit}") and KNOWN_COLUMN.fullmatch(si_name):
            return si_name, factor
    return name, 1.0


def _read_csv_header(path: Path) -> CsvHeader:
    """Return the header of a CSV file.

    The line with the names and the separator are those with the most known names.

    Raises:
        ValueError: There is no line below the names, or the names are too long.
    """
    with path.open("rb") as file:
        head = file.read(MAX_HEADER_BYTES)
        n_lines = head.count(b"\n") + sum(
            chunk.count(b"\n") for chunk in iter(lambda: file.read(BLOCK_BYTES), b"")
        )
    # Only the first lines are decoded here. Arrow decodes the others.
    lines = re.split(r"\r?\n|\r", toml_files.decode_utf8(head, "replace"))
    choices = [
        (number, separator, next(csv.reader([line.lstrip("# ")], delimiter=separator), []))
        for number, line in enumerate(lines[:MAX_HEADER_LINES])
        for separator in SEPARATORS
    ]
    number, separator, names = max(choices, key=lambda choice: _count_known_names(choice[2]))
    if not any(lines[number + 1 :]):
        raise ValueError(
            f"no line below the names of columns in the first {MAX_HEADER_BYTES} bytes"
        )
    rows = csv.reader(lines[number + 1 :], delimiter=separator)
    values = [value for row in rows for value in row]
    decimal_point = max(".,", key=lambda point: sum(point in value for value in values))
    return CsvHeader(names, n_lines, number, separator, decimal_point)


def _read_csv(path: Path, header: CsvHeader, names: Sequence[str]) -> pa.Table:
    """Read columns of a CSV file."""
    n_values = header.n_lines * len(names)
    require_memory(path, f"{header.n_lines} lines", path.stat().st_size + 8 * n_values)
    with pa.OSFile(os.fsencode(path)) as file:  # as in `omni_mj.io.parquet`
        try:
            return pa.csv.read_csv(
                file,
                read_options=pa.csv.ReadOptions(
                    skip_rows=header.line + 1,
                    column_names=header.names,
                    block_size=BLOCK_BYTES,
                    use_threads=False,
                ),
                parse_options=pa.csv.ParseOptions(delimiter=header.separator),
                convert_options=pa.csv.ConvertOptions(
                    decimal_point=header.decimal_point, include_columns=names
                ),
            )
        except pa.ArrowInvalid as error:
            if "straddl" in str(error):
                raise ValueError(f"a line is longer than {BLOCK_BYTES} bytes") from None
            raise


def _count_known_names(names: Iterable[str]) -> int:
    """Return how many names are those of columns that `identify` reads."""
    return sum(KNOWN_COLUMN.fullmatch(_normalize_name(name)[0]) is not None for name in names)


def _to_array(column: pa.ChunkedArray, name: str, source: Source) -> np.ndarray:
    """Return a column as numbers in SI units, or as objects if it names robots.

    Raises:
        OmniError: The column holds values that are not numbers.
    """
    if name in ROBOT_COLUMNS:
        return np.array(column.to_pylist(), object)
    if name == "time_s":
        return _to_seconds(column, source)
    try:
        return np.asarray(source.factor * column.cast("float64").to_numpy())
    except pa.ArrowException as error:
        raise OmniError(f"column {name} must hold numbers: {error}") from None


def _to_seconds(column: pa.ChunkedArray, source: Source) -> Array:
    """Return times in s. Whole numbers and dates count from the first one.

    Raises:
        OmniError: The column holds values that are neither numbers nor dates.
    """
    if pa.types.is_integer(column.type):
        # A float has no room for ns since 1970.
        column = pc.subtract_checked(column, pc.min(column))
    with suppress(pa.ArrowException):
        numbers: Array = column.cast("float64").to_numpy()
        if not source.factor:
            raise OmniError(f"column {source.name} has no unit; call it time_s, time_ms or time_ns")
        return source.factor * numbers
    for date_type in DATE_TYPES:
        with suppress(pa.ArrowException):
            nanoseconds = column.cast(date_type).cast("int64")
            return 1e-9 * pc.subtract(nanoseconds, pc.min(nanoseconds)).cast("float64").to_numpy()
    example = to_printable(str(column.drop_null()[0].as_py()), 100)
    raise OmniError(
        f"column time_s must hold numbers, or dates such as 2026-07-03T14:05:06.016Z, not {example}"
    )

"""Test that log files in any dialect are read, and that invalid ones give one error line."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from benches.studies import read_logs
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_logs import COMMAND, CREEP_STIFFNESS, DEAD_TIME_S, POSE, Columns, make_log

import omni_mj as om

LOG_COLUMNS = ("time_s", *POSE, *COMMAND)


def short_log(**options: bool) -> Columns:
    """Return a log of 3 s."""
    return {name: values[:180] for name, values in make_log(4.0, **options).items()}


def complete_log() -> Columns:
    """Return a complete log."""
    return short_log(wheels=False)


def write_parquet(path: Path, columns: Any) -> Path:
    """Write columns of any type as Parquet."""
    pq.write_table(pa.table(columns), path)
    return path


@settings(max_examples=30)
@given(
    separator=st.sampled_from(",;\t| "),
    has_decimal_comma=st.booleans(),
    has_bom=st.booleans(),
    quote=st.sampled_from(["", '"']),
    line_end=st.sampled_from(["\n", "\r\n"]),
    is_upper=st.booleans(),
    is_commented=st.booleans(),
    blank_lines=st.integers(0, 2),
    preamble=st.sampled_from(["", "sep=;", "# x, y; z in m, time_s in s"]),
    other=st.sampled_from(["Motor 1", "Motor 1, current; mean | max, A"]),
)
def test_csv_dialects_give_the_same_numbers(
    tmp_path_factory: pytest.TempPathFactory,
    separator: str,
    has_decimal_comma: bool,
    has_bom: bool,
    quote: str,
    line_end: str,
    is_upper: bool,
    is_commented: bool,
    blank_lines: int,
    preamble: str,
    other: str,
) -> None:
    """Bit for bit, with numbers written in full; other columns are ignored."""
    names = [
        *(f"{quote}{name.upper() if is_upper else name}{quote}" for name in LOG_COLUMNS),
        f'"{other}"' if quote or separator in other else other,
    ]
    rows = [
        [repr(float(value)) for value in line]
        for line in np.stack(list(complete_log().values()), axis=1)[:40]
    ]
    if has_decimal_comma:
        rows = [[value.replace(".", ",") for value in row] for row in rows]
    if has_decimal_comma and separator == ",":
        rows = [[f'"{value}"' for value in row] for row in rows]
    lines = ["# " * (is_commented and not quote) + separator.join(names)]
    lines = [preamble, *lines] if preamble else lines
    lines += [separator.join([*row, "on"]) for row in rows] + [""] * blank_lines
    file = tmp_path_factory.mktemp("csv") / "log.csv"
    file.write_bytes(line_end.join([*lines, ""]).encode("utf-8-sig" if has_bom else "utf-8"))
    (log,) = read_logs(file)
    np.testing.assert_array_equal(
        log.pose[:, :2], np.stack([complete_log()["x_m"], complete_log()["y_m"]], 1)[:40]
    )
    np.testing.assert_array_equal(
        log.inputs["commands"], np.stack([complete_log()[name] for name in COMMAND], 1)[:40]
    )


def test_units_of_columns_are_converted(tmp_path: Path) -> None:
    """Names in other units, with units in brackets or without, give the same log."""
    log = short_log(commands=False)
    (expected,) = read_logs(write_parquet(tmp_path / "log.parquet", log))
    units = {"time [ms]": 1e-3, "X [mm]": 1e-3, "y_cm": 1e-2, "Heading (deg)": np.pi / 180}
    units |= {f"wheel_{i} [rad]": 1.0 for i in range(1, 5)}
    columns = {name: log[old] / size for (name, size), old in zip(units.items(), log, strict=True)}
    (converted,) = read_logs(write_parquet(tmp_path / "log.parquet", columns))
    np.testing.assert_allclose(converted.pose, expected.pose, atol=1e-12)
    np.testing.assert_allclose(converted.inputs["wheels"], expected.inputs["wheels"], atol=1e-9)
    speeds = dict(log)
    for i in range(1, 5):
        speeds[f"wheel_{i}_rpm"] = np.gradient(speeds.pop(f"wheel_{i}_rad"), log["time_s"]) * 9.5493
    (converted,) = read_logs(write_parquet(tmp_path / "log.parquet", speeds))
    error = converted.inputs["wheels"] - expected.inputs["wheels"]
    assert np.abs(error).max() < 0.1 * np.abs(expected.inputs["wheels"]).max()


def test_wheel_angles_survive_wrapping_and_equal_times(tmp_path: Path) -> None:
    """Angles within one turn; every time twice, with another angle in the second line."""
    log = short_log(commands=False)
    (expected,) = read_logs(write_parquet(tmp_path / "log.parquet", log))
    wrapped = {
        name: (values + np.pi) % (2 * np.pi) - np.pi if name.startswith("wheel") else values
        for name, values in log.items()
    }
    (unwrapped,) = read_logs(write_parquet(tmp_path / "log.parquet", wrapped))
    np.testing.assert_allclose(unwrapped.inputs["wheels"], expected.inputs["wheels"], atol=1e-9)
    twice = {name: np.repeat(values, 2) for name, values in log.items()}
    twice["wheel_1_rad"][1::2] += 0.1
    (once,) = read_logs(write_parquet(tmp_path / "log.parquet", twice))
    np.testing.assert_array_equal(once.inputs["wheels"], expected.inputs["wheels"])


def test_a_clock_that_is_set_in_the_log_costs_no_memory(tmp_path: Path) -> None:
    """The first lines are 54 years older than the others."""
    log = make_log(4.0, wheels=False)
    log["time_s"][:30] -= 1.7e9
    result = om.identify([write_parquet(tmp_path / "log.parquet", log)])
    assert result.estimates["commands.dead_time_s"].value == pytest.approx(DEAD_TIME_S, abs=5e-3)


def test_ten_lines_per_second_suffice(tmp_path: Path) -> None:
    """The dead time is within 0.4 frames, creep stiffness within five standard errors.

    Commands that rise in steps of 0.1 s bias the dead time by 3 to 6 ms (four seeds), because the
    model is of first order: rotors only add mass, but also delay the response to a step. In steps
    of 1/60 s the bias is below 1 ms (`test_identify.py`).
    """
    result = om.identify(
        [write_parquet(tmp_path / "log.parquet", make_log(9.3, 10, speed=1.6, wheels=False))]
    )
    dead_time = result.estimates["commands.dead_time_s"]
    assert dead_time.value == pytest.approx(DEAD_TIME_S, abs=0.4 / 60)
    creep = result.estimates["commands.creep_stiffness"]
    assert creep.value == pytest.approx(CREEP_STIFFNESS, abs=5 * creep.standard_error)


def test_repeated_poses_are_ignored(tmp_path: Path) -> None:
    """A log at 240 Hz that repeats the poses of a 60 Hz camera has the same poses."""
    repeated = {name: np.repeat(values, 4) for name, values in complete_log().items()}
    repeated["time_s"] = np.arange(len(repeated["x_m"])) / 240
    (log,) = read_logs(write_parquet(tmp_path / "log.parquet", repeated))
    np.testing.assert_array_equal(np.isfinite(log.pose).all(1), np.arange(len(log.time)) % 4 == 0)


def test_a_single_path_is_one_log(tmp_path: Path) -> None:
    """A path is not a sequence of letters."""
    for path in (tmp_path / "missing.csv", str(tmp_path / "missing.csv")):
        with pytest.raises(om.OmniError, match=r"there is no log .*missing"):
            om.identify(path)


def test_times_in_any_form_give_the_same_log(tmp_path: Path) -> None:
    """Numbers since 1970 and dates, each to 1 us. Integers beyond 2^53 lose nothing."""
    log = short_log(commands=False)
    (expected,) = read_logs(write_parquet(tmp_path / "log.parquet", log))
    nanoseconds = 1_783_087_506_000_000_000 + np.round(1e9 * log.pop("time_s")).astype(np.int64)
    dates = np.datetime_as_string(nanoseconds.astype("datetime64[ns]"))
    times: dict[str, Any] = {
        "time_ns": nanoseconds,
        "Time [us]": nanoseconds // 1000,
        "time": pa.array(nanoseconds, pa.timestamp("ns")),
        "timestamp": [f"{date}+02:00" for date in dates],
        "time_s": [f"{date}Z" for date in dates],
        "time_ms": dates.tolist(),
    }
    for name, values in times.items():
        (read,) = read_logs(write_parquet(tmp_path / "log.parquet", {name: values} | log))
        elapsed = read.time - read.time[0]
        np.testing.assert_allclose(elapsed, expected.time - expected.time[0], atol=1e-6)
        np.testing.assert_array_equal(read.pose, expected.pose)


@pytest.mark.parametrize("offsets", [(0, 0, 0, 0), (0, 1, 2, 1)], ids=["together", "in turn"])
def test_wheels_that_a_logger_repeats_are_interpolated(
    offsets: tuple[int, ...], tmp_path: Path
) -> None:
    """Angles every third line, of all wheels together or in turn: errors of a parabola's chord.

    The chord of a parabola over 50 ms is at most a (50 ms)^2 / 8 away, at 300 rad/s^2 0.1 rad. A
    repeated angle is up to 2.5 rad away at 75 rad/s.
    """
    log = short_log(commands=False)
    (expected,) = read_logs(write_parquet(tmp_path / "log.parquet", log))
    lines = np.arange(180)
    for wheel, offset in zip(log.keys() - {"time_s", *POSE}, offsets, strict=True):
        log[wheel] = log[wheel][np.maximum((lines - offset) // 3 * 3 + offset, 0)]
    (read,) = read_logs(write_parquet(tmp_path / "log.parquet", log))
    assert 174 <= len(read.time) < 180, "ends with the last measurement"
    angles = [
        np.cumsum(each.inputs["wheels"][: len(read.time)], 0) / 60 for each in (read, expected)
    ]
    np.testing.assert_allclose(*angles, atol=0.1)
    held = log["wheel_1_rad"] - short_log(commands=False)["wheel_1_rad"]
    assert np.abs(held).max() > 0.3


def test_coarse_times_are_restored_or_named(tmp_path: Path) -> None:
    """Rounded even times are known to a tenth of a step. Times of a log with losses are not."""
    log = complete_log()
    is_seen = np.random.default_rng(0).random(180) < 0.9
    for step, is_even in ((0.005, True), (0.01, True), (0.05, True), (0.01, False)):
        lines = np.full(180, True) if is_even else is_seen
        columns = {name: values[lines] for name, values in log.items()}
        columns["time_s"] = np.round(columns["time_s"] / step) * step
        (read,) = read_logs(write_parquet(tmp_path / "log.parquet", columns))
        assert f"times in steps of {step:g} s" in read.remarks[0]
        errors = np.abs(read.time - log["time_s"][lines])
        assert (errors.max() < 0.1 * step) == is_even


def test_held_commands_and_coarse_wheels_are_named(tmp_path: Path) -> None:
    log = short_log()
    (read,) = read_logs(write_parquet(tmp_path / "log.parquet", log))
    assert not read.remarks
    for hold, remarks in ((3, 1), (45, 0)):  # a logger at 20 Hz, or a robot that drives steps
        held = {name: log[name][np.arange(180) // hold * hold] for name in COMMAND}
        (read,) = read_logs(write_parquet(tmp_path / "log.parquet", log | held))
        assert sum("commands change every 0.05 s" in line for line in read.remarks) == remarks
        assert len(read.remarks) == remarks
    log["wheel_1_rad"] = np.round(log["wheel_1_rad"])
    with pytest.raises(om.OmniError, match="wheel speeds in steps of 60 rad/s tell too little"):
        read_logs(write_parquet(tmp_path / "log.parquet", log))


def damaged_log(name: str, change: Callable[[Any], Any]) -> Columns:
    return complete_log() | {name: change(complete_log()[name].copy())}


def set_line(line: int, value: float) -> Callable[[Any], Any]:
    return lambda values: np.where(np.arange(len(values)) == line, value, values)


def test_invalid_columns_give_one_line(tmp_path: Path) -> None:
    cases: list[tuple[Columns, str]] = [
        (
            damaged_log("x_m", lambda x: [*map(str, x[:-1]), "lost"]),
            "column x_m must hold numbers: Failed to parse",
        ),
        (damaged_log("y_m", lambda y: pa.nulls(len(y))), "0 lines with a pose are too few"),
        (damaged_log("time_s", lambda t: ["yesterday"] * len(t)), "or dates such as 2026-"),
        (damaged_log("time_s", lambda t: 0 * t), "time_s has 1 different value in 180 lines"),
        (damaged_log("time_s", lambda t: (t + 1.7e9).astype(np.float32)), "1 different value"),
        (damaged_log("time_s", lambda t: 1e9 * t), "did you mean time_ns?"),
        (damaged_log("x_m", lambda x: np.round(x)), "positions in steps of 1 m tell too little"),
        (damaged_log("time_s", set_line(5, np.nan)), "time_s is missing or infinite in line 6"),
        (damaged_log("time_s", set_line(5, 0.0)), "does not increase from line 5 to 6"),
        (
            damaged_log(COMMAND[2], set_line(7, np.nan)),
            "commands are missing or infinite in line 8",
        ),
        ({name: complete_log()[name] for name in LOG_COLUMNS[:4]}, "neither commands nor wheels"),
        (
            complete_log() | dict.fromkeys(["wheel_0_rad", "wheel_1_rad"], complete_log()["x_m"]),
            "columns wheel_0_rad, wheel_1_rad: wheels are numbered from 1, without gaps",
        ),
        (
            {f" {name}": values for name, values in complete_log().items() if name != "y_m"},
            "column y_m is missing",
        ),
    ]
    for columns, message in cases:
        with pytest.raises(om.OmniError) as error:
            om.identify([write_parquet(tmp_path / "log.parquet", columns)])
        assert message in str(error.value), message
        assert str(error.value).count("\n") == 0


def test_files_that_are_no_tables_give_one_line(tmp_path: Path) -> None:
    header, row = ",".join(LOG_COLUMNS), "0,0,0,0,0,0,0"
    for content, message in (
        ("", "no line below the names"),
        (header, "no line below the names"),
        (f"{header}\n{row}\n", "1 different value in 1 line;"),
        (f"{row}\n{row}\n", "column time_s is missing"),
        (f"{header},{'x' * 100_000}\n{row},0\n", "in the first 100000 bytes"),
        (f"{header}\n{row}{'0' * 2**22}\n{row}\n", "a line is longer than 1048576 bytes"),
        (f"{header}\n{row}" + 5_000_001 * "\n", "5000002 lines are too many; at most 5000000"),
        ("x [mm]\n0\n", "column time_s is missing"),
        (f"{header}\n{row}\n1,2\n", "Expected 7 columns, got 2"),
        (f"{header},x_m\n{row},0\n", "column x_m is there twice"),
        (f"{header}\n{row}\n".replace("y_m", "y_n"), "did you mean 'y_n'?"),
    ):
        (tmp_path / "log.csv").write_text(content)
        with pytest.raises(om.OmniError) as error:
            om.identify([tmp_path / "log.csv"])
        assert message in str(error.value)
        assert str(error.value).count("\n") == 0


@settings(max_examples=100)
@given(
    data=st.one_of(
        st.binary(max_size=200), st.text(alphabet="time_sx_m,;\t\n0.1-e# \"'", max_size=200)
    )
)
def test_random_content_gives_no_traceback(
    data: bytes | str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Random content is never a valid log."""
    file = tmp_path_factory.mktemp("drawn") / "log.csv"
    file.write_bytes(data.encode() if isinstance(data, str) else data)
    with pytest.raises(om.OmniError) as error:
        om.identify([file])
    assert str(error.value).count("\n") == 0

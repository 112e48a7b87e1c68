"""Tables of logs in different dialects say the same, or a line says what is wrong with them."""

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
from synthetic_logs import COMMAND, CREEP_STIFFNESS, LATENCY_S, POSE, Columns, make_log

import omni_mj as om

HEAD = ("time_s", *POSE, *COMMAND)


def whole() -> Columns:
    """A log, driven once by the process that needs it: each process of the tests imports this file."""
    return make_log(3.0, speed=1.6, wheels=False)


def write_parquet(path: Path, columns: Any) -> Path:
    """Parquet, of whatever types."""
    pq.write_table(pa.table(columns), path)
    return path


@settings(max_examples=30)
@given(
    separator=st.sampled_from(",;\t"), comma=st.booleans(), mark=st.booleans(), quote=st.sampled_from(["", '"']),
    end=st.sampled_from(["\n", "\r\n"]), upper=st.booleans(), hashed=st.booleans(), blank=st.integers(0, 2),
)  # fmt: skip
def test_csv_dialects_give_the_same_numbers(
    tmp_path_factory: pytest.TempPathFactory, separator: str, comma: bool, mark: bool, quote: str, end: str,
    upper: bool, hashed: bool, blank: int,
) -> None:  # fmt: skip
    """Bit for bit, as each number is written with all its digits; other columns may be called anything."""
    names = [*(f"{quote}{name.upper() if upper else name}{quote}" for name in HEAD), "Motor 1"]
    rows = [
        [repr(float(value)) for value in line]
        for line in np.stack(list(whole().values()), axis=1)[:40]
    ]
    if comma and separator != ",":
        rows = [[value.replace(".", ",") for value in row] for row in rows]
    lines = ["# " * (hashed and not quote) + separator.join(names)]
    lines += [separator.join([*row, "on"]) for row in rows] + [""] * blank
    file = tmp_path_factory.mktemp("csv") / "log.csv"
    file.write_bytes(end.join([*lines, ""]).encode("utf-8-sig" if mark else "utf-8"))
    (log,) = read_logs(file)
    np.testing.assert_array_equal(
        log.pose[:, :2], np.stack([whole()["x_m"], whole()["y_m"]], 1)[:40]
    )
    np.testing.assert_array_equal(
        log.inputs["commands"], np.stack([whole()[name] for name in COMMAND], 1)[:40]
    )


def test_ten_lines_per_second_suffice(tmp_path: Path) -> None:
    """The robot's latency and creep stiffness, within five standard errors."""
    found = om.identify(
        [write_parquet(tmp_path / "log.parquet", make_log(9.3, 10, speed=1.6, wheels=False))]
    )
    for name, value in (("latency_s", LATENCY_S), ("creep_stiffness", CREEP_STIFFNESS)):
        estimate = found[f"commands.{name}"]
        assert estimate.value == pytest.approx(value, abs=5 * estimate.standard_error)


def test_repeated_lines_and_poses_are_ignored(tmp_path: Path) -> None:
    """A recorder at 240 Hz holds what a camera sees at 60: the same poses at the same times come out."""
    (plain,) = read_logs(write_parquet(tmp_path / "log.parquet", whole()))
    (twice,) = read_logs(
        write_parquet(
            tmp_path / "log.parquet",
            {name: np.repeat(values, 2) for name, values in whole().items()},
        )
    )
    np.testing.assert_array_equal(twice.pose, plain.pose)
    held = {name: np.repeat(values, 4) for name, values in whole().items()}
    held["time_s"] = np.arange(len(held["x_m"])) / 240
    (log,) = read_logs(write_parquet(tmp_path / "log.parquet", held))
    np.testing.assert_array_equal(np.isfinite(log.pose).all(1), np.arange(len(log.time)) % 4 == 0)


def test_a_single_path_is_one_log(tmp_path: Path) -> None:
    """And not the logs of its letters."""
    for path in (tmp_path / "missing.csv", str(tmp_path / "missing.csv")):
        with pytest.raises(om.OmniError, match=r"there is no log .*missing"):
            om.identify(path)


def spoilt(name: str, change: Callable[[Any], Any]) -> Columns:
    return whole() | {name: change(whole()[name].copy())}


def put(line: int, value: float) -> Callable[[Any], Any]:
    return lambda values: np.where(np.arange(len(values)) == line, value, values)


def test_invalid_columns_give_one_line(tmp_path: Path) -> None:
    cases: list[tuple[Columns, str]] = [
        (
            spoilt("x_m", lambda x: [*map(str, x[:-1]), "lost"]),
            "column x_m must hold numbers: Failed to parse",
        ),
        (spoilt("y_m", lambda y: pa.nulls(len(y))), "0 lines with a pose are too few"),
        (
            spoilt("time_s", lambda t: pa.array((1e9 * t).astype(int), pa.timestamp("ns"))),
            "time_s must hold numbers",
        ),
        (spoilt("time_s", lambda t: (t + 1.7e9).astype(np.float32)), "times are too few"),
        (spoilt("time_s", put(5, np.nan)), "time_s is missing in line 6"),
        (spoilt("time_s", put(5, 0.0)), "does not increase from line 5 to 6"),
        (spoilt(COMMAND[2], put(7, np.nan)), "commands are missing in line 8"),
        ({name: whole()[name] for name in HEAD[:4]}, "neither commands nor wheels"),
        (
            {f" {name}": values for name, values in whole().items() if name != "y_m"},
            "column y_m is missing",
        ),
    ]
    for columns, says in cases:
        with pytest.raises(om.OmniError) as error:
            om.identify([write_parquet(tmp_path / "log.parquet", columns)])
        assert says in str(error.value), says
        assert str(error.value).count("\n") == 0


def test_files_that_are_no_tables_give_one_line(tmp_path: Path) -> None:
    head, row = ",".join(HEAD), "0,0,0,0,0,0,0"
    for content, says in (
        ("", "Empty CSV"),
        (head, "Empty CSV"),
        (f"{head}\n{row}\n", "1 times are too few"),
        (f"{row}\n{row}\n", "column time_s is missing"),
        (f"{head}\n{row}\n1,2\n", "Expected 7 columns, got 2"),
        (f"{head}\n{row}\n".replace("y_m", "y_n"), "did you mean 'y_n'?"),
    ):
        (tmp_path / "log.csv").write_text(content)
        with pytest.raises(om.OmniError) as error:
            om.identify([tmp_path / "log.csv"])
        assert says in str(error.value)
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
    """Nothing that is drawn at random is a log, and all of it is refused in a line."""
    file = tmp_path_factory.mktemp("drawn") / "log.csv"
    file.write_bytes(data.encode() if isinstance(data, str) else data)
    with pytest.raises(om.OmniError) as error:
        om.identify([file])
    assert str(error.value).count("\n") == 0

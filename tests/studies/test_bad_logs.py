"""Tables of logs in whatever dialect say the same, or a line says what is wrong with them."""

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import Truth, logs

import omni_mj as om
from omni_mj.studies.identify import identify, tables
from omni_mj.studies.identify.logs import read

SETTINGS, TRUTH = om.scenario("rect").settings, Truth()
HEAD = ["time_s", "x_m", "y_m", "heading_rad", "vx_cmd_world_m_s", "vy_cmd_world_m_s", "w_cmd_rad_s"]
Columns = dict[str, Any]


def driven(rate: float = 60.0, seconds: float = 3.0) -> Columns:
    """A log of known truth."""
    made = logs(SETTINGS, [TRUTH], seconds, seed=1, rate=rate)
    return dict(zip(HEAD, np.column_stack([made.time, made.pose[:, 0], made.command[:, 0]]).T, strict=True))


WHOLE = driven()


@settings(deadline=None, max_examples=80, derandomize=True)
@given(
    separator=st.sampled_from(",;\t"), comma=st.booleans(), encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
    around=st.sampled_from(["", " "]), quote=st.sampled_from(["", '"']), end=st.sampled_from(["\n", "\r\n"]),
    upper=st.booleans(),
    comments=st.integers(0, 2), hashed=st.booleans(), blank=st.integers(0, 2), last=st.booleans(),
)  # fmt: skip
def test_csv_in_any_dialect_holds_the_same_numbers(
    tmp_path_factory: pytest.TempPathFactory, separator: str, comma: bool, encoding: str, around: str, quote: str,
    upper: bool, end: str, comments: int, hashed: bool, blank: int, last: bool,
) -> None:  # fmt: skip
    """Bit for bit: each number is written with all its digits."""
    names = [f"{around}{quote}{name.upper() if upper else name}{quote}{around}" for name in HEAD]
    rows = [[repr(float(value)) for value in line] for line in np.stack(list(WHOLE.values()), axis=1)[:40]]
    if comma and separator != ",":
        rows = [[value.replace(".", ",") for value in row] for row in rows]
    tail = separator if last else ""  # as spreadsheets leave it
    lines = ["# recorded by somebody"] * comments + ["# " * hashed + separator.join(names) + tail]
    lines += [around + separator.join(row) + tail for row in rows] + [""] * blank
    file = tmp_path_factory.mktemp("csv") / "log.csv"
    file.write_bytes(end.join([*lines, ""]).encode(encoding))
    columns = tables.read(file)
    for name in HEAD:
        np.testing.assert_array_equal(columns[name], WHOLE[name][:40], err_msg=name)


def write(path: Path, columns: Columns) -> Path:
    """Parquet, of whatever types."""
    pq.write_table(pa.table(columns), path)
    return path


def test_clocks_in_whole_nanoseconds_keep_all_digits(tmp_path: Path) -> None:
    """Of an epoch's 19 digits a number of 64 bits loses three; as time_ns it is counted from the first."""
    stamps = np.round(WHOLE["time_s"] * 1e9).astype(np.int64) + 1_700_000_000_000_000_000
    columns = {"time_ns": stamps} | {name: WHOLE[name] for name in HEAD[1:]}
    (found,) = read(write(tmp_path / "log.parquet", columns))
    np.testing.assert_allclose(found.time, WHOLE["time_s"], atol=1e-9)
    (epoch,) = read(write(tmp_path / "log.parquet", WHOLE | {"time_s": WHOLE["time_s"] + 1.7e9}))
    np.testing.assert_allclose(np.diff(epoch.time), np.diff(found.time), atol=1e-6)


@pytest.mark.parametrize("rate", [10.0, 100.0])
def test_other_rates_tell_the_same(rate: float, tmp_path: Path) -> None:
    """The robot's latency and creep stiffness, within five standard errors."""
    found = identify([write(tmp_path / "log.parquet", driven(rate, 9.3))])
    by_name = {e.name: e for e in found.estimates if e.source == "commands"}
    for name, truth in (("latency_s", TRUTH.late), ("creep_stiffness", TRUTH.stiffness)):
        assert by_name[name].told
        assert by_name[name].value == pytest.approx(truth, abs=5 * by_name[name].error)


def test_lines_there_twice_and_poses_held_are_no_new_poses(tmp_path: Path) -> None:
    """A recorder at 240 Hz holds what a camera sees at 60: the same poses at the same times come out."""
    (plain,) = read(write(tmp_path / "log.parquet", WHOLE))
    (twice,) = read(write(tmp_path / "log.parquet", {name: np.repeat(values, 2) for name, values in WHOLE.items()}))
    np.testing.assert_array_equal(twice.pose, plain.pose)
    assert twice.notes == ["log.parquet: 180 lines are there twice; once is enough"]
    held = {name: np.repeat(values, 4) for name, values in WHOLE.items()}
    held["time_s"] = np.arange(len(held["x_m"])) / 240
    (found,) = read(write(tmp_path / "log.parquet", held))
    moving = np.abs(np.gradient(plain.pose[:, 0], plain.time)) > 0.3
    there = np.isfinite(found.pose).all(1).reshape(-1, 4)
    assert there[:, 0].all()
    assert not there[moving][2:-2, 1:].any()
    assert "lines repeat the pose before them while the robot moves; taken as not seen" in found.notes[0]


def text(values: Any) -> list[str]:
    return [str(value) for value in values]


def spoilt(name: str, change: Callable[[Any], Any]) -> Columns:
    return WHOLE | {name: change(WHOLE[name].copy())}


def put(values: Any, line: int, value: float) -> Any:
    values[line] = value
    return values


BAD: list[tuple[Columns, str]] = [
    (spoilt("x_m", lambda x: x > 0), "column x_m holds something else than numbers, such as 'False'"),
    (spoilt("x_m", lambda x: [*text(x[:-1]), "lost"]), "column x_m holds something else than numbers, such as 'lost'"),
    (spoilt("w_cmd_rad_s", text), "column w_cmd_rad_s holds something else than numbers, but text"),
    (spoilt("y_m", lambda y: [[value] for value in y]), "column y_m holds something else than numbers, such as '["),
    (spoilt("y_m", lambda y: pa.nulls(len(y))), "0 lines with a pose are too few"),
    (spoilt("time_s", lambda t: pa.array((1e9 * t).astype(int), pa.timestamp("ns"))), "time_s is a time of day; give"),
    (spoilt("time_s", lambda t: 1e3 * t), "is time_s in ms?"),
    (spoilt("time_s", lambda t: 1e6 * t), "is time_s in us?"),
    (spoilt("time_s", lambda t: (1e9 * t).astype(int)), "is time_s in ns?"),
    (spoilt("time_s", lambda t: (t + 1.7e9).astype(np.float32)), "it stands still (too few digits?): 1700000000,"),
    (spoilt("time_s", lambda t: put(t, 5, np.nan)), "time_s is missing in line 6"),
    (spoilt("time_s", lambda t: put(t, 5, 0.0)), "time_s does not increase from line 5 to 6, it goes back"),
    (spoilt("w_cmd_rad_s", lambda w: put(w, 7, np.nan)), "commands are missing in line 8"),
    (spoilt("x_m", lambda x: put(x, 9, 1e9)), "a position of 1e+09 m in line 10 is off any field"),
    (WHOLE | {"x_m": 100 * WHOLE["x_m"], "y_m": 100 * WHOLE["y_m"]}, "are x_m and y_m in cm or mm?"),
    (spoilt("w_cmd_rad_s", np.degrees), "are they in degrees/s?"),
    ({f" {name}": values for name, values in WHOLE.items() if name != "y_m"}, "column y_m is missing"),
]


def test_what_cannot_be_what_it_says_is_one_line(tmp_path: Path) -> None:
    for columns, says in BAD:
        with pytest.raises(om.OmniError) as error:
            read(write(tmp_path / "log.parquet", columns))
        assert says in str(error.value), says
        assert str(error.value).count("\n") == 0
    assert read(write(tmp_path / "log.parquet", spoilt("x_m", lambda x: [Decimal(f"{value:.9f}") for value in x])))


def test_what_is_no_table_is_one_line(tmp_path: Path) -> None:
    head, row = ",".join(HEAD), "0,0,0,0,0,0,0"
    for content, says in (
        ("", "column time_s is missing"),
        (head, "0 lines are too few"),
        (f"{row}\n{row}\n", "has no header: its first line holds numbers"),
        (f"{head}\n{row}\n1,2\n", "Expected 7 columns, got 2"),
        (f"{head},x_m\n{row},0\n", "column x_m is there twice"),
        (f"{head}\n{row}\n".replace("y_m", "y_n"), "column y_m is missing; did you mean y_n?"),
    ):
        (tmp_path / "log.csv").write_text(content)
        with pytest.raises(om.OmniError) as error:
            read(tmp_path / "log.csv")
        assert says in str(error.value)
        assert str(error.value).count("\n") == 0


@settings(deadline=None, max_examples=150, derandomize=True)
@given(data=st.one_of(st.binary(max_size=200), st.text(alphabet="time_sx_m,;\t\n0.1-e# \"'", max_size=200)))
def test_no_content_is_a_traceback(data: bytes | str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Nothing that is drawn at random is a log, and all of it is refused in a line."""
    file = tmp_path_factory.mktemp("drawn") / "log.csv"
    file.write_bytes(data.encode() if isinstance(data, str) else data)
    with pytest.raises(om.OmniError) as error:
        read(file)
    assert str(error.value).count("\n") == 0

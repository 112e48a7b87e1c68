"""Parquet files are looked at before they are read: rows, texts, types, kind of file."""

import os
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import invoke

import omni_mj as om
from omni_mj.io import parquet

N_ROWS = 123_457


def varint(number: int) -> bytes:
    """Return a positive integer as Thrift's compact protocol writes it in a footer."""
    digits, rest = [], 2 * number
    while rest:
        digits.append(rest % 128 | 128)
        rest //= 128
    digits[-1] &= 127
    return bytes(digits)


def with_rows(data: bytes, n_rows: int) -> bytes:
    """Return a Parquet file of N_ROWS rows whose footer says that it has other ones."""
    length = int.from_bytes(data[-8:-4], "little")
    footer = data[-8 - length : -8].replace(varint(N_ROWS), varint(n_rows))
    return data[: -8 - length] + footer + len(footer).to_bytes(4, "little") + data[-4:]


def write_hostile_files() -> dict[str, str]:
    """Write files of some kB into the current folder; return the message about each."""
    pq.write_table(pa.table({"time_s": np.zeros(N_ROWS)}), "rows.parquet")
    plain = Path("rows.parquet").read_bytes()
    Path("rows.parquet").write_bytes(with_rows(plain, 10**12))
    Path("times.parquet").write_bytes(with_rows(plain, 10**8))
    log = pa.table(
        dict.fromkeys(["time_s", "x_m", "y_m", "heading_rad", "wheel_1_rad"], np.zeros(N_ROWS))
    )
    pq.write_table(log, "log.parquet")
    Path("log.parquet").write_bytes(with_rows(Path("log.parquet").read_bytes(), 10**12))
    pq.write_table(pa.table({f"c{i}": [0] for i in range(10_001)}), "columns.parquet")
    text = pa.DictionaryArray.from_arrays(np.zeros(10**6, np.int32), pa.array(["x" * 10**6]))
    pq.write_table(pa.table({"time_s": text}), "texts.parquet", store_schema=False)
    for name, column in (
        ("lists", pa.array([[1.0]])),
        ("structs", pa.array([{"a": 1.0}])),
        ("maps", pa.array([[("a", 1.0)]], pa.map_(pa.string(), pa.float64()))),
        ("bytes", pa.array([b"\x1b"])),
    ):
        pq.write_table(pa.table({"\x1b[31m": column}), f"{name}.parquet")
    twice = pa.table([pa.array([1.0]), pa.array([1.0])], names=["x_m", "x_m"])
    pq.write_table(twice, "twice.parquet")
    os.mkfifo("pipe.parquet")
    os.symlink("/dev/zero", "zero.parquet")
    nested = r"its column \\x1b\[31m must hold numbers, texts or times, not "
    return {
        "rows": "1000000000000 rows of 1 columns need 8e.03 GB of memory; at most .* are allowed",
        "times": "100000000 rows of 1 columns need .* times the memory of the file; at most 1000",
        "columns": "it has 10001 columns; at most 10000 are allowed",
        "texts": "the texts of its column time_s need 1e.03 GB of memory",
        "lists": f"{nested}list",
        "structs": f"{nested}struct",
        "maps": f"{nested}map",
        "bytes": f"{nested}binary",
        "twice": "it has two columns x_m",
        "pipe": "not a regular file",
        "zero": "not a regular file",
    }


def test_files_that_would_fill_the_memory_are_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same for logs, and for the frames of a run that somebody sent."""
    monkeypatch.chdir(tmp_path)
    messages = write_hostile_files()
    for name, message in messages.items():
        with pytest.raises(om.OmniError, match=f"^{name}.parquet cannot be read: .*{message}"):
            parquet.read_table(Path(f"{name}.parquet"))
    assert invoke("identify log.parquet --out out") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "1000000000000 lines are too many; at most 5000000" in line
    assert not Path("out").exists()


def test_tables_of_plain_columns_are_read_as_they_were_written(tmp_path: Path) -> None:
    """Texts, dictionaries, times and nulls, by pyarrow and by polars; some or all columns."""
    times = np.array(["2026-01-01", "2026-01-02"], "datetime64[us]")
    names = pa.array(["flc", None])
    table = pa.table({"a": [1.5, None], "b": [True, False], "c": names, "d": times})
    table = table.append_column("e", names.dictionary_encode()).append_column("f", pa.nulls(2))
    path = tmp_path / "table.parquet"
    pq.write_table(table, path)
    assert parquet.read_table(path).equals(table)
    assert parquet.read_table(path, ["c", "a"]).to_pydict() == table.select(["c", "a"]).to_pydict()
    pl.DataFrame({"a": [1, 2], "c": ["flc", "p"]}).write_parquet(path)
    assert parquet.read_table(path).to_pydict() == {"a": [1, 2], "c": ["flc", "p"]}

"""What is recorded costs the same per frame however long a run, and its file is the same however it is written."""

import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from benches.logs import WHEELS, filled, rows

from omni_mj import parquet
from omni_mj.plants import Telemetry
from omni_mj.simulate.log import FIRST_FRAMES, Log


def test_a_run_of_known_length_takes_no_more_memory_after_its_first_seconds() -> None:
    """Room for all frames is made once; without it, the last doubling alone would take half of what there is."""
    frames = 8 * FIRST_FRAMES
    log, one = Log(rows(), WHEELS, frames), np.ones(1, bool)
    values = {name: np.zeros((1, len(titles))) for name, titles in log.columns.items()}
    for _ in range(FIRST_FRAMES + 1):
        log.write(one, {}, **values)
    tracemalloc.start()
    try:
        for _ in range(frames - FIRST_FRAMES - 1):
            log.write(one, {}, **values)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert log.length == frames
    assert most < 50_000  # numbers of the frame at hand; a frame of one robot has some 500 bytes
    log.write(one, {}, **values)  # more than expected may come
    assert log.length == frames + 1


@pytest.mark.parametrize("lines", [1, 7, 10, 1000])
def test_a_table_in_parts_is_the_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: int) -> None:
    """Rows of different lengths, one of none; wherever it is cut."""
    numbers = np.arange(10 * 3 * 3, dtype=float).reshape(10, 3, 3)
    log = filled(rows(["a", "b", "c"]), 10, lengths=[10, 0, 4], pose=numbers)
    monkeypatch.setattr(parquet, "GROUP_ROWS", lines)
    log.save(tmp_path / "table.parquet")
    read = pq.read_table(tmp_path / "table.parquet")
    assert read["controller"].to_pylist() == 10 * ["a"] + 4 * ["c"]
    assert read["frame"].to_pylist() == [*range(10), *range(4)]
    np.testing.assert_array_equal(read["x_m"], np.append(numbers[:, 0, 0], numbers[:4, 2, 0]))
    assert read.schema.names == log.table().schema.names


def test_a_table_is_read_without_threads(tmp_path: Path) -> None:
    """Where there is no memory for one, Arrow would wait for it for ever: `serve` did, at its end."""
    filled(rows(["a"]), 10).save(tmp_path / "table.parquet")
    code = (
        "import os, sys, pathlib, pyarrow.parquet\nfrom omni_mj import parquet\n"
        "before = len(os.listdir('/proc/self/task'))\nparquet.read(pathlib.Path(sys.argv[1]))\n"
        "print(len(os.listdir('/proc/self/task')) - before)"
    )
    words = [sys.executable, "-c", code, str(tmp_path / "table.parquet")]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout == "0\n"


def test_telemetry_is_written_at_once_where_its_names_say() -> None:
    """Of two rows, the second of which is not recorded; every number is another."""
    log, told = Log(rows(["a", "b"]), WHEELS), Telemetry.empty(2, WHEELS)
    told.columns[:] = np.arange(told.columns.size).reshape(told.columns.shape)
    log.write(np.array([True, False]), {}, telemetry=told.columns)
    assert set(told.named()) < set(log.columns)
    for name, values in told.named().items():
        np.testing.assert_array_equal(log.channel(name)[0, 0], np.ravel(values[0]), err_msg=name)
        assert np.isnan(log.channel(name)[0, 1]).all()
    assert np.isnan(log.channel("pose")).all()

"""The log's file does not depend on the size of its blocks, and is read without threads."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from benches.logs import fill_log, rows

from omni_mj import parquet


@pytest.mark.parametrize("lines", [1, 7, 10, 1000])
def test_a_table_written_in_blocks_is_the_whole_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: int
) -> None:
    """Rows of different lengths, one of them empty."""
    poses = np.arange(10 * 3 * 3, dtype=float).reshape(10, 3, 3)
    log = fill_log(rows(["a", "b", "c"]), 10, lengths=[10, 0, 4], pose=poses)
    monkeypatch.setattr(parquet, "ROWS_PER_GROUP", lines)
    log.save(tmp_path / "table.parquet")
    read = pq.read_table(tmp_path / "table.parquet")
    assert read["controller"].to_pylist() == 10 * ["a"] + 4 * ["c"]
    assert read["frame"].to_pylist() == [*range(10), *range(4)]
    np.testing.assert_array_equal(read["x_m"], np.append(poses[:, 0, 0], poses[:4, 2, 0]))
    assert read.schema.names == log.to_arrow().schema.names


def test_a_table_is_read_without_threads(tmp_path: Path) -> None:
    """If there is no memory to start a thread, Arrow waits for it forever."""
    fill_log(rows(["a"]), 10).save(tmp_path / "table.parquet")
    code = (
        "import os, sys, pathlib, pyarrow.parquet\nfrom omni_mj import parquet\n"
        "before = len(os.listdir('/proc/self/task'))\n"
        "parquet.read_table(pathlib.Path(sys.argv[1]))\n"
        "print(len(os.listdir('/proc/self/task')) - before)"
    )
    words = [sys.executable, "-c", code, str(tmp_path / "table.parquet")]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout == "0\n"

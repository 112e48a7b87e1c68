"""The log: its file does not depend on the size of blocks, and its memory not on its length."""

import copy
import pickle
import resource
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from benches.logs import fill_log, rows
from commands import run_python

from omni_mj.io import parquet
from omni_mj.simulation import frame_blocks
from omni_mj.simulation.log import Log

N_ROWS, N_FRAMES = 10, 2600  # 14 MB


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
        "import os, sys, pathlib, pyarrow.parquet\nfrom omni_mj.io import parquet\n"
        "before = len(os.listdir('/proc/self/task'))\n"
        "parquet.read_table(pathlib.Path(sys.argv[1]))\n"
        "print(len(os.listdir('/proc/self/task')) - before)"
    )
    assert run_python(tmp_path / "table.parquet", code=code, check=True).stdout == "0\n"


@pytest.mark.parametrize("disk", ["free", "without a folder", "full", "nearly full"])
def test_a_long_log_needs_little_memory_and_loses_nothing_if_the_disk_is_full(
    disk: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A controller's channel begins late, gets wider, and half of the rows end early."""
    monkeypatch.setattr(frame_blocks, "FOLDER", tmp_path)
    monkeypatch.setattr(frame_blocks, "MEMORY_BYTES", 1e6)
    if disk == "without a folder":
        monkeypatch.setattr(frame_blocks, "FOLDER", tmp_path / "none")
    if disk == "nearly full":
        monkeypatch.setattr(frame_blocks, "RESERVED_BYTES", 1e15)
    old_limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    if disk == "full":  # in the middle of a block
        resource.setrlimit(resource.RLIMIT_FSIZE, (4_000_000, old_limits[1]))
    rng = np.random.default_rng(0)
    log = Log(rows(["a", "b"], range(N_ROWS // 2)), 4)
    ends = np.where(np.arange(N_ROWS) < N_ROWS // 2, N_FRAMES, N_FRAMES // 2)
    pose, telemetry = rng.normal(size=(N_FRAMES, N_ROWS, 3)), rng.normal(size=(N_FRAMES, 1))
    tracemalloc.start()
    try:
        for frame in range(N_FRAMES):
            is_wide = frame > 2000
            mine = {"mine": pose[frame, :, : 1 + is_wide]} if frame > 1000 else {}
            log.append(frame < ends, mine, pose=pose[frame], telemetry=telemetry[frame])
        assert disk != "free" or tracemalloc.get_traced_memory()[1] < 7e6
    finally:
        tracemalloc.stop()
        resource.setrlimit(resource.RLIMIT_FSIZE, old_limits)
    pose[N_FRAMES // 2 :, N_ROWS // 2 :] = np.nan
    expected = np.where(np.arange(N_FRAMES)[:, None, None] > [1000, 2000], pose[..., :2], np.nan)
    for same_log in (log, copy.deepcopy(log), pickle.loads(pickle.dumps(log))):
        np.testing.assert_array_equal(same_log.channel("pose"), pose)
        np.testing.assert_array_equal(same_log.channel("channel_mine"), expected)
        np.testing.assert_array_equal(
            same_log.channel("slip")[:1500, 3], np.tile(telemetry, 4)[:1500]
        )
    np.testing.assert_array_equal(log.channel_of_row("pose", 1, 700), pose[700:, 1])
    frames = log.to_arrow()
    np.testing.assert_array_equal(
        frames["x_m"],
        np.concatenate([*(p[:n, 0] for p, n in zip(pose.swapaxes(0, 1), ends, strict=True))]),
    )
    assert not [*tmp_path.iterdir()], "the file has no name"

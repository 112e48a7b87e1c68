"""What serve records: every frame once, of the robots that were there, whatever ended it."""

import signal
import subprocess
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import serving
from commands import invoke
from served import FAST, QUIET, drive, local, pitch_of
from serving import served

import omni_mj as om
from omni_mj.live.serve import log
from omni_mj.live.serve.log import Block, Parquet, Tape
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.wire.simulation import Team


def taped(pitch: Pitch, tape: Tape, frames: int) -> None:
    for _ in range(frames):
        drive(pitch, 1, local(0, 0.5))
        tape.add()


def test_robots_that_come_and_go_begin_new_blocks_and_no_frame_is_lost(tmp_path: Path) -> None:
    pitch, blocks = pitch_of(*QUIET, FAST, blue="2", yellow="1"), list[Block]()
    table = Parquet(tmp_path / "trajectory.parquet")
    tape = Tape(pitch, [table, blocks.append])
    taped(pitch, tape, 40)
    assert pitch.place({}, {(Team.BLUE, 1)}) == []
    taped(pitch, tape, 5)
    assert pitch.place({(Team.YELLOW, 9): (np.array([2.0, 2.0, 0.0]), np.zeros(3))}, set()) == []
    taped(pitch, tape, 5)
    tape.flush()
    table.finish()
    assert [(block.first, block.log.length) for block in blocks] == [(1, 30), (31, 10), (41, 5), (46, 5)]
    frame = pl.read_parquet(tmp_path / "trajectory.parquet")
    counts = frame.group_by("controller", "place").len().rows_by_key(["controller", "place"], unique=True)
    assert {key: (n if isinstance(n, int) else n[0]) for key, n in counts.items()} == {
        ("blue", 0): 50, ("blue", 1): 40, ("yellow", 0): 50, ("yellow", 9): 5,
    }  # fmt: skip
    blue = frame.filter((pl.col("controller") == "blue") & (pl.col("place") == 0)).sort("frame")
    assert blue["frame"].to_list() == list(range(1, 51))
    np.testing.assert_allclose(blue["time_s"], np.arange(1, 51) / 60)
    assert blue["x_m"][-1] == pytest.approx(pitch.plant.pose()[0, 0])
    assert (blue["command_vx_m_s"] == 0.5).all()


def test_a_field_without_robots_is_recorded_as_nothing(tmp_path: Path) -> None:
    pitch, table = pitch_of(*QUIET, FAST), Parquet(tmp_path / "trajectory.parquet")
    tape = Tape(pitch, [table])
    taped(pitch, tape, 3)
    assert pitch.place({}, {(Team.BLUE, 0)}) == []
    for _ in range(5):
        for _ in range(16):
            pitch.step()
        tape.add()
    tape.flush()
    table.finish()
    assert pl.read_parquet(tmp_path / "trajectory.parquet")["frame"].to_list() == [1, 2, 3]


def test_the_table_is_written_in_parts_so_that_memory_does_not_grow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log, "PART_FRAMES", 20)
    monkeypatch.setattr(log, "BLOCK_FRAMES", 10)
    pitch = pitch_of(*QUIET, FAST)
    table = Parquet(tmp_path / "trajectory.parquet")
    tape = Tape(pitch, [table])
    taped(pitch, tape, 51)
    parts = sorted(tmp_path.iterdir())
    assert [path.name for path in parts] == ["trajectory-00000.parquet", "trajectory-00001.parquet"]
    assert pl.read_parquet(parts)["frame"].to_list() == list(range(1, 41))  # what a kill would leave
    tape.flush()
    table.finish()
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory.parquet"]
    assert pl.read_parquet(tmp_path / "trajectory.parquet")["frame"].to_list() == list(range(1, 52))


def test_a_process_that_is_ended_leaves_a_whole_table_and_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    options = "--lockstep", "--set", FAST, "--yellow", "1", "--yellow-robot", "tigers-v2020", "--out", str(out)
    with served(*options) as (client, process):
        for _ in range(45):
            client.step(serving.local(0, 0.5))
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=serving.PATIENCE_S)
    assert process.returncode == 130
    assert error.splitlines()[-1] == (
        f"error: interrupted; 0.8 s were simulated; what was recorded until then is in {out}"
    )
    files = {"trajectory.parquet", "recording.rrd", "scenario.toml", "scenario-yellow.toml", "provenance.json"}
    assert files <= {path.name for path in out.iterdir()}
    times = {path.name: path.stat().st_mtime_ns for path in out.iterdir() if path.is_file()}
    assert times["provenance.json"] == min(times.values()), "by which --overwrite knows a folder, whenever it is killed"
    robots = [om.scenario(out / name).robot for name in ("scenario.toml", "scenario-yellow.toml")]
    assert robots == ["tigers-v2016", "tigers-v2020"]
    assert len(pl.read_parquet(out / "trajectory.parquet")) == 2 * 45
    rerun, without_list = Path(serving.sys.executable).with_name("rerun"), ["--check-footers", "false"]
    said = subprocess.run(
        [rerun, "rrd", "verify", *without_list, out / "recording.rrd"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "without error" in said.stdout + said.stderr
    for command, reason in {
        "verify": "is of omni-mj serve, which was live and is not repeated: what its robots did came of a client's",
        "report": "is of omni-mj serve, which knows of no reference and so of no error: there is nothing to report",
    }.items():
        assert invoke(command, out) == 2
        assert reason in capsys.readouterr().err

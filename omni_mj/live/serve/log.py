"""What `serve` records, in blocks: memory is bounded, and a killed process loses little."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array
from omni_mj import parquet
from omni_mj.live.serve.cameras import CYCLES_PER_FRAME
from omni_mj.live.serve.pitch import Pitch, label
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.simulate.log import Log

if TYPE_CHECKING:
    import pyarrow as pa

BLOCK_FRAMES = FRAME_RATE_HZ // 2
PART_FRAMES = 10 * FRAME_RATE_HZ  # in a part of the table, which a killed process loses at most


@dataclass(frozen=True)
class Block:
    """Successive frames in which the same robots were on the field.

    Args:
        first: Number of the first frame.
        names: Of the robots.
        log: Of their rows. References and the team's estimates are unknown.
        ball: Its positions, shape (frames, 2), m.
    """

    first: int
    names: Sequence[str]
    log: Log
    ball: Array


class Tape:
    """Records a pitch frame by frame.

    Args:
        pitch: What is recorded.
        sinks: Called with each block.
    """

    def __init__(self, pitch: Pitch, sinks: Sequence[Callable[[Block], None]]) -> None:
        self._pitch, self._sinks = pitch, sinks
        self._next_frame = pitch.cycle // CYCLES_PER_FRAME + 1
        self._begin_block()

    def add(self) -> None:
        """Record the frame that has just ended."""
        pitch = self._pitch
        if sorted(pitch.poses()) != self._names or self._log.length == BLOCK_FRAMES:
            self.flush()
        robots = [pitch.names.index(name) for name in self._names]
        command, measured = pitch.held.command[robots], pitch.measured[robots]
        self._log.write(
            np.ones(len(robots), bool),
            {},
            pose=pitch.world.pose()[robots],
            vision=measured,
            vision_valid=~np.isnan(measured[:, 0]),
            command=command,
            applied=command,
            telemetry=pitch.world.telemetry().columns[robots],
        )
        self._balls.append(pitch.ball)
        pitch.measured[:] = np.nan
        self._next_frame += 1

    def flush(self) -> None:
        """Hand on what was recorded since the last time."""
        if self._log.length:
            names = [label(name) for name in self._names]
            block = Block(self._next_frame - self._log.length, names, self._log, np.array(self._balls))
            for sink in self._sinks:
                sink(block)
        self._begin_block()

    def _begin_block(self) -> None:
        pitch = self._pitch
        self._names, self._balls = sorted(pitch.poses()), list[Array]()
        rows = [replace(pitch.rows[pitch.names.index(name)], place=name[1]) for name in self._names]
        self._log = Log(rows, max(pitch.world.wheels))


class TableWriter:
    """Writes `trajectory.parquet` in parts, each a file, which are joined at the end.

    It has the columns of a table of `run`: `controller` is the team, `place` the robot's number; velocities are those
    that robots hold.

    Args:
        path: Of the table, next to which the parts are.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._parts = path, list[Path]()
        self._tables, self._n_frames = list["pa.Table"](), 0

    def __call__(self, block: Block) -> None:
        """Write a block."""
        import pyarrow as pa

        table = block.log.table()
        frames = table["frame"].to_numpy().astype(np.int64) + block.first
        columns = {
            "controller": table["controller"].cast(pa.string()),
            "frame": pa.array(frames),
            "time_s": pa.array(frames * PERIOD_S),
        }
        for name, values in columns.items():
            table = table.set_column(table.schema.get_field_index(name), name, values)
        self._tables.append(table)
        self._n_frames += block.log.length
        if self._n_frames >= PART_FRAMES:
            self._write_part()

    def finish(self) -> None:
        """Join the parts."""
        self._write_part()
        if self._parts:
            parquet.write(map(parquet.read, self._parts), self._path)
        for part in self._parts:
            part.unlink()

    def _write_part(self) -> None:
        if self._tables:
            part = self._path.with_name(f"{self._path.stem}-{len(self._parts):05d}{self._path.suffix}")
            parquet.write(self._tables, part)
            self._parts.append(part)
            self._tables, self._n_frames = [], 0

"""What `serve` records: block after block, so that memory is bounded and a killed process loses little."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array
from omni_mj import parquet
from omni_mj.live.serve.cameras import CYCLES, Name
from omni_mj.live.serve.pitch import Pitch, label
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.simulate.log import Log

if TYPE_CHECKING:
    import pyarrow as pa

BLOCK_FRAMES = FRAME_RATE_HZ // 2
PART_FRAMES = 10 * FRAME_RATE_HZ  # of a part of the table, which a killed process loses at most


@dataclass(frozen=True)
class Block:
    """Frames one after the other in which the same robots were on the field.

    Args:
        first: number of the first frame.
        names: of the robots.
        log: of their rows; nothing is known of a reference or of what a team believes.
        ball: where it lay, (frames, 2) m; not a number where there was none.
    """

    first: int
    names: Sequence[str]
    log: Log
    ball: Array


class Tape:
    """Records a pitch frame by frame.

    Args:
        pitch: what is recorded.
        sinks: what each block is given to.
    """

    def __init__(self, pitch: Pitch, sinks: Sequence[Callable[[Block], None]]) -> None:
        self._pitch, self._sinks = pitch, sinks
        self._frame = pitch.cycle // CYCLES + 1  # of the next end of a frame
        self._begin()

    def add(self) -> None:
        """Record the frame that has come to its end."""
        pitch, names = self._pitch, self._present()
        if names != self._names or self._log.length == BLOCK_FRAMES:
            self.flush()
        robots = [pitch.names.index(name) for name in names]
        nothing, command = np.full((len(robots), 3), np.nan), pitch.held.command[robots]
        measured = pitch.measured[robots]
        self._log.write(
            np.ones(len(robots), bool),
            {},
            ref=nothing,
            pose=pitch.plant.pose()[robots],
            vision=measured,
            vision_valid=~np.isnan(measured[:, 0]),
            predicted=nothing,
            command=command,
            applied=command,
            alpha_hat=nothing,
            latency_hat=nothing,
            telemetry=pitch.plant.telemetry().columns[robots],
        )
        self._balls.append(np.full(2, np.nan) if pitch.ball is None else pitch.ball)
        pitch.measured[:] = np.nan
        self._frame += 1

    def flush(self) -> None:
        """Hand on what was recorded since the last time."""
        if self._log.length:
            first = self._frame - self._log.length
            block = Block(first, [label(name) for name in self._names], self._log, np.array(self._balls))
            for sink in self._sinks:
                sink(block)
        self._begin()

    def _begin(self) -> None:
        pitch = self._pitch
        self._names, self._balls = self._present(), list[Array]()
        rows = [replace(pitch.rows[pitch.names.index(name)], place=name[1]) for name in self._names]
        self._log = Log(rows, max(pitch.plant.wheels))

    def _present(self) -> list[Name]:
        here = zip(self._pitch.names, self._pitch.plant.present, strict=True)
        return sorted(name for name, present in here if present)


class Parquet:
    """The table of a run in parts, each a file; at the end they are made one.

    It has the columns of a table of `run`: `controller` is the team, `place` the robot's number; velocities are those
    that robots hold, in whatever frame they came.

    Args:
        path: of the table, beside which the parts are.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._parts, self._tables = path, list[Path](), list["pa.Table"]()

    def __call__(self, block: Block) -> None:
        """Take in a block."""
        import pyarrow as pa

        table = block.log.table()
        frames = table["frame"].to_numpy() + block.first
        columns = {"controller": table["controller"].cast(pa.string()), "frame": pa.array(frames.astype(np.int64))}
        columns["time_s"] = pa.array(frames * PERIOD_S)
        for name, values in columns.items():
            table = table.set_column(table.schema.get_field_index(name), name, values)
        self._tables.append(table)
        if sum(each.num_rows / max(len(block.names), 1) for each in self._tables) >= PART_FRAMES:
            self._write()

    def finish(self) -> None:
        """Make one table of the parts."""
        self._write()
        if not self._parts:
            return
        parquet.join(self._parts, self._path)
        for part in self._parts:
            part.unlink()

    def _write(self) -> None:
        import pyarrow as pa

        if self._tables:
            part = self._path.with_name(f"{self._path.stem}-{len(self._parts):05d}{self._path.suffix}")
            parquet.write([pa.concat_tables(self._tables)], part)
            self._parts.append(part)
            self._tables.clear()

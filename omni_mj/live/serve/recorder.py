"""What `serve` records, in blocks: memory is bounded, and a killed process loses little."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_mj import parquet
from omni_mj.config.settings import FRAME_RATE_HZ
from omni_mj.live.serve.detections import CYCLES_PER_FRAME, RobotName
from omni_mj.live.serve.served_world import Pitch
from omni_mj.live.serve.simulation_requests import label
from omni_mj.simulation.log import Log

if TYPE_CHECKING:
    import pyarrow as pa

BLOCK_FRAMES = FRAME_RATE_HZ // 2
PART_FRAMES = 10 * FRAME_RATE_HZ  # in a part of the table, which a killed process loses at most

Sink = Callable[[Sequence[str], Log], None]  # names of the robots, and their log


class Recorder:
    """Records a pitch frame by frame, and hands on blocks of frames in which the same robots were on the field.

    The table has the columns of a table of `run`: `controller` is the team, `place` the robot's
    number; velocities are those that robots hold. It is written in parts, each a file next to it,
    which are joined at the end.

    Args:
        pitch: What is recorded.
        table: Path of the table, if one is written.
        sinks: Called with each block.
    """

    def __init__(self, pitch: Pitch, table: Path | None, sinks: Sequence[Sink] = ()) -> None:
        self._pitch, self._path, self._sinks = pitch, table, sinks
        self._tables, self._n_frames, self._parts = list["pa.Table"](), 0, list[Path]()
        self._n_wheels = len(pitch.rows[0].settings.wheels.azimuths_deg)
        self._names, self._log = list[RobotName](), Log([], self._n_wheels)

    def add(self) -> None:
        """Record the frame that has just ended."""
        pitch = self._pitch
        names = sorted(pitch.poses())
        robots = [pitch.names.index(name) for name in names]
        if names != self._names or self._log.length == BLOCK_FRAMES:
            self._end_block()
            rows = [
                replace(pitch.rows[robot], slot=name[1])
                for robot, name in zip(robots, names, strict=True)
            ]
            self._names, self._log = names, Log(rows, self._n_wheels)
            self._log.first_frame = pitch.cycle // CYCLES_PER_FRAME
        command, measured = pitch.held.command[robots], pitch.measured[robots]
        self._log.append(
            np.ones(len(robots), bool),
            {},
            pose=pitch.plant.pose()[robots],
            vision=measured,
            vision_valid=~np.isnan(measured[:, 0]),
            command=command,
            applied=command,
            telemetry=pitch.plant.telemetry().columns[robots],
        )
        pitch.measured[:] = np.nan

    def close(self) -> None:
        """Hand on what is left, and join the parts of the table."""
        self._end_block()
        self._write_part()
        if self._path is not None and self._parts:
            parquet.write_tables(map(parquet.read_table, self._parts), self._path)
            for part in self._parts:
                part.unlink()

    def _end_block(self) -> None:
        """Hand on what was recorded since the last time."""
        if self._log.length:
            for sink in self._sinks:
                sink([label(name) for name in self._names], self._log)
            if self._path is not None:
                self._tables.append(self._log.table())
            self._n_frames += self._log.length
            if self._n_frames >= PART_FRAMES:
                self._write_part()

    def _write_part(self) -> None:
        if self._tables and self._path is not None:
            part = self._path.with_name(
                f"{self._path.stem}-{len(self._parts):05d}{self._path.suffix}"
            )
            parquet.write_tables(self._tables, part)
            self._parts.append(part)
            self._tables, self._n_frames = [], 0

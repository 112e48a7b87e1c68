"""Recorder of `serve`. It writes blocks of frames, which bounds memory and the loss by a kill."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_mj import parquet
from omni_mj.config.settings import CYCLES_PER_FRAME, FRAME_RATE_HZ
from omni_mj.live.serve.detections import RobotName
from omni_mj.live.serve.served_world import ServedWorld
from omni_mj.live.serve.simulation_requests import robot_label
from omni_mj.simulation.log import Log

if TYPE_CHECKING:
    import pyarrow as pa

BLOCK_FRAMES = FRAME_RATE_HZ // 2
PART_FRAMES = 10 * FRAME_RATE_HZ  # of a file; a killed process loses at most these frames

Sink = Callable[[Sequence[str], Log], None]  # names of the robots, and their log


class Recorder:
    """Records a world frame by frame, in blocks of frames with the same robots on the field.

    The table has the columns of `run`: `controller` is the team, `slot` the robot's number, and
    commands are the applied ones. It is written in parts, which are joined at the end.

    Args:
        world: The world to record.
        table_path: Path of the table. None: no table.
        sinks: Functions that are called with each block.
    """

    def __init__(
        self, world: ServedWorld, table_path: Path | None, sinks: Sequence[Sink] = ()
    ) -> None:
        self._world, self._path, self._sinks = world, table_path, sinks
        self._part_tables, self._n_frames, self._part_paths = list["pa.Table"](), 0, list[Path]()
        self._n_wheels = len(world.rows[0].settings.wheels.azimuths_deg)
        self._robot_names, self._log = list[RobotName](), Log([], self._n_wheels)

    def add(self) -> None:
        """Record the frame that has just ended."""
        world = self._world
        names = sorted(world.poses())
        robots = [world.names.index(name) for name in names]
        if names != self._robot_names or self._log.length == BLOCK_FRAMES:
            self._end_block()
            rows = [
                replace(world.rows[robot], slot=name[1])
                for robot, name in zip(robots, names, strict=True)
            ]
            self._robot_names, self._log = names, Log(rows, self._n_wheels)
            self._log.first_frame = world.cycle // CYCLES_PER_FRAME
        command, measured = world.applied.command[robots], world.measured[robots]
        self._log.append(
            np.ones(len(robots), bool),
            {},
            pose=world.plant.pose()[robots],
            vision=measured,
            vision_valid=~np.isnan(measured[:, 0]),
            command=command,
            applied=command,
            telemetry=world.plant.telemetry().columns[robots],
        )
        world.measured[:] = np.nan

    def close(self) -> None:
        """Pass on the last block, and join the parts of the table."""
        self._end_block()
        self._write_part()
        if self._path is not None and self._part_paths:
            parquet.write_tables(map(parquet.read_table, self._part_paths), self._path)
            for part_path in self._part_paths:
                part_path.unlink()

    def _end_block(self) -> None:
        """Pass the recorded frames to the sinks and the table."""
        if self._log.length:
            for sink in self._sinks:
                sink([robot_label(name) for name in self._robot_names], self._log)
            if self._path is not None:
                self._part_tables.append(self._log.to_arrow())
            self._n_frames += self._log.length
            if self._n_frames >= PART_FRAMES:
                self._write_part()

    def _write_part(self) -> None:
        if self._part_tables and self._path is not None:
            part_path = self._path.with_name(
                f"{self._path.stem}-{len(self._part_paths):05d}{self._path.suffix}"
            )
            parquet.write_tables(self._part_tables, part_path)
            self._part_paths.append(part_path)
            self._part_tables, self._n_frames = [], 0

"""Recorder of `serve`: collects blocks of frames, for rerun viewers and the trajectory table."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_mj.config import CYCLES_PER_FRAME, FRAME_RATE_HZ
from omni_mj.io import parquet
from omni_mj.live.serve.detections import RobotName
from omni_mj.live.serve.served_world import ServedWorld
from omni_mj.simulation.log import Log

if TYPE_CHECKING:
    import pyarrow as pa

BLOCK_FRAMES = FRAME_RATE_HZ // 2  # the most that a block has
PART_BLOCKS = 20  # of the table; a killed process loses at most these blocks


class Recorder:
    """Records a world frame by frame, in blocks of frames with the same robots on the field.

    In the log of a block, the controller of a row is the team, and its slot the robot's number.

    Args:
        world: The world to record.
        sinks: Functions that are called with the log of each block.
    """

    def __init__(self, world: ServedWorld, sinks: Sequence[Callable[[Log], None]]) -> None:
        self._world = world
        self._sinks = sinks
        self._robot_names: list[RobotName] = []
        self._n_wheels = len(world.rows[0].settings.wheels.azimuths_deg)
        self._log = Log([], self._n_wheels)

    def add_frame(self) -> None:
        """Record the frame that has just ended."""
        world = self._world
        names = sorted(world.poses())
        robots = [world.names.index(name) for name in names]
        if names != self._robot_names or self._log.length == BLOCK_FRAMES:
            self.end_block()
            rows = [
                replace(world.rows[robot], slot=number)
                for robot, (_, number) in zip(robots, names, strict=True)
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
        world.measured[:] = np.nan  # until the next image

    def end_block(self) -> None:
        """Pass the frames of the current block to the sinks; call it once after the last frame."""
        if self._log.length:
            for sink in self._sinks:
                sink(self._log)


class TrajectoryWriter:
    """Writes blocks to a trajectory table, in parts that are joined at the end.

    Parts limit the memory, and remain if the process is killed. The table has the columns of `run`.

    Args:
        path: Path of the table.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._part_paths: list[Path] = []
        self._blocks: list[pa.Table] = []  # of the current part

    def add_block(self, log: Log) -> None:
        """Add a block, and write a part if it is complete."""
        self._blocks.append(log.to_arrow())
        if len(self._blocks) == PART_BLOCKS:
            self._write_part()

    def close(self) -> None:
        """Write the last part, and join all parts."""
        if self._blocks:
            self._write_part()
        if self._part_paths:
            parquet.write_tables(map(parquet.read_table, self._part_paths), self._path)
            for part_path in self._part_paths:
                part_path.unlink()

    def _write_part(self) -> None:
        part_path = self._path.with_stem(f"{self._path.stem}-{len(self._part_paths):05d}")
        parquet.write_tables(self._blocks, part_path)
        self._part_paths.append(part_path)
        self._blocks = []

"""The log of a simulation: all channels of each row and frame, and their Arrow tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import PERIOD_S
from omni_mj.config.rows import Row
from omni_mj.io import parquet
from omni_mj.plants.telemetry import TELEMETRY_NAMES
from omni_mj.simulation.frame_blocks import FrameBlocks

if TYPE_CHECKING:
    import pyarrow as pa

BLOCK_FRAMES = 512
CHANNEL_PREFIX = "channel_"  # before the names of a controller's own channels


def channel_columns(n_wheels: int) -> dict[str, tuple[str, ...]]:
    """Return a mapping from each channel of the simulation to its columns in a table.

    A line of the table describes the instant of a frame. The command `applied` acts from then
    until the next frame. Peaks, means and the fraction of the time `current_limited` cover the time
    since the previous frame.

    Args:
        n_wheels: Number of wheels of a robot.
    """
    wheel_numbers = [str(i + 1) for i in range(n_wheels)]
    return {
        "ref": ("ref_x_m", "ref_y_m", "ref_heading_rad"),
        "pose": ("x_m", "y_m", "heading_rad"),
        "vision": ("vision_x_m", "vision_y_m", "vision_heading_rad"),
        "vision_valid": ("vision_valid",),
        "predicted": ("predicted_x_m", "predicted_y_m", "predicted_heading_rad"),
        "command": ("command_vx_m_s", "command_vy_m_s", "command_w_rad_s"),
        "applied": ("applied_vx_m_s", "applied_vy_m_s", "applied_w_rad_s"),
        "alpha_hat": ("alpha_hat_x", "alpha_hat_y", "alpha_hat_heading"),
        "latency_hat": (
            "latency_hat_forward_frames",
            "latency_hat_sideways_frames",
            "latency_hat_turn_frames",
        ),
        "wheel_angle": tuple(f"wheel_angle_{i}_rad" for i in wheel_numbers),
        "wheel_speed": tuple(f"wheel_speed_{i}_rad_s" for i in wheel_numbers),
        "voltage": tuple(f"voltage_{i}_v" for i in wheel_numbers),
        "current": tuple(f"current_{i}_a" for i in wheel_numbers),
        "voltage_mean": tuple(f"mean_voltage_{i}_v" for i in wheel_numbers),
        "current_mean": tuple(f"mean_current_{i}_a" for i in wheel_numbers),
        "duty_peak": ("peak_duty",),
        "voltage_peak": ("peak_voltage_v",),
        "current_peak": ("peak_current_a",),
        "current_limited": tuple(f"current_limited_fraction_{i}" for i in wheel_numbers),
        "winding": tuple(f"winding_temperature_{i}_c" for i in wheel_numbers),
        "housing": tuple(f"housing_temperature_{i}_c" for i in wheel_numbers),
        "battery": ("battery_voltage_v",),
        "slip": tuple(f"slip_{i}_m_s" for i in wheel_numbers),
    }


@dataclass(frozen=True)
class Failure:
    """Failure that stopped a row before its end.

    Attributes:
        row: Index of the row.
        controller: Label of its controller.
        seed: Its seed.
        time_s: Time of the failure, s.
        cause: Description of the cause.
    """

    row: int
    controller: str
    seed: int
    time_s: float
    cause: str

    def __str__(self) -> str:
        return f"{self.controller}, seed {self.seed}: {self.cause} at {self.time_s:.3f} s"


class Log:
    """Channels of n rows, recorded in the frames so far.

    Args:
        rows: The rows.
        n_wheels: Number of wheels of a robot.
        has_true_poses: Whether poses are true. If not, only those of frames with a detection are
            measured.

    Attributes:
        rows, has_true_poses: As passed.
        columns: Channel -> its columns in a table.
        first_frame: Number of the first recorded frame in the columns `frame` and `time_s`.
        length: Number of frames so far.
        lengths: Number of frames of each row, shape (n,). Smaller for rows that failed or ended.
    """

    def __init__(self, rows: Sequence[Row], n_wheels: int, has_true_poses: bool = True) -> None:
        self.rows, self.has_true_poses = list(rows), has_true_poses
        self.columns = channel_columns(n_wheels)
        ends = np.cumsum([0, *map(len, self.columns.values())]).tolist()
        self._slices = {
            name: slice(*span) for name, span in zip(self.columns, pairwise(ends), strict=True)
        }
        start, stop = self._slices[TELEMETRY_NAMES[0]].start, self._slices[TELEMETRY_NAMES[-1]].stop
        self._slices["telemetry"] = slice(start, stop)
        self.length, self.first_frame = 0, 0
        self.lengths = np.zeros(len(self.rows), int)
        # Channel -> indices of its columns in the blocks. Columns are added with new channels of
        # controllers, so older blocks have fewer.
        self._indices = {
            name: [*range(*span.indices(ends[-1]))] for name, span in self._slices.items()
        }
        self._n_columns = ends[-1]
        self._blocks = FrameBlocks()
        self._block = self._create_block()  # the newest

    @property
    def controllers(self) -> tuple[str, ...]:
        """Labels of the controllers, in the order of their first rows."""
        return tuple(dict.fromkeys(row.controller for row in self.rows))

    @property
    def seeds(self) -> list[int]:
        """Seeds, in the order of their first rows."""
        return list(dict.fromkeys(row.seed for row in self.rows))

    def rows_of(self, controller: str) -> np.ndarray:
        """Return the indices of a controller's rows."""
        return np.flatnonzero([row.controller == controller for row in self.rows])

    def append(
        self,
        is_active: np.ndarray,
        controller_channels: Mapping[str, Array],
        **values: np.ndarray,
    ) -> None:
        """Append a frame. Channels without a value get NaN.

        Args:
            is_active: Whether each row still runs, shape (n,). Others get NaN.
            controller_channels: Channels of the controllers, name -> shape (n, columns).
            **values: Channels of the simulation, shape (n, columns) or (n,), or broadcastable.
                `telemetry` stands for all of `TELEMETRY_NAMES` side by side.
        """
        if self._n_in_block == BLOCK_FRAMES:
            self._blocks.append(self._block)
            self._block = self._create_block()
        for name, value in controller_channels.items():
            self._add_columns(CHANNEL_PREFIX + name, value.shape[1])
        frame = self._block[self._n_in_block]
        frame[:] = np.nan
        for name, value in values.items():
            np.copyto(frame[self._slices[name]], value.T, where=is_active)
        for name, value in controller_channels.items():
            indices = self._indices[CHANNEL_PREFIX + name][: value.shape[1]]
            frame[indices] = np.where(is_active, value.T, np.nan)
        self.length += 1
        self.lengths += is_active

    def channel(self, name: str) -> np.ndarray:
        """Return a copy of a channel, shape (length, n, columns).

        Frames that a row did not record are NaN, or false in `vision_valid`.
        """
        return self._read_channel(name, slice(None), 0, self.length)

    def channel_of_row(self, name: str, row: int, start: int = 0) -> np.ndarray:
        """Return a copy of a channel in the recorded frames of a row, shape (frames, columns).

        Args:
            name: Name of the channel.
            row: Index of the row.
            start: First frame to return.
        """
        return self._read_channel(name, slice(row, row + 1), start, int(self.lengths[row]))[:, 0]

    def to_arrow(self, start: int = 0, stop: int | None = None) -> "pa.Table":
        """Return a table with one line per row and recorded frame, row by row.

        Args:
            start: Index of the first line to return.
            stop: Index after the last line to return. Default: all lines.
        """
        import pyarrow as pa

        ends = np.cumsum(self.lengths)
        lines = np.arange(self.lengths.sum())[start:stop]
        row_indices = np.searchsorted(ends, lines, side="right")
        frames = lines - (ends - self.lengths)[row_indices]
        labels = list(self.controllers)
        label_indices = np.array([labels.index(row.controller) for row in self.rows], np.int32)
        columns: dict[str, np.ndarray] = {
            "seed": np.array([row.seed for row in self.rows], np.int64)[row_indices],
            "slot": np.array([row.slot for row in self.rows], np.int32)[row_indices],
            "frame": (self.first_frame + frames).astype(np.int32),
            "time_s": (self.first_frame + frames) * PERIOD_S,
        }
        indices = [i for name in self.columns for i in self._indices[name]]
        values = np.empty((len(indices), len(lines)))
        block_numbers = row_indices * (len(self._blocks) + 1) + frames // BLOCK_FRAMES
        _, *spans = np.unique(block_numbers, return_index=True, return_counts=True)
        for offset, count in zip(*spans, strict=True):
            row, frame = row_indices[offset], frames[offset]
            block = self._read(indices, slice(row, row + 1), frame, frame + count)
            values[:, offset : offset + count] = block[:, 0].T
        columns |= dict(zip(chain.from_iterable(self.columns.values()), values, strict=True))
        columns["vision_valid"] = columns["vision_valid"] == 1
        controllers = pa.DictionaryArray.from_arrays(
            label_indices[row_indices], pa.array(labels, pa.string())
        )
        return pa.table({"controller": controllers} | columns)

    def save(self, path: Path) -> None:
        """Write the table as Parquet, block by block to save memory.

        The file appears complete or not at all.
        """
        n_lines, size = int(self.lengths.sum()), parquet.ROWS_PER_GROUP
        starts = range(0, max(n_lines, 1), size)
        parquet.write_tables((self.to_arrow(start, start + size) for start in starts), path)

    @property
    def _n_in_block(self) -> int:
        """Number of frames in the newest block."""
        return self.length - BLOCK_FRAMES * len(self._blocks)

    def _create_block(self) -> Array:
        """Return an empty block, for which the system provides memory only when it is written."""
        return np.empty((BLOCK_FRAMES, self._n_columns, len(self.rows)))

    def _read_channel(self, name: str, rows: slice, start: int, stop: int) -> np.ndarray:
        """Return a channel of some rows from frame `start` until `stop`."""
        values = self._read(self._indices[name], rows, start, stop)
        return values == 1 if name == "vision_valid" else values

    def _read(self, indices: Sequence[int], rows: slice, start: int, stop: int) -> Array:
        """Return columns of the blocks for some rows from frame `start` until `stop`."""
        n_rows, columns = len(self.rows[rows]), np.array(indices)
        values = np.full((max(stop - start, 0), n_rows, len(columns)), np.nan)
        for i in range(start // BLOCK_FRAMES, -(-stop // BLOCK_FRAMES)):
            block = self._blocks[i] if i < len(self._blocks) else self._block
            begin = i * BLOCK_FRAMES
            frames = block[max(start - begin, 0) : stop - begin, :, rows]
            is_known = columns < frames.shape[1]
            target = values[max(begin - start, 0) :][: len(frames)]
            target[..., is_known] = frames[:, columns[is_known]].swapaxes(1, 2)
        return values

    def _add_columns(self, name: str, width: int) -> None:
        """Extend a controller's channel to at least `width` columns."""
        indices = self._indices.get(name, [])
        if len(indices) >= width:
            return
        n_columns = self._n_columns
        self._n_columns += width - len(indices)
        self._indices[name] = [*indices, *range(n_columns, self._n_columns)]
        titles = tuple(f"{name}_{i + 1}" for i in range(width))
        self.columns[name] = (name,) if width == 1 else titles
        frames, self._block = self._block[: self._n_in_block], self._create_block()
        self._block[: len(frames)] = np.nan
        self._block[: len(frames), :n_columns] = frames

"""What a run records per controller, seed and frame: in memory while it goes on, as a Parquet table after."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from omni_mj.scenarios.settings import PERIOD_S

_WHEELS = ("1", "2", "3", "4")
# Channel -> its columns. A row describes the instant of a frame; `applied` acts from there to the next frame, the
# peaks are those since the frame before.
CHANNELS: dict[str, tuple[str, ...]] = {
    "ref": ("ref_x_m", "ref_y_m", "ref_heading_rad"),
    "pose": ("x_m", "y_m", "heading_rad"),
    "vision": ("vision_x_m", "vision_y_m", "vision_heading_rad"),
    "vision_valid": ("vision_valid",),
    "predicted": ("predicted_x_m", "predicted_y_m", "predicted_heading_rad"),
    "command": ("command_vx_m_s", "command_vy_m_s", "command_w_rad_s"),
    "applied": ("applied_vx_m_s", "applied_vy_m_s", "applied_w_rad_s"),
    "alpha_hat": ("alpha_hat_x", "alpha_hat_y", "alpha_hat_heading"),
    "latency_hat": ("latency_hat_forward_frames", "latency_hat_left_frames", "latency_hat_turn_frames"),
    "wheel_angle": tuple(f"wheel_angle_{i}_rad" for i in _WHEELS),
    "wheel_speed": tuple(f"wheel_speed_{i}_rad_s" for i in _WHEELS),
    "voltage": tuple(f"voltage_{i}_v" for i in _WHEELS),
    "current": tuple(f"current_{i}_a" for i in _WHEELS),
    "duty_peak": ("duty_peak",),
    "voltage_peak": ("voltage_peak_v",),
    "current_peak": ("current_peak_a",),
    "winding": tuple(f"winding_{i}_c" for i in _WHEELS),
    "housing": tuple(f"housing_{i}_c" for i in _WHEELS),
    "battery": ("battery_v",),
    "slip": tuple(f"slip_{i}_m_s" for i in _WHEELS),
}


class Trajectory:
    """Channels of n = controllers x seeds robots over the frames of a run, (frames, n, columns) each.

    Attributes:
        controllers, seeds: the rows, all seeds of one controller after those of the one before.
        length: frames written so far.
    """

    def __init__(self, controllers: tuple[str, ...], seeds: list[int], frames: int) -> None:
        self.controllers, self.seeds = controllers, seeds
        self.n = len(controllers) * len(seeds)
        self.length = 0
        self._data = {
            name: np.full((frames, self.n, len(columns)), np.nan, bool if name == "vision_valid" else float)
            for name, columns in CHANNELS.items()
        }

    def write(self, frame: int, **channels: Any) -> None:
        """Record one frame: every channel, (n, columns) or (n,)."""
        for name, value in channels.items():
            self._data[name][frame] = np.reshape(value, (self.n, -1))
        self.length = frame + 1

    def channel(self, name: str) -> np.ndarray:
        """A channel's recorded frames, (length, controllers, seeds, columns)."""
        data = self._data[name][: self.length]
        return data.reshape(self.length, len(self.controllers), len(self.seeds), data.shape[-1])

    @property
    def time(self) -> np.ndarray:
        """Time of each recorded frame (length,), s."""
        return np.arange(self.length) * PERIOD_S

    def table(self) -> pa.Table:
        """One row per controller, seed and frame, in that order."""
        frames, seeds = self.length, len(self.seeds)
        labels = np.repeat(np.arange(len(self.controllers), dtype=np.int32), seeds * frames)
        columns: dict[str, Any] = {
            "controller": pa.DictionaryArray.from_arrays(labels, list(self.controllers)),
            "seed": np.tile(np.repeat(np.array(self.seeds, np.int64), frames), len(self.controllers)),
            "frame": np.tile(np.arange(frames, dtype=np.int32), self.n),
            "time_s": np.tile(self.time, self.n),
        }
        for name, names in CHANNELS.items():
            data = self._data[name][:frames]
            columns |= {column: data[:, :, i].T.ravel() for i, column in enumerate(names)}
        return pa.table(columns)

    def save(self, path: Path) -> None:
        """Write the table as Parquet; the file appears whole or not at all."""
        partial = path.with_name(path.name + ".partial")
        pq.write_table(self.table(), partial, compression="zstd")
        partial.replace(path)

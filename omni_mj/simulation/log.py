"""What a simulation records of each row and frame: in memory while it goes on, as an Arrow table after."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array
from omni_mj import parquet
from omni_mj.config.rows import Row
from omni_mj.config.settings import PERIOD_S
from omni_mj.plants.telemetry import TELEMETRY_NAMES

if TYPE_CHECKING:
    import pyarrow as pa

INITIAL_CAPACITY = 512  # that there is room for at least
CHANNEL_PREFIX = "channel_"  # before the names of channels of a controller's own


def channel_columns(wheels: int) -> dict[str, tuple[str, ...]]:
    """Channel -> its columns in a table, for robots with as many wheels.

    A line of the table describes the instant of a frame; `applied` acts from there to the next
    frame, the peaks and means are those since the frame before, `current_limited` a share of that
    time.
    """
    each = [str(i + 1) for i in range(wheels)]
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
        "wheel_angle": tuple(f"wheel_angle_{i}_rad" for i in each),
        "wheel_speed": tuple(f"wheel_speed_{i}_rad_s" for i in each),
        "voltage": tuple(f"voltage_{i}_v" for i in each),
        "current": tuple(f"current_{i}_a" for i in each),
        "voltage_mean": tuple(f"mean_voltage_{i}_v" for i in each),
        "current_mean": tuple(f"mean_current_{i}_a" for i in each),
        "duty_peak": ("peak_duty",),
        "voltage_peak": ("peak_voltage_v",),
        "current_peak": ("peak_current_a",),
        "current_limited": tuple(f"current_limited_fraction_{i}" for i in each),
        "winding": tuple(f"winding_temperature_{i}_c" for i in each),
        "housing": tuple(f"housing_temperature_{i}_c" for i in each),
        "battery": ("battery_voltage_v",),
        "slip": tuple(f"slip_{i}_m_s" for i in each),
    }


class Log:
    """Channels of n rows, a simulated robot each, over the frames so far.

    Args:
        rows: one per robot.
        wheels: of each robot.
        frames: that are expected; where more come, room for them doubles when it is full.

    Attributes:
        rows: as given.
        columns: channel -> its columns in a table.
        first_frame: the number that a table gives its first frame.
        length: frames recorded so far.
        lengths: how many of them each row has, (n,): one that failed or came to its end before has
            fewer.
    """

    def __init__(self, rows: Sequence[Row], wheels: int, frames: int = 0) -> None:
        self.rows = list(rows)
        self.columns = channel_columns(wheels)
        ends = np.cumsum([0, *map(len, self.columns.values())]).tolist()
        self._at = {
            name: slice(*span) for name, span in zip(self.columns, pairwise(ends), strict=True)
        }
        self.length, self.first_frame = 0, 0
        self.lengths = np.zeros(len(self.rows), int)
        # (frames, columns, rows) of all channels but controllers' own. Memory is taken only when it
        # is written.
        self._data: Array = np.empty((max(frames, INITIAL_CAPACITY), ends[-1], len(self.rows)))
        self._own: dict[str, Array] = {}

    @property
    def controllers(self) -> tuple[str, ...]:
        """Labels of the controllers, in the order of their first rows."""
        return tuple(dict.fromkeys(row.controller for row in self.rows))

    @property
    def seeds(self) -> list[int]:
        """The seeds, in the order of their first rows."""
        return list(dict.fromkeys(row.seed for row in self.rows))

    def rows_of(self, controller: str) -> np.ndarray:
        """Numbers of the rows that a controller drives."""
        return np.flatnonzero([row.controller == controller for row in self.rows])

    def first_row_of(self, controller: str) -> int:
        """Number of the first row that a controller drives."""
        return int(self.rows_of(controller)[0])

    @property
    def time(self) -> Array:
        """Time of each frame (length,), s."""
        return np.arange(self.length, dtype=float) * PERIOD_S

    def append(
        self,
        recorded: np.ndarray,
        own: Mapping[str, Array],
        telemetry: Array | None = None,
        **values: np.ndarray,
    ) -> None:
        """Append a frame.

        Args:
            recorded: which rows go on, (n,); the others get NaN.
            own: channels of controllers' own, name -> (n, k).
            telemetry: the channels of `plants.telemetry.TELEMETRY_NAMES` side by side in that order, (n, their
                columns).
            values: other channels, (n, columns) or (n,), or what broadcasts to it; of those not
                given nothing is recorded.
        """
        if self.length == len(self._data):
            self._data, *others = (_doubled(frames) for frames in (self._data, *self._own.values()))
            self._own = dict(zip(self._own, others, strict=True))
        frame, at = self._data[self.length], self._at
        parts = [(frame[at[name]], value) for name, value in values.items()]
        parts += [
            (self._own_frames(name, value.shape[1])[self.length, : value.shape[1]], value)
            for name, value in own.items()
        ]
        if telemetry is not None:
            parts.append(
                (frame[at[TELEMETRY_NAMES[0]].start : at[TELEMETRY_NAMES[-1]].stop], telemetry)
            )
        for frames in (self._data, *self._own.values()):
            frames[self.length] = np.nan
        for columns, value in parts:
            np.copyto(columns, value.T, where=recorded)
        self.length += 1
        self.lengths += recorded

    def channel(self, name: str) -> np.ndarray:
        """A channel's frames (length, n, columns); not a number, or false, where a row recorded none."""
        frames = self._data[:, self._at[name]] if name in self._at else self._own[name]
        values = frames[: self.length].swapaxes(1, 2)
        return values == 1 if name == "vision_valid" else values

    def table(self, first: int = 0, stop: int | None = None) -> "pa.Table":
        """One line per row and frame that it recorded, rows in their order; of them those from `first` to `stop`."""
        import pyarrow as pa

        ends = np.cumsum(self.lengths)
        lines = np.arange(self.lengths.sum())[first:stop]
        line = np.searchsorted(ends, lines, side="right")
        frame = lines - (ends - self.lengths)[line]
        names = list(self.controllers)
        which = np.array([names.index(row.controller) for row in self.rows], np.int32)
        columns: dict[str, np.ndarray] = {
            "seed": np.array([row.seed for row in self.rows], np.int64)[line],
            "slot": np.array([row.slot for row in self.rows], np.int32)[line],
            "frame": (self.first_frame + frame).astype(np.int32),
            "time_s": (self.first_frame + frame) * PERIOD_S,
        }
        for name, titles in self.columns.items():
            data = self.channel(name)
            columns |= {title: data[frame, line, i] for i, title in enumerate(titles)}
        labels = pa.DictionaryArray.from_arrays(which[line], pa.array(names, pa.string()))
        return pa.table({"controller": labels} | columns)

    def save(self, path: Path) -> None:
        """Write the table as Parquet, a part at a time to save memory; the file appears whole or not at all."""
        firsts = range(0, max(int(self.lengths.sum()), 1), parquet.ROWS_PER_GROUP)
        parquet.write_tables(
            (self.table(first, first + parquet.ROWS_PER_GROUP) for first in firsts), path
        )

    def _own_frames(self, name: str, width: int) -> Array:
        """Return the room of a controller's own channel (frames, columns, n), as wide as this at least."""
        name = CHANNEL_PREFIX + name
        before = self._own.get(name, self._data[:, :0])
        if before.shape[1] < width:
            wider = self._own[name] = np.empty((len(self._data), width, len(self.rows)))
            wider[: self.length] = np.nan
            wider[: self.length, : before.shape[1]] = before[: self.length]
            self.columns[name] = (
                (name,) if width == 1 else tuple(f"{name}_{i + 1}" for i in range(width))
            )
        return self._own[name]


def _doubled(frames: Array) -> Array:
    return np.concatenate([frames, np.empty_like(frames)])

"""Compares trajectories bit for bit: those of a run with those of its repetition."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_control.errors import OmniError
from omni_mj import parquet
from omni_mj.scenarios.settings import PERIOD_S

if TYPE_CHECKING:
    import pyarrow as pa

KEYS = ("controller", "seed", "place", "frame")
TOLD = 4  # channels, or rows, that are named
Key = tuple[str, int, int]


@dataclass
class Frames:
    """A trajectory, by rows.

    Attributes:
        rows: (controller, seed, place) -> its lines, one a frame from 0 on.
        channels: column -> its values, one a line.
    """

    rows: dict[Key, slice]
    channels: dict[str, np.ndarray]

    @property
    def count(self) -> int:
        """Of lines: frames of all rows."""
        return sum(lines.stop - lines.start for lines in self.rows.values())


def read(path: Path) -> Frames:
    """Read trajectory.parquet.

    Raises:
        OmniError: there is none, it cannot be read, or is none.
    """
    if not path.exists():
        raise OmniError(f"{path} is missing: there is nothing to compare with")
    table = parquet.read(path)
    if missing := [key for key in KEYS if key not in table.column_names]:
        raise OmniError(f"{path} is not a run's trajectory: it has no column {', '.join(missing)}")
    return _by_rows(table, path)


def differences(recorded: Frames, here: Frames) -> Iterator[str]:
    """In what a repetition differs, in lines; nothing if all channels of the run are the same bit for bit.

    A value that is not a number is the same as any other such.
    """
    for rows, others, where in ((recorded, here, "here"), (here, recorded, "in the run")):
        if missing := [key for key in rows.rows if key not in others.rows]:
            more = f" and {len(missing) - TOLD} more" if len(missing) > TOLD else ""
            yield f"there is no row {'; '.join(map(_named, missing[:TOLD]))}{more} {where}"
    for key in (key for key in recorded.rows if key in here.rows):
        ours, theirs = (lines.stop - lines.start for lines in (here.rows[key], recorded.rows[key]))
        if ours != theirs:
            yield f"{_named(key)} has {theirs} frames in the run, {ours} here"
    if gone := [name for name in recorded.channels if name not in here.channels]:
        yield f"nothing is recorded here of {', '.join(gone[:TOLD])}" + " and others" * (len(gone) > TOLD)
    yield from _values(recorded, here)


def _values(recorded: Frames, here: Frames) -> Iterator[str]:
    """Of rows, frames and channels that both have: the first value that differs, and how many do by how much."""
    channels = [name for name in recorded.channels if name in here.channels]
    first: tuple[int, str] | None = None
    frames, apart = 0, dict[str, float]()
    for key in (key for key in recorded.rows if key in here.rows):
        old, new = _slices(recorded.rows[key], here.rows[key])
        some = np.zeros(old.stop - old.start, bool)
        for name in channels:
            before, now = recorded.channels[name][old], here.channels[name][new]
            if not (differ := _differ(before, now)).any():
                continue
            some |= differ
            apart[name] = max(apart.get(name, 0.0), np.nanmax(_sizes(before, now)[differ], initial=0.0))
            frame = int(differ.argmax())
            if first is None or frame < first[0]:  # of channels that begin to differ together, the first counts
                both = f"{before[frame]!s} in the run, {now[frame]!s} here"
                size = f", a difference of {_sizes(before, now)[frame]:.2g}"
                where = f"frame {frame} ({frame * PERIOD_S:.3f} s) of {_named(key)}"
                first = frame, f"first in {where}: {name} is {both}{size}"
        frames += int(some.sum())
    if first is not None:
        yield first[1]
        told = ", ".join(f"{name} by up to {size:.2g}" for name, size in list(apart.items())[:TOLD])
        more = f" and {len(apart) - TOLD} more channels" if len(apart) > TOLD else ""
        yield f"in all, {frames} of {recorded.count} frames differ: {told}{more}"


def _slices(old: slice, new: slice) -> tuple[slice, slice]:
    """Of two rows the frames that both have."""
    count = min(old.stop - old.start, new.stop - new.start)
    return slice(old.start, old.start + count), slice(new.start, new.start + count)


def _differ(before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Which values are not the same bit for bit; 0 and -0 are not, one missing value is as good as another."""
    if before.dtype != now.dtype:
        return np.ones(len(before), bool)
    if before.dtype != np.float64:
        return before != now
    return (before.view(np.uint64) != now.view(np.uint64)) & ~(np.isnan(before) & np.isnan(now))


def _sizes(before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """By how much values differ; not a number where one is missing."""
    return np.abs(now.astype(float) - before.astype(float))


def _named(key: Key) -> str:
    controller, seed, place = key
    return f"{controller}, seed {seed}" + f", place {place}" * bool(place)


def _by_rows(table: "pa.Table", path: Path) -> Frames:
    """The table's lines by rows, each of which must have its frames one after the other."""
    import pyarrow as pa

    try:
        labels = table["controller"].cast(pa.string()).to_pylist()
        seed, place, frame = (table[key].cast(pa.int64()).to_numpy() for key in KEYS[1:])
        values = {name: table[name].to_numpy() for name in table.column_names if name not in KEYS}
        for column in values.values():
            column.astype(float)
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise OmniError(f"{path} is not a run's trajectory: {' '.join(str(error).split())}") from None
    starts = [*np.flatnonzero(frame == 0).tolist(), len(frame)]
    rows: dict[Key, slice] = {}
    for start, stop in pairwise(starts):
        rows[labels[start], int(seed[start]), int(place[start])] = slice(start, stop)
        same = {(labels[i], seed[i], place[i]) for i in (start, stop - 1)}
        if len(same) > 1 or not np.array_equal(frame[start:stop], np.arange(stop - start)):
            raise OmniError(f"{path} is not a run's trajectory: frames are missing, or not in their order")
    if len(rows) != len(starts) - 1 or (len(frame) and starts[0] != 0):
        raise OmniError(f"{path} is not a run's trajectory: a row is in it twice, or without its first frame")
    return Frames(rows, values)

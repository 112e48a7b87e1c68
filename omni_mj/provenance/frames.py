"""Compares trajectories bit for bit: those of a run with those of its repetition."""

from collections.abc import Iterator, Sequence
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
NAMED = 4  # channels, or rows, that are named
Key = tuple[str, int, int]


def differences(recorded: Path, again: Path) -> tuple[int, list[str]]:
    """Compare two trajectory.parquet; a value that is not a number is the same as any other such.

    Returns:
        How many frames were recorded, and in what the repetition differs, in lines: none if all channels of the run are
        the same bit for bit.

    Raises:
        OmniError: One is missing, cannot be read, or is no trajectory.
    """
    old, old_rows = _read(recorded)
    new, new_rows = _read(again)
    lines = []
    for rows, others, where in ((old_rows, new_rows, "here"), (new_rows, old_rows, "in the run")):
        if missing := [_named(row) for row in rows if row not in others]:
            lines.append(f"there is no row {_listed(missing, '; ')} {where}")
    common = [row for row in old_rows if row in new_rows]
    for row in common:
        before, now = len(old_rows[row]), len(new_rows[row])
        if before != now:
            lines.append(f"{_named(row)} has {before} frames in the run, {now} here")
    channels = [name for name in old.column_names if name not in KEYS]
    if gone := [name for name in channels if name not in new.column_names]:
        lines.append(f"nothing is recorded here of {_listed(gone)}")
    shared = [min(len(old_rows[row]), len(new_rows[row])) for row in common]
    if common and any(shared):
        at_old, at_new = (
            np.concatenate([rows[row][:count] for row, count in zip(common, shared, strict=True)])
            for rows in (old_rows, new_rows)
        )
        lines += _values(old.take(at_old), new.take(at_new), [name for name in channels if name not in gone])
    return old.num_rows, lines


def _values(old: "pa.Table", new: "pa.Table", channels: Sequence[str]) -> Iterator[str]:
    """Yield the first value that differs, and how many frames differ by how much, of tables with the same keys."""
    differs, sizes = dict[str, np.ndarray](), dict[str, np.ndarray]()
    for name in channels:
        before, now = (table[name].to_numpy() for table in (old, new))
        bits = before != now if before.dtype != float else before.view(np.uint64) != now.view(np.uint64)
        different = bits & ~(np.isnan(before) & np.isnan(now)) if before.dtype == now.dtype else np.ones(len(now), bool)
        if different.any():
            differs[name], sizes[name] = different, np.abs(now.astype(float) - before.astype(float))
    if not differs:
        return
    some, frame = np.any(list(differs.values()), axis=0), old["frame"].to_numpy()
    line = int(np.flatnonzero(some)[frame[some].argmin()])
    name = next(name for name, different in differs.items() if different[line])
    both = f"{old[name][line].as_py()!s} in the run, {new[name][line].as_py()!s} here"
    controller, seed, place = (old[key][line].as_py() for key in KEYS[:3])
    where = f"frame {frame[line]} ({frame[line] * PERIOD_S:.3f} s) of {_named((controller, seed, place))}"
    yield f"first in {where}: {name} is {both}, a difference of {sizes[name][line]:.2g}"
    largest = [f"{name} by up to {np.nanmax(size, initial=0.0):.2g}" for name, size in sizes.items()]
    yield f"in all, {some.sum()} of {old.num_rows} frames differ: {_listed(largest, ', ', ' more channels')}"


def _listed(words: Sequence[str], between: str = ", ", what: str = " more") -> str:
    more = len(words) - NAMED
    return between.join(words[:NAMED]) + (f" and {more}{what}" if more > 0 else "")


def _named(row: Key) -> str:
    controller, seed, place = row
    return f"{controller}, seed {seed}" + f", place {place}" * bool(place)


def _read(path: Path) -> "tuple[pa.Table, dict[Key, np.ndarray]]":
    """Return a trajectory, and the lines of each row in the order of its frames."""
    import pyarrow as pa

    if not path.exists():
        raise OmniError(f"{path} is missing: there is nothing to compare with")
    table = parquet.read(path)
    try:
        controllers = table["controller"].cast(pa.string()).to_pylist()
        seed, place, frame = (table[key].cast(pa.int64()).to_numpy() for key in KEYS[1:])
        for name in table.column_names:
            if name not in KEYS:
                table[name].to_numpy().astype(float)
        keys = list(zip(controllers, seed.tolist(), place.tolist(), strict=True))
        starts = [*np.flatnonzero(frame == 0).tolist(), len(frame)]
        rows = {keys[start]: np.arange(start, stop) for start, stop in pairwise(starts)}
        for row, lines in rows.items():
            if any(keys[i] != row for i in lines.tolist()) or not np.array_equal(frame[lines], np.arange(len(lines))):
                raise ValueError("frames are missing, or not in their order")
        if sum(map(len, rows.values())) != len(frame):
            raise ValueError("a row is in it twice, or without its first frame")
    except (pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise OmniError(f"{path} is not a run's trajectory: {' '.join(str(error).split())}") from None
    return table, rows

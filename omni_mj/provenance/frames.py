"""Compares trajectories bit for bit: those of a run with those of its repetition."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_control.errors import OmniError
from omni_mj import parquet
from omni_mj.scenarios.settings import PERIOD_S

if TYPE_CHECKING:
    import pyarrow as pa

KEYS = ["controller", "seed", "place", "frame"]
NAMED = 4  # channels that are named
HERE = " here"  # after the names of the repetition's channels


def differences(recorded: Path, again: Path) -> tuple[int, list[str]]:
    """Compare two trajectory.parquet; a value that is not a number is the same as any other such.

    Returns:
        How many frames were recorded, and in what the repetition differs, in lines: none if all channels of the run are
        the same bit for bit.

    Raises:
        OmniError: One is missing, cannot be read, or is no trajectory.
    """
    old, new = _read(recorded), _read(again)
    both = old.join(new, KEYS, join_type="inner", right_suffix=HERE, use_threads=False)
    lines = []
    for table, where in ((old, "in the run, and not here"), (new, "here, and not in the run")):
        if table.num_rows > both.num_rows:
            lines.append(f"{table.num_rows - both.num_rows} frames are {where}")
    channels = [name for name in old.column_names if name not in KEYS]
    if gone := [name for name in channels if name not in new.column_names]:
        lines.append(f"nothing is recorded here of {', '.join(gone)}")
    order = [(key, "ascending") for key in ("frame", *KEYS[:3])]
    lines += _values(both.sort_by(order), [name for name in channels if name not in gone])
    return old.num_rows, lines


def _values(both: "pa.Table", channels: list[str]) -> Iterator[str]:
    """Yield the first value that differs, and how many frames differ by how much."""
    differs, sizes = dict[str, np.ndarray](), dict[str, np.ndarray]()
    for name in channels:
        old, new = (both[column].to_numpy() for column in (name, name + HERE))
        if old.dtype == new.dtype == float:
            different = (old.view(np.uint64) != new.view(np.uint64)) & ~(np.isnan(old) & np.isnan(new))
        else:
            different = old != new
        if different.any():
            differs[name], sizes[name] = different, np.abs(new.astype(float) - old.astype(float))
    if not differs:
        return
    some = np.any(list(differs.values()), axis=0)
    line = int(some.argmax())
    name = next(name for name, different in differs.items() if different[line])
    row = {column: both[column][line].as_py() for column in (*KEYS, name, name + HERE)}
    where = f"frame {row['frame']} ({row['frame'] * PERIOD_S:.3f} s) of {row['controller']}, seed {row['seed']}"
    where += f", place {row['place']}" * bool(row["place"])
    values = f"{row[name]} in the run, {row[name + HERE]} here, a difference of {sizes[name][line]:.2g}"
    yield f"first in {where}: {name} is {values}"
    largest = [f"{name} by up to {np.nanmax(size, initial=0.0):.2g}" for name, size in sizes.items()]
    more = f" and {len(largest) - NAMED} more channels" if len(largest) > NAMED else ""
    yield f"in all, {some.sum()} of {len(some)} frames differ: {', '.join(largest[:NAMED])}{more}"


def _read(path: Path) -> "pa.Table":
    """Return a trajectory, in which each row's frames are there from the first on, once."""
    import pyarrow as pa

    if not path.exists():
        raise OmniError(f"{path} is missing: there is nothing to compare with")
    table = parquet.read(path)
    try:
        for key, kind in zip(KEYS, (pa.string(), pa.int64(), pa.int64(), pa.int64()), strict=True):
            table = table.set_column(table.column_names.index(key), key, table[key].cast(kind))
        for name in table.column_names:
            table[name].to_numpy() if name == "controller" else table[name].to_numpy().astype(float)
        rows = table.group_by(KEYS[:3]).aggregate([("frame", how) for how in ("max", "count_distinct", "count")])
        last, distinct, count = (rows[column].to_numpy() for column in rows.column_names[-3:])
        if not (np.array_equal(last + 1, distinct) and np.array_equal(distinct, count)):
            raise ValueError("frames are missing, or there twice")
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise OmniError(f"{path} is not a run's trajectory: {' '.join(str(error).split())}") from None
    return table

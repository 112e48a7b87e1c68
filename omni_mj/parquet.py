"""Tables as Parquet files; by its name, Arrow would take a path with a colon in it for an address."""

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from omni_control.errors import OmniError, to_printable
from omni_mj.files import open_atomic

if TYPE_CHECKING:
    import pyarrow as pa

# Of a file that is written in parts, of which some things stay in memory until the end
ROWS_PER_GROUP = 20_000


def read_table(path: Path, columns: Sequence[str] | None = None) -> "pa.Table":
    """The table in a file.

    Args:
        path: of the file.
        columns: those that are wanted. [all]

    Raises:
        OmniError: it cannot be read, or is no such table.
    """
    import pyarrow.parquet as pq

    with _opened(
        path
    ) as file:  # without threads: where there is no memory for one, Arrow waits for it for ever
        table = pq.ParquetFile(file, pre_buffer=False)
        if missing := [name for name in columns or () if name not in table.schema_arrow.names]:
            raise OmniError(f"{path} cannot be read: it has no column {missing[0]}")
        return table.read(None if columns is None else list(columns), use_threads=False)


def write_tables(tables: "Iterable[pa.Table]", path: Path) -> None:
    """Write tables with the same columns, at least one, one after the other to a file that appears whole or not at all.

    Raises:
        OSError: see `omni_mj.files.open_atomic`.
    """
    import pyarrow.parquet as pq

    parts = iter(tables)
    first = next(parts)
    with (
        open_atomic(path) as file,
        pq.ParquetWriter(file, first.schema, compression="zstd") as writer,
    ):
        for each in chain([first], parts):
            writer.write_table(each)


@contextmanager
def _opened(path: Path) -> "Iterator[pa.NativeFile]":
    """A file to read; what is wrong with it is a line.

    Arrow's own file: threads that read a file of Python's still hold it when a program ends at
    once, which they abort.
    """
    import pyarrow as pa

    try:
        with (
            path.open("rb"),
            pa.OSFile(os.fsencode(path), "rb") as file,
        ):  # the first tells of errors in words
            yield file
    except (OSError, pa.ArrowException, UnicodeError) as error:
        reason = (isinstance(error, OSError) and error.strerror) or str(error)
        raise OmniError(f"{path} cannot be read: {to_printable(reason)}") from None

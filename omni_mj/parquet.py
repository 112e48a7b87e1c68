"""Tables as Parquet files.

Arrow gets opened files, because it would read a file name with a colon as a URL.
"""

import os
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from omni_control.errors import OmniError, to_printable
from omni_mj.atomic_files import open_atomic

if TYPE_CHECKING:
    import pyarrow as pa

# Rows of a block in a file that is written. Each block needs some memory until the file is closed.
ROWS_PER_GROUP = 20_000


def read_table(path: Path, columns: Sequence[str] | None = None) -> "pa.Table":
    """Return the table in a file.

    Args:
        path: The file.
        columns: Names of the columns to read. Default: all.

    Raises:
        OmniError: The file cannot be read, or lacks a column.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # Opening the file by Python first gives readable error messages. Arrow gets no file object
        # of Python: its threads may still hold one when the program ends, which would abort it.
        with path.open("rb"), pa.OSFile(os.fsencode(path), "rb") as file:
            parquet_file = pq.ParquetFile(file, pre_buffer=False)
            names = parquet_file.schema_arrow.names
            if absent_columns := [name for name in columns or () if name not in names]:
                raise OmniError(f"{path} cannot be read: it has no column {absent_columns[0]}")
            # Without threads: if there is no memory to start one, Arrow waits for it forever.
            return parquet_file.read(None if columns is None else list(columns), use_threads=False)
    except (OSError, pa.ArrowException, UnicodeError) as error:
        reason = (isinstance(error, OSError) and error.strerror) or str(error)
        raise OmniError(f"{path} cannot be read: {to_printable(reason)}") from None


def write_tables(arrow_tables: "Iterable[pa.Table]", path: Path) -> None:
    """Write one or more tables with the same columns to a file, one after the other.

    The file appears complete or not at all.

    Raises:
        OSError: See `omni_mj.atomic_files.open_atomic`.
    """
    import pyarrow.parquet as pq

    remaining = iter(arrow_tables)
    head = next(remaining)
    with (
        open_atomic(path) as file,
        pq.ParquetWriter(file, head.schema, compression="zstd") as writer,
    ):
        for arrow_table in chain([head], remaining):
            writer.write_table(arrow_table)

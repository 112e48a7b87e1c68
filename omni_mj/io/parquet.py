"""Tables as Parquet files.

Arrow gets opened files, because it would read a file name with a colon as a URL. A small file may
hold a table that does not fit into the memory, so the sizes are checked before it is read.
"""

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from omni_control.errors import OmniError, to_printable
from omni_mj.io.atomic_files import open_atomic
from omni_mj.io.free_memory import require_memory

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

# Rows of a block in a file that is written. Each block needs some memory until the file is closed.
ROWS_PER_GROUP = 20_000
VALUE_BYTES = 8  # of a number in memory
# A larger table must not need more than this multiple of its file: a few bytes may stand for 1e9
# equal values. The trajectory of 30 robots that rest for 60 s without noise needs 257 times its
# file.
SMALL_BYTES, MAX_EXPANSION = 64_000_000, 1000
MAX_COLUMNS = 10_000


class ParquetHeader(NamedTuple):
    """Names of the columns of a file, and its number of lines."""

    names: Sequence[str]
    n_lines: int


def read_header(path: Path) -> ParquetHeader:
    """Return the names of a file's columns and its number of lines, without reading these.

    Raises:
        OmniError: The file cannot be read.
    """
    with _open_file(path) as (_, parquet_file):
        return ParquetHeader(parquet_file.schema_arrow.names, parquet_file.metadata.num_rows)


def read_table(path: Path, columns: Sequence[str] | None = None) -> "pa.Table":
    """Return the table in a file.

    Args:
        path: The file.
        columns: Names of the columns to read. Default: all.

    Raises:
        OmniError: The file cannot be read, lacks a column, has columns of other types than numbers,
            texts and times, or needs too much memory.
    """
    import pyarrow.parquet as pq

    with _open_file(path) as (file, parquet_file):
        schema, metadata = parquet_file.schema_arrow, parquet_file.metadata
        absent_columns = set(columns or ()) - set(schema.names)
        if absent_columns:
            raise OmniError(f"{path} cannot be read: it has no column {min(absent_columns)}")
        fields = [field for field in schema if columns is None or field.name in columns]
        _check_fields(path, fields, metadata.num_rows)
        texts = [field.name for field in fields if _is_text(field.type)]
        encoded_file = pq.ParquetFile(
            file, metadata=metadata, read_dictionary=texts, pre_buffer=False
        )
        # Without threads: if there is no memory to start one, Arrow waits for it forever.
        arrow_table = encoded_file.read([field.name for field in fields], use_threads=False)
        return _decode_texts(path, arrow_table, schema)


@contextmanager
def _open_file(path: Path) -> "Iterator[tuple[pa.OSFile, pq.ParquetFile]]":
    """Open a file until the end of the block.

    Raises:
        OmniError: The file cannot be read, in the block too, or has too many columns.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if path.exists() and not path.is_file():
        raise OmniError(f"{path} cannot be read: it is not a regular file")
    try:
        # Opening the file by Python first gives readable error messages. Arrow gets no file object
        # of Python: its threads may still hold one when the program ends, which would abort it.
        with path.open("rb"), pa.OSFile(os.fsencode(path), "rb") as file:
            parquet_file = pq.ParquetFile(file, pre_buffer=False)
            n_columns = parquet_file.metadata.num_columns
            if n_columns > MAX_COLUMNS:
                raise OmniError(
                    f"{path} cannot be read: it has {n_columns} columns; at most {MAX_COLUMNS} "
                    "are allowed"
                )
            yield file, parquet_file
    except (OSError, pa.ArrowException, UnicodeError) as error:
        reason = (isinstance(error, OSError) and error.strerror) or str(error)
        raise OmniError(f"{path} cannot be read: {to_printable(reason)}") from None


def write_tables(arrow_tables: "Iterable[pa.Table]", path: Path) -> None:
    """Write one or more tables with the same columns to a file, one after the other.

    The file appears complete or not at all.

    Raises:
        OSError: See `omni_mj.io.atomic_files.open_atomic`.
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


def _check_fields(path: Path, fields: "Sequence[pa.Field]", n_rows: int) -> None:
    """Raise `OmniError` if columns are nested, share a name, or do not fit into the memory."""
    from pyarrow import types

    counts = Counter(field.name for field in fields)
    for field in fields:
        name = to_printable(field.name, 100)
        if counts[field.name] > 1:
            raise OmniError(f"{path} cannot be read: it has two columns {name}")
        is_plain = types.is_primitive(field.type) or types.is_null(field.type)
        if not (is_plain or _is_text(field.type) or types.is_dictionary(field.type)):
            kind = to_printable(str(field.type), 100)
            raise OmniError(
                f"{path} cannot be read: its column {name} must hold numbers, texts or times, "
                f"not {kind}"
            )
    _check_size(path, f"{n_rows} rows of {len(fields)} columns", n_rows * len(fields) * VALUE_BYTES)


def _decode_texts(path: Path, arrow_table: "pa.Table", schema: "pa.Schema") -> "pa.Table":
    """Return a table whose texts have the types of a schema in place of dictionaries."""
    import pyarrow.compute as pc

    for i, field in enumerate(arrow_table.schema):
        if (text_type := schema.field(field.name).type) == field.type:
            continue
        column = arrow_table.column(i)
        lengths = (
            pc.sum(pc.binary_length(chunk.dictionary).take(chunk.indices)).as_py() or 0
            for chunk in column.chunks
        )
        name = to_printable(field.name, 100)
        _check_size(path, f"the texts of its column {name}", sum(lengths))
        arrow_table = arrow_table.set_column(i, field.name, column.cast(text_type))
    return arrow_table


def _check_size(path: Path, content: str, n_bytes: int) -> None:
    """Raise `OmniError` if some content of a file needs too much memory, or is a bomb."""
    require_memory(path, content, n_bytes)
    n_file_bytes = path.stat().st_size
    if n_bytes > max(SMALL_BYTES, MAX_EXPANSION * n_file_bytes):
        raise OmniError(
            f"{path} cannot be read: {content} need {n_bytes / n_file_bytes:.0f} times the memory "
            f"of the file; at most {MAX_EXPANSION} times are allowed"
        )


def _is_text(arrow_type: "pa.DataType") -> bool:
    from pyarrow import types

    return types.is_string(arrow_type) or types.is_large_string(arrow_type)

"""Tables of logs: CSV in its dialects, and Parquet, as columns of numbers by name.

CSV may be separated by commas, semicolons or tabs, with decimal points or, unless commas separate, decimal commas.
It may begin with a byte order mark and lines of comment (#); its header may have spaces and quotes. Empty lines are
skipped.
"""

import csv
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.errors import OmniError, printable
from omni_mj import parquet

CLOCKS = {"time_ms": 1e-3, "time_us": 1e-6, "time_ns": 1e-9}  # in place of time_s


def read(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a file.

    Raises:
        OmniError: there is no such file, or it is no table.
    """
    import pyarrow as pa

    if not os.path.isfile(path):
        raise OmniError(f"there is no log {path}")
    readers = {".csv": _csv, ".parquet": parquet.read}
    if path.suffix.lower() not in readers:
        raise OmniError(f"{path}: a log is a .csv or .parquet file with named columns, or a game log, .log or .log.gz")
    try:
        table = readers[path.suffix.lower()](path)
        columns = {name.strip().lower(): _numbers(table[name]) for name in table.column_names if name}
    except (pa.ArrowException, OSError, UnicodeError) as error:
        raise OmniError(f"{path} cannot be read: {printable(str(error))}") from None
    for name, unit in CLOCKS.items():
        if "time_s" not in columns and name in columns and columns[name].dtype.kind in "fiu":
            columns["time_s"] = (columns[name] - columns[name][0]) * unit
    return columns


def numeric(path: Path, columns: Mapping[str, np.ndarray], names: Iterable[str]) -> None:
    """Raise an error if columns of these names hold something else than numbers.

    Raises:
        OmniError: one does.
    """
    for name in names:
        if name in columns and (kind := columns[name].dtype.kind) not in "fiu":
            says = "is a time of day; give seconds" if kind in "Mm" else "holds something else than numbers"
            odd = next((str(value) for value in columns[name].tolist() if not _is_number(value)), "text")
            raise OmniError(f"{path.name}: column {name} {says}, such as {odd[:40]!r}")


def _is_number(value: Any) -> bool:
    try:
        return not isinstance(value, bool) and float("nan" if value is None else value) is not None
    except (TypeError, ValueError):
        return False


def _csv(path: Path) -> Any:
    import pyarrow as pa
    import pyarrow.csv

    data = path.read_bytes()
    text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig", errors="replace")
    lines = [line for line in text.splitlines() if line.strip()]
    begin = next((i for i, line in enumerate(lines) if not line.lstrip().startswith("#")), len(lines))
    if begin < len(lines) and _is_number(lines[begin].replace(";", ",").replace("\t", ",").split(",")[0]):
        begin -= 1  # numpy's savetxt makes the header a comment
        if begin < 0:
            raise OmniError(f"{path.name} has no header: its first line holds numbers; name the columns there")
    header, row, *_ = [*lines[begin : begin + 2], "", ""]
    separator = max(",;\t", key=lambda mark: min(header.count(mark), (row or header).count(mark)))
    fields = next(csv.reader([header.lstrip("# ")], delimiter=separator, skipinitialspace=True), []) or [""]
    names = [name.strip().strip("\"'").strip().lower() for name in fields]
    if twice := next((name for name in names if name and names.count(name) > 1), None):
        raise OmniError(f"{path.name}: column {twice} is there twice")
    body = "\n".join(lines[begin + 1 :])
    kept = pa.BufferOutputStream()  # Arrow's own, as in `omni_mj.parquet`
    kept.write(body.encode() or b"\n")
    return pyarrow.csv.read_csv(
        pa.BufferReader(kept.getvalue()),
        read_options=pa.csv.ReadOptions(column_names=names),
        parse_options=pa.csv.ParseOptions(delimiter=separator),
        convert_options=pa.csv.ConvertOptions(decimal_point="," if separator != "," and "," in body else "."),
    )


def _numbers(column: Any) -> np.ndarray:
    import pyarrow as pa

    if pa.types.is_null(column.type) or pa.types.is_decimal(column.type):
        column = column.cast(pa.float64())
    return np.asarray(column.to_numpy())

"""Tables of logs: CSV in its dialects, and Parquet, as columns of numbers by name.

CSV may be separated by commas, semicolons or tabs, with decimal points or, unless commas separate, decimal commas; it
may begin with a byte order mark and lines of comment (#), and its header may have spaces and quotes. Empty lines are
passed over; so are columns that hold no numbers, unless they are asked for.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.errors import OmniError, printable
from omni_mj import parquet

SEPARATORS = ",;\t"
CLOCKS = {"time_ms": 1e-3, "time_us": 1e-6, "time_ns": 1e-9}  # in place of time_s


def read(path: Path) -> dict[str, np.ndarray]:
    """The columns of a file.

    Raises:
        OmniError: there is no such file, or it is no table; a line says why.
    """
    import pyarrow as pa

    if not os.path.isfile(path):
        raise OmniError(f"there is no log {path}")
    kinds = {".csv": _csv, ".parquet": parquet.read}
    if path.suffix.lower() not in kinds:
        raise OmniError(f"{path}: a log is a .csv or .parquet file with named columns, or a game log, .log or .log.gz")
    try:
        table = kinds[path.suffix.lower()](path)
        columns = {name.strip().lower(): _numbers(table[name]) for name in table.column_names if name}
    except (pa.ArrowException, OSError, UnicodeError) as error:
        raise OmniError(f"{path} cannot be read: {printable(str(error))}") from None
    columns = _lines_with_something(columns)
    for name, unit in CLOCKS.items():
        if "time_s" not in columns and name in columns and columns[name].dtype.kind in "fiu":
            values = columns[name]
            columns["time_s"] = (values - values[0]) * unit if values.dtype.kind in "iu" else values * unit
    return columns


def numeric(path: Path, columns: Mapping[str, np.ndarray], names: tuple[str, ...]) -> None:
    """Tell which of these columns, as far as they are there, hold something else than numbers.

    Raises:
        OmniError: one does.
    """
    for name in names:
        if name in columns and columns[name].dtype.kind not in "fiu":
            values = columns[name]
            kind = (
                "is a time of day; give seconds" if values.dtype.kind in "Mm" else "holds something else than numbers"
            )
            odd = next((str(value) for value in values.tolist() if not _is_number(value)), None)
            raise OmniError(f"{path.name}: column {name} {kind}, {f'such as {odd[:40]!r}' if odd else 'but text'}")


def _is_number(value: Any) -> bool:
    if isinstance(value, bool):
        return False
    try:
        float("nan" if value is None else value)
    except (TypeError, ValueError):
        return False
    return True


def _csv(path: Path) -> Any:
    import pyarrow as pa
    import pyarrow.csv

    data = path.read_bytes()
    utf16 = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    text = data.decode("utf-16" if utf16 else "utf-8-sig", errors="replace")
    lines = text.splitlines()
    begin = next((i for i, line in enumerate(lines) if line.strip() and not _comment(line)), len(lines))
    before = [line for line in lines[:begin] if line.strip()]
    header = lines[begin] if begin < len(lines) else ""
    if _is_row(header):
        if not before:
            raise OmniError(f"{path.name} has no header: its first line holds numbers; name the columns there")
        header, begin = before[-1].lstrip("# "), begin - 1  # numpy's savetxt makes a comment of it
    separator = max(SEPARATORS, key=header.count)
    names = [name.strip().strip("\"'").strip().lower() for name in header.split(separator)]
    if twice := next((name for name in names if name and names.count(name) > 1), None):
        raise OmniError(f"{path.name}: column {twice} is there twice")
    body = "\n".join(line for line in lines[begin + 1 :] if line.strip())
    comma = separator != "," and "," in body
    kept = pa.BufferOutputStream()  # Arrow's own, as in `omni_mj.parquet`
    kept.write(body.encode() or b"\n")
    return pyarrow.csv.read_csv(
        pa.BufferReader(kept.getvalue()),
        read_options=pa.csv.ReadOptions(column_names=names),
        parse_options=pa.csv.ParseOptions(delimiter=separator),
        convert_options=pa.csv.ConvertOptions(decimal_point="," if comma else "."),
    )


def _comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def _is_row(line: str) -> bool:
    first = line.replace(";", ",").replace("\t", ",").split(",")[0].strip()
    try:
        float(first)
    except ValueError:
        return False
    return True


def _numbers(column: Any) -> np.ndarray:
    import pyarrow as pa

    if pa.types.is_null(column.type):
        return np.full(len(column), np.nan)
    if pa.types.is_decimal(column.type):
        column = column.cast(pa.float64())
    return np.asarray(column.to_numpy())


def _lines_with_something(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Without lines in which no number is."""
    numbers = [values for values in columns.values() if values.dtype.kind == "f"]
    if not numbers or len(numbers) < len(columns):
        return columns
    some = np.isfinite(np.stack(numbers, axis=1)).any(1)
    return columns if some.all() else {name: values[some] for name, values in columns.items()}

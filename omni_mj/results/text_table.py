"""Tables of strings: their columns, and their text for the terminal and for Markdown."""

import sys
import textwrap
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from omni_mj.io.printable_text import to_encodable

DASH = "\N{EN DASH}"
TERMINAL_WIDTH = 80
MAX_LABEL_WIDTH = 40  # longer labels get a line of their own
Column = tuple[str, ...]  # heading and cells


@dataclass(frozen=True)
class Table:
    """Headings and rows of strings. The first `left_columns` columns are aligned to the left."""

    title: str
    headings: list[str]
    rows: list[list[str]]
    left_columns: int


def format_table(text_table: Table) -> str:
    """Return a table as lines of plain text that fit the terminal.

    Columns without any text are left out. If the table is too wide, units go to a second line of
    the headings. Columns that still do not fit follow in another block below, without rows that
    are empty there. Long labels of rows get a line of their own. Characters that standard output
    cannot show are replaced.

    Args:
        text_table: Table to print. Units follow a comma in its headings.
    """
    n_labels = text_table.left_columns
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    columns = [
        tuple(to_encodable(text, encoding) for text in column)
        for i, column in enumerate(zip(text_table.headings, *text_table.rows, strict=True))
        if i < n_labels or any(column[1:])
    ]
    if _width(columns) > TERMINAL_WIDTH:
        columns = [_split_heading(column) for column in columns]
    labels = columns[:n_labels]
    blocks: list[list[Column]] = [[]]
    for column in columns[n_labels:]:
        if blocks[-1] and _width([*labels, *blocks[-1], column]) > TERMINAL_WIDTH:
            blocks.append([])
        blocks[-1].append(column)
    title = textwrap.fill(text_table.title, TERMINAL_WIDTH)
    body = "\n\n".join(_format_block(labels, block) for block in blocks)
    return f"{title}\n{body}"


def drop_equal_columns(text_table: Table, kept_headings: Collection[str]) -> Table:
    """Return a table without columns that are empty or have the same value in all rows.

    The title names these values.

    Args:
        text_table: Table. Its left-aligned columns stay.
        kept_headings: Headings of columns that stay even if all their values are equal.
    """
    columns, equal_values = [], []
    for i, column in enumerate(zip(text_table.headings, *text_table.rows, strict=True)):
        values = [cell for cell in column[1:] if cell not in ("", DASH)]
        is_equal = len(values) > 1 and len(set(values)) == 1
        is_informative = values and (column[0] in kept_headings or not is_equal)
        if i < text_table.left_columns or is_informative:
            columns.append(column)
        elif values:
            quantity, _, unit = column[0].partition(", ")
            equal_values.append(f"{quantity} {values[0]} {unit}".rstrip())
    headings, *rows = map(list, zip(*columns, strict=True))
    title = text_table.title
    if equal_values:
        title += f"; equal for all: {', '.join(equal_values)}"
    return Table(title, headings, rows, text_table.left_columns)


def format_markdown(text_table: Table) -> str:
    """Return a table in Markdown with one line of headings, without its title."""
    headings = text_table.headings
    lines = [headings, ["---"] * len(headings), *text_table.rows]
    return "\n".join("| " + " | ".join(map(escape_markdown_cell, line)) + " |" for line in lines)


def escape_markdown_cell(text: str) -> str:
    """Return a text without characters that would end a cell or line of a table in Markdown."""
    return " ".join(text.replace("|", "\\|").split())


def format_number(value: float | None, factor: float = 1.0, digits: int = 2) -> str:
    """Return factor times a number as text, or a dash for None. The text is never "-0"."""
    return DASH if value is None else f"{factor * value:z.{digits}f}"


def _split_heading(column: Column) -> Column:
    """Return a column whose heading has its unit in a second line."""
    quantity, _, unit = column[0].partition(", ")
    return (quantity, unit, *column[1:])


def _width(columns: Sequence[Column]) -> int:
    """Return the width of columns side by side, in characters."""
    return sum(2 + _column_width(column) for column in columns) - 2


def _column_width(column: Column) -> int:
    """Return the width of a column without its long labels, in characters."""
    return max((len(text) for text in column if len(text) <= MAX_LABEL_WIDTH), default=0)


def _format_block(labels: Sequence[Column], values: Sequence[Column]) -> str:
    """Return columns side by side, without empty lines, such as one for units that do not exist."""
    columns = [*labels, *values]
    widths = [_column_width(column) for column in columns]
    lines = []
    for label, *texts in zip(*columns, strict=True):
        if label and not any(texts[len(labels) - 1 :]):
            continue
        if len(label) > MAX_LABEL_WIDTH:
            lines.append(textwrap.fill(label, TERMINAL_WIDTH))
            label = ""
        aligned = [
            text.ljust(width) if i < len(labels) else text.rjust(width)
            for i, (text, width) in enumerate(zip([label, *texts], widths, strict=True))
        ]
        lines.append("  ".join(aligned).rstrip())
    return "\n".join(filter(None, lines))

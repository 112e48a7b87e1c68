"""Tables on the terminal and in Markdown."""

import shutil
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omni_mj.measure.table import Table

PIPE_WIDTH = 140  # columns if the output is no terminal


def width() -> int:
    """Return the width of the terminal, or one that suits a file if there is none."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else PIPE_WIDTH


def show(table: "Table") -> None:
    """Print a table, its title above it."""
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    printed = RichTable(box=SIMPLE, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for i, heading in enumerate(table.headings):
        is_left = i < table.left
        printed.add_column(heading, justify="left" if is_left else "right", no_wrap=is_left, overflow="fold")
    before = ""
    for row in table.rows:
        if row[0] not in ("", before) and table.left > 1 and printed.row_count:
            printed.add_section()
        before = row[0]
        printed.add_row(*map(Text, row))
    console = Console(width=width())
    console.print(Text(table.title, "bold"))
    console.print(printed)


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown with one line of headings."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(map(plain, line)) + " |" for line in lines)


def plain(text: str) -> str:
    """Return a user's text so that it cannot break a table in Markdown."""
    return " ".join(text.replace("|", "\\|").split())


def titled(table: "Table") -> str:
    """Return a table in Markdown with its title above it."""
    return f"{table.title}\n\n{markdown(table.headings, table.rows)}"

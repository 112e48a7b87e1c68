"""Tables on the terminal."""

import shutil
import sys
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from textwrap import wrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omni_mj.measure.table import Table

PIPE_WIDTH = 140  # columns, where the output is no terminal
NARROWEST = 20  # columns of a text that is wrapped


def width() -> int:
    """That of the terminal, or what is good for a file where there is none."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else PIPE_WIDTH


def show(table: "Table") -> None:
    """Print a table, its title above it."""
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table as Drawn

    drawn = Drawn(box=SIMPLE, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for i, heading in enumerate(table.headings):
        left = i < table.left
        drawn.add_column(heading, justify="left" if left else "right", no_wrap=left, overflow="fold")
    before = ""
    for row in table.rows:
        if row[0] not in ("", before) and table.left > 1 and drawn.row_count:
            drawn.add_section()
        before = row[0]
        drawn.add_row(*map(escape, row))
    console = Console(width=width())
    console.print(table.title, style="bold", highlight=False, markup=False)
    console.print(drawn)


def wrapped(rows: Sequence[Sequence[str]], widest: Sequence[int | None]) -> Iterator[str]:
    """Lines of a table whose cells are wrapped; for long lists, which rich takes long to draw.

    Args:
        rows: of strings.
        widest: of each column but the last, characters, or None where cells are not wrapped; the last has what is left.
    """
    sizes = [max(len(row[i]) for row in rows) for i in range(len(widest))]
    sizes = [size if limit is None else min(size, limit) for size, limit in zip(sizes, widest, strict=True)]
    sizes.append(max(width() - sum(sizes) - 2 * len(sizes) - 2, NARROWEST))
    for row in rows:
        cells = [
            wrap(cell, size, break_on_hyphens=False) if len(cell) > size else [cell]
            for cell, size in zip(row, sizes, strict=True)
        ]
        for line in zip_longest(*cells, fillvalue=""):
            yield "  ".join(text.ljust(size) for text, size in zip(line, sizes, strict=True)).rstrip()

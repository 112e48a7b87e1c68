"""Tables on the terminal."""

import shutil
import sys
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
    from rich.markup import escape
    from rich.table import Table as Drawn

    drawn = Drawn(box=SIMPLE, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for i, heading in enumerate(table.headings):
        is_left = i < table.left
        drawn.add_column(heading, justify="left" if is_left else "right", no_wrap=is_left, overflow="fold")
    before = ""
    for row in table.rows:
        if row[0] not in ("", before) and table.left > 1 and drawn.row_count:
            drawn.add_section()
        before = row[0]
        drawn.add_row(*map(escape, row))
    console = Console(width=width())
    console.print(table.title, style="bold", highlight=False, markup=False)
    console.print(drawn)

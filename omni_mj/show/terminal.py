"""Tables on the terminal."""

import sys
from typing import TYPE_CHECKING

from omni_mj.measure.table import Table

if TYPE_CHECKING:
    from rich.console import Console

PIPE_WIDTH = 120  # columns, where the output is no terminal


def console(width: int = PIPE_WIDTH) -> "Console":
    """What prints: as wide as the terminal, or `width` columns where there is none."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else width)


def show(table: Table) -> None:
    """Print a table, its title above it."""
    from rich.box import SIMPLE
    from rich.markup import escape
    from rich.table import Table as Drawn

    drawn = Drawn(box=SIMPLE, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for i, heading in enumerate(table.headings):
        left = i < table.left
        drawn.add_column(heading, justify="left" if left else "right", no_wrap=left)
    for row in table.rows:
        if row[0] and table.left > 1 and drawn.row_count:
            drawn.add_section()
        drawn.add_row(*map(escape, row))
    output = console()
    output.print(table.title, style="bold", highlight=False, markup=False)
    output.print(drawn)

"""Markdown tables."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_mj.files import write
from omni_mj.measure.table import table as table_of

if TYPE_CHECKING:
    from omni_mj.measure.table import Table


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table with one line of headings."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(map(plain, line)) + " |" for line in lines)


def plain(text: str) -> str:
    """Return a user's text so that it cannot break a table."""
    return " ".join(text.replace("|", "\\|").split())


def titled(content: "Table") -> str:
    """Return a table with its title above it."""
    return f"{content.title}\n\n{table(content.headings, content.rows)}"


def result(summary: Mapping[str, Any]) -> str:
    """Return the table of a summary with its title."""
    return titled(table_of(summary))


def save(content: "Table", path: Path) -> None:
    """Write a table with its title to a file."""
    write(path, titled(content) + "\n")

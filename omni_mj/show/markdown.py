"""Markdown tables."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from omni_mj.measure.table import table as table_of


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with one line of headings."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(map(plain, line)) + " |" for line in lines)


def plain(text: str) -> str:
    """Text of a user's that cannot break a table."""
    return " ".join(text.replace("|", "\\|").split())


def result(summary: Mapping[str, Any]) -> str:
    """The table of a summary, its title above it."""
    found = table_of(summary)
    return f"{found.title}\n\n{table(found.headings, found.rows)}"

"""Errors that a user can cause, and text for their messages."""

import difflib
from collections.abc import Iterable

MAX_LISTED_NAMES = 60


class OmniError(ValueError):
    """Invalid input or request. The message says what is wrong, where, and what is allowed."""


class ControllerError(OmniError):
    """Failure of a controller in its constructor or while it ran. The message says where."""


def to_printable(text: str, max_length: int = 500) -> str:
    """Return arbitrary text as one line of limited length without control characters."""
    line = "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode()
        for c in " ".join(text.split())
    )
    return line if len(line) <= max_length else f"{line[:max_length]}..."


def suggest_names(misspelled: object, allowed: Iterable[str]) -> str:
    """Return 'did you mean X? choose from A, B, C', with the allowed names in the given order.

    A long list is left out if similar names exist: 'did you mean X, Y or Z?'.
    """
    names = list(allowed)
    similar = difflib.get_close_matches(str(misspelled), names, n=3)
    if similar and len(names) > MAX_LISTED_NAMES:
        listed = ", ".join(map(repr, similar[:-1]))
        return f"did you mean {listed + ' or ' if listed else ''}{similar[-1]!r}?"
    hint = f"did you mean {similar[0]!r}? " if similar else ""
    return f"{hint}choose from {', '.join(names)}"

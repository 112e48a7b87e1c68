"""Errors that a user can cause, and text for their messages."""

import difflib
from collections.abc import Iterable, Sequence

MAX_LISTED_NAMES = 60
MAX_LISTED_VALUES = 10
MAX_LINE_LENGTH = 4000  # characters of a line of a message
MAX_VALUE_LENGTH = 200  # characters of a wrong value in a message


class OmniError(ValueError):
    """Invalid input or request. The message says what is wrong, where, and what is allowed."""

    def __str__(self) -> str:
        """Return the message without control characters, which files and arguments may contain."""
        return "\n".join(
            to_printable(line, MAX_LINE_LENGTH) for line in super().__str__().split("\n")
        )


class ControllerError(OmniError):
    """Failure of a controller in its constructor or while it ran. The message says where."""


def to_printable(text: str, max_length: int = 500) -> str:
    """Return arbitrary text as one line of limited length without control characters."""
    line = "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode()
        for c in " ".join(text.split())
    )
    return line if len(line) <= max_length else f"{line[:max_length]}..."


def format_value(value: object) -> str:
    """Return a wrong value as one printable line of limited length, for messages."""
    try:
        return to_printable(repr(value), MAX_VALUE_LENGTH)
    except Exception:  # integers of thousands of digits, deeply nested lists, a faulty __repr__
        return "a value that cannot be printed"


def list_first(items: Sequence[str], separator: str = ", ", limit: int = MAX_LISTED_VALUES) -> str:
    """Return the first items of a list as text, with the number of the others."""
    more = [f"and {len(items) - limit} more"] if len(items) > limit else []
    return separator.join([*items[:limit], *more])


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
    return f"{hint}choose from {list_first(names, limit=MAX_LISTED_NAMES)}"

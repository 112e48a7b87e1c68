"""The base class of errors that a user can cause, that of controllers that fail, and help with misspelt names."""

import difflib
from collections.abc import Iterable

MANY = 60  # names


class OmniError(ValueError):
    """What a user gave, or asked for, cannot be: the message says what, why, and what is allowed."""


class ControllerError(OmniError):
    """A controller failed when it was made or while it ran; says which, when and where."""


def to_printable(text: str, most: int = 500) -> str:
    """A text of whoever it is as a message shows it: in one line, without control characters, not too long."""
    line = "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode()
        for c in " ".join(text.split())
    )
    return line if len(line) <= most else f"{line[:most]}..."


def suggest_names(wrong: object, allowed: Iterable[str]) -> str:
    """'did you mean X? choose from A, B, C' for a misspelt name; the names in the order given.

    Where there are more than anybody reads, and some are like it, those alone: 'did you mean X, Y
    or Z?'.
    """
    names = list(allowed)
    near = difflib.get_close_matches(str(wrong), names, n=3)
    if near and len(names) > MANY:
        *others, last = map(repr, near)
        return f"did you mean {', '.join(others)} or {last}?" if others else f"did you mean {last}?"
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{hint}choose from {', '.join(names)}"

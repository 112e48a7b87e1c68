"""Help with misspelt names."""

import difflib
from collections.abc import Iterable


def choose(wrong: object, allowed: Iterable[str]) -> str:
    """'did you mean X? choose from A, B, C' for a misspelt name."""
    near = difflib.get_close_matches(str(wrong), list(allowed), n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{hint}choose from {', '.join(sorted(allowed))}"

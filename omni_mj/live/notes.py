"""What goes wrong on the way: counted, told once, and gone on without."""

from collections import Counter
from collections.abc import Callable

MANY = 20  # of what is worth to be told each time, until there is no end of it


class Notes:
    """Counts what happens, by its kind, and tells the first of each kind.

    Args:
        tell: called with the first of each kind, in words.

    Attributes:
        counts: kind -> how often.
    """

    def __init__(self, tell: Callable[[str], None] = lambda text: None) -> None:
        self._tell = tell
        self.counts: Counter[str] = Counter()

    def add(self, kind: str, text: str, *, always: bool = False) -> None:
        """Count one; its text is told if it is the first of its kind, or, if always, among the first `MANY`."""
        self.counts[kind] += 1
        last = MANY if always else 1
        if self.counts[kind] <= last:
            self._tell(text if self.counts[kind] < last else f"{text}; more of this kind are counted only")

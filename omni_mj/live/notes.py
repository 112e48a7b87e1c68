"""What goes wrong on the way: counted, told once, and gone on without."""

from collections import Counter
from collections.abc import Callable


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
        """Count an event, and tell it if it is the first of its kind, or always."""
        self.counts[kind] += 1
        if always:
            self._tell(text)
        elif self.counts[kind] == 1:
            self._tell(f"{text}; more of this kind are counted only")

"""Which faults of which rows are going on, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from omni_mj.config.faults import Fault, span

Kind = TypeVar("Kind", bound=Fault)


@dataclass(frozen=True)
class ActiveFaults:
    """The faults that go on: (row, fault), row by row, in a row in the order of its scenario.

    Attributes:
        faults: All of them.
        new: Those that have begun since the last change.
    """

    faults: Sequence[tuple[int, Fault]]
    new: Sequence[tuple[int, Fault]] = ()

    def of_kind(self, kind: type[Kind]) -> Iterator[tuple[int, Kind]]:
        """Return those of a kind."""
        return ((row, fault) for row, fault in self.faults if isinstance(fault, kind))

    def started(self, kind: type[Kind]) -> Iterator[tuple[int, Kind]]:
        """Return those of a kind that are new."""
        return ((row, fault) for row, fault in self.new if isinstance(fault, kind))


class FaultSchedule:
    """Faults by the frames in which they begin and end.

    Args:
        faults: Of each row.
        kinds: The kinds that matter.
    """

    def __init__(self, faults: Sequence[Sequence[Fault]], *kinds: type[Fault]) -> None:
        self._spans = [
            (row, fault, *span(fault))
            for row, own in enumerate(faults)
            for fault in own
            if isinstance(fault, kinds)
        ]
        self._changes = sorted(
            {frame for *_, start, end in self._spans for frame in (start, end)}, reverse=True
        )
        self._last = -1

    def update(self, frame: int) -> ActiveFaults | None:
        """Return the faults that go on in a frame, not before that of the last call; None if nothing has changed."""
        if not self._changes or self._changes[-1] > frame:
            return None
        while self._changes and self._changes[-1] <= frame:
            self._changes.pop()
        last, self._last = self._last, frame
        going = [
            (row, fault, start) for row, fault, start, end in self._spans if start <= frame < end
        ]
        return ActiveFaults(
            [each[:2] for each in going],
            [(row, fault) for row, fault, start in going if start > last],
        )

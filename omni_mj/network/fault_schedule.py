"""Faults that are active in each frame, for all rows of a batch."""

import math
from collections.abc import Iterator, Sequence
from typing import TypeVar

from omni_mj.config.faults import Fault

Kind = TypeVar("Kind", bound=Fault)
FaultsByRow = Sequence[Sequence[Fault]]


class FaultSchedule:
    """Faults of all rows, and those that are active in the present frame.

    Args:
        faults: Faults of each row.
    """

    def __init__(self, faults: FaultsByRow) -> None:
        self._spans = [
            (row, fault, *fault.frame_span)
            for row, row_faults in enumerate(faults)
            for fault in row_faults
        ]
        self._active: list[tuple[int, Fault]] = []
        self._next_change = 0.0  # frame before which nothing starts or ends

    def advance(self, frame: int) -> bool:
        """Advance to a frame, and return whether the active faults have changed.

        Args:
            frame: Number of the frame, not below that of the previous call.
        """
        if frame < self._next_change:
            return False
        changes = (change for *_, start, end in self._spans for change in (start, end))
        self._next_change = min((change for change in changes if change > frame), default=math.inf)
        previous = self._active
        self._active = [
            (row, fault) for row, fault, start, end in self._spans if start <= frame < end
        ]
        return self._active != previous

    def list_active(self, kind: type[Kind]) -> Iterator[tuple[int, Kind]]:
        """Yield the active faults of a kind as pairs (row, fault).

        They are sorted by row, then by their order in the scenario. None are active before the
        first call of `advance`.
        """
        return ((row, fault) for row, fault in self._active if isinstance(fault, kind))

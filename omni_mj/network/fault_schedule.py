"""Faults that are active in each frame, for all rows of a batch."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from omni_mj.config.faults import Fault

Kind = TypeVar("Kind", bound=Fault)
FaultsByRow = Sequence[Sequence[Fault]]


@dataclass(frozen=True)
class ActiveFaults:
    """Active faults as pairs (row, fault), sorted by row, then by their order in the scenario."""

    faults: Sequence[tuple[int, Fault]]

    def of_kind(self, kind: type[Kind]) -> Iterator[tuple[int, Kind]]:
        """Return the active faults of a kind."""
        return ((row, fault) for row, fault in self.faults if isinstance(fault, kind))


class FaultSchedule:
    """Start and end of the faults of all rows.

    Args:
        faults: Faults of each row.
        kinds: Kinds of faults to schedule; others are ignored.
    """

    def __init__(self, faults: FaultsByRow, *kinds: type[Fault]) -> None:
        self._spans = [
            (row, fault, *fault.frame_span)
            for row, row_faults in enumerate(faults)
            for fault in row_faults
            if isinstance(fault, kinds)
        ]
        self._active: list[tuple[int, Fault]] = []
        self._next_change = 0.0  # frame before which nothing starts or ends

    def update(self, frame: int) -> ActiveFaults | None:
        """Return the faults that are active in a frame, or None if they have not changed.

        Args:
            frame: Number of the frame, not below that of the previous call.
        """
        if frame < self._next_change:
            return None
        changes = (change for *_, start, end in self._spans for change in (start, end))
        self._next_change = min((change for change in changes if change > frame), default=math.inf)
        active = [(row, fault) for row, fault, start, end in self._spans if start <= frame < end]
        if active == self._active:
            return None
        self._active = active
        return ActiveFaults(active)

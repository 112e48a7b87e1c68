"""Which faults of which rows are going on, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, Self, TypeVar

from omni_mj.link.noise import Seed
from omni_mj.scenarios.faults import Fault, span

Kind = TypeVar("Kind", bound=Fault)


@dataclass(frozen=True)
class Active:
    """Those that go on: (row, fault), row by row, in a row in the order in which its scenario has them.

    Attributes:
        faults: all of them.
        new: those that begin now.
    """

    faults: Sequence[tuple[int, Fault]]
    new: Sequence[tuple[int, Fault]] = ()

    def of(self, kind: type[Kind]) -> Iterator[tuple[int, Kind]]:
        """Those of a kind."""
        return ((row, fault) for row, fault in self.faults if isinstance(fault, kind))

    def begun(self, kind: type[Kind]) -> Iterator[tuple[int, Kind]]:
        """Those of a kind that begin now."""
        return ((row, fault) for row, fault in self.new if isinstance(fault, kind))


class Schedule:
    """Tells what goes on in the frames in which that changes; in all others it costs a look into a set.

    Args:
        faults: of each row.
        kinds: those that matter to whoever asks.

    Attributes:
        kinds: those of them that happen to any row.
    """

    def __init__(self, faults: Sequence[Sequence[Fault]], *kinds: type[Fault]) -> None:
        own = [(row, fault) for row, each in enumerate(faults) for fault in each if isinstance(fault, kinds)]
        self.kinds = tuple(kind for kind in kinds if any(isinstance(fault, kind) for _, fault in own))
        self._spans = [(row, fault, *span(fault)) for row, fault in own]
        self._next = 0
        self._changes = {frame for *_, start, end in self._spans for frame in (start, end)}

    def at(self, frame: int) -> Active | None:
        """What goes on from this frame on; None if that is what went on before."""
        if frame not in self._changes:
            return None
        going = [(row, fault, start) for row, fault, start, end in self._spans if start <= frame < end]
        return Active([each[:2] for each in going], [(row, fault) for row, fault, start in going if start == frame])

    def until(self, frame: int) -> Active | None:
        """What goes on in a frame, which is not before that of the last call; None if that is what went on then."""
        changes = [passed for passed in range(self._next, frame + 1) if passed in self._changes]
        self._next = frame + 1
        return self.at(changes[-1]) if changes else None


class Met(Protocol):
    """What faults of some kinds do to n robots, made only where one of them has such a fault."""

    kinds: ClassVar[tuple[type[Fault], ...]]

    def __init__(self, schedule: Schedule, seeds: Sequence[Seed]) -> None: ...

    @classmethod
    def of(cls, faults: Sequence[Sequence[Fault]], seeds: Sequence[Seed]) -> Self | None:
        """Of robots with these faults and seeds, one each; None where none of them has any of the kinds."""
        schedule = Schedule(faults, *cls.kinds)
        return cls(schedule, seeds) if schedule.kinds else None

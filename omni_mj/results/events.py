"""What happened in a run: rows that were stopped, faults, hot windings, a dead battery.

An event depends on nothing that comes after its frame, so that events can be told while a run goes on.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from omni_mj.config.faults import compute_frame_span
from omni_mj.config.settings import PERIOD_S
from omni_mj.simulation.log import Log

if TYPE_CHECKING:
    from omni_mj.simulation.simulation import Failure

STOPPED, TEMPERATURE, BATTERY, FAULT = "stopped", "temperature", "battery", "fault"


@dataclass(frozen=True)
class Event:
    """Something that happened to one robot; `kind` is one of those above, `place` its number in its world."""

    frame: int
    time_s: float
    controller: str
    seed: int
    kind: str
    text: str
    slot: int = 0


def find_events(log: Log, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """Return the events of all rows in order of time."""
    failures = list(failures)
    found = [event for row in range(len(log.rows)) for event in row_events(log, row, failures)]
    return sorted(found, key=lambda event: (event.frame, event.kind != STOPPED))


def row_events(log: Log, row: int, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """Return all events of a row in order of time: while its log grows, those before stay the same."""
    whose = log.rows[row]
    stopped = [
        (round(f.time_s / PERIOD_S), STOPPED, f"stopped: {f.cause}")
        for f in failures
        if f.row == row
    ]
    return [
        Event(frame, frame * PERIOD_S, whose.controller, whose.seed, kind, text, whose.slot)
        for frame, kind, text in sorted(
            [*stopped, *_happened(log, row)], key=lambda event: event[0]
        )
    ]


def _happened(log: Log, row: int) -> Iterator[tuple[int, str, str]]:
    """Yield frame, kind and text of what faults, motors and battery do."""
    length, settings = int(log.lengths[row]), log.rows[row].settings
    battery, winding = (log.channel(name)[:length, row] for name in ("battery", "winding"))
    with np.errstate(invalid="ignore"):  # not a number where there are no motors
        hot = (winding > settings.motor.max_winding_c).any(-1)
    if hot.any():
        yield (
            int(hot.argmax()),
            TEMPERATURE,
            f"a winding is above {settings.motor.max_winding_c:g} deg C",
        )
    if (battery == 0).any():
        text = f"the battery sank below {settings.battery.cut_off_v:g} V and gives no more power"
        yield int((battery == 0).argmax()), BATTERY, text
    for fault in log.rows[row].faults:
        for frame, does in zip(compute_frame_span(fault), ("begins", "ends"), strict=True):
            if frame < length:
                yield int(frame), FAULT, f"{does}: {fault.text}"

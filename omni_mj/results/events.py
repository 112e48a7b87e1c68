"""Events of a run: failed rows, faults, overheated windings, an empty battery.

An event depends on no later frame, so that events can be shown while a run continues.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from omni_mj.config import PERIOD_S
from omni_mj.simulation.log import Failure, Log

# Kinds of events.
STOPPED, TEMPERATURE, BATTERY, FAULT = "stopped", "temperature", "battery", "fault"


@dataclass(frozen=True)
class Event:
    """Event of one robot.

    Attributes:
        frame: Frame of the event.
        time_s: Time of the event, s.
        controller: Label of the robot's controller.
        seed: Seed of the row.
        kind: `STOPPED`, `TEMPERATURE`, `BATTERY` or `FAULT`.
        text: Description.
        slot: Index of the robot in its world.
    """

    frame: int
    time_s: float
    controller: str
    seed: int
    kind: str
    text: str
    slot: int


def find_events(log: Log, failures: Sequence[Failure]) -> list[Event]:
    """Return the events of all rows in order of time."""
    events = [event for row in range(len(log.rows)) for event in row_events(log, row, failures)]
    return sorted(events, key=lambda event: (event.frame, event.kind != STOPPED))


def row_events(log: Log, row: int, failures: Sequence[Failure], start: int = 0) -> list[Event]:
    """Return the events of a row in order of time.

    Further frames of the log add events, and change none.

    Args:
        log: The log.
        row: Index of the row.
        failures: Failures of rows.
        start: First frame of the log to consider. Failures always count.
    """
    occurrences = [
        (round(failure.time_s / PERIOD_S), STOPPED, f"stopped: {failure.cause}")
        for failure in failures
        if failure.row == row
    ]
    occurrences += _logged_occurrences(log, row, start)
    occurrences.sort(key=lambda occurrence: occurrence[0])
    source = log.rows[row]
    return [
        Event(frame, frame * PERIOD_S, source.controller, source.seed, kind, text, source.slot)
        for frame, kind, text in occurrences
    ]


def _logged_occurrences(log: Log, row: int, start: int) -> Iterator[tuple[int, str, str]]:
    """Yield frame, kind and text of events of motors, battery and faults from a frame on."""
    length, settings = int(log.lengths[row]), log.rows[row].settings
    battery, winding = (log.channel_of_row(name, row, start) for name in ("battery", "winding"))
    max_winding_c = settings.motor.max_winding_c
    is_hot = (winding > max_winding_c).any(-1)  # false where NaN: on plants without motors
    if is_hot.any():
        yield (
            start + int(is_hot.argmax()),
            TEMPERATURE,
            f"a winding is above {max_winding_c:g} deg C",
        )
    is_empty = battery == 0
    if is_empty.any():
        text = f"the battery is empty: its voltage fell below {settings.battery.cut_off_v:g} V"
        yield start + int(is_empty.argmax()), BATTERY, text
    for fault in log.rows[row].faults:
        for frame, verb in zip(fault.frame_span, ("begins", "ends"), strict=True):
            if start <= frame < length:
                yield int(frame), FAULT, f"{verb}: {fault.label}"

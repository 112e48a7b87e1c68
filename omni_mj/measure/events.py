"""What happened in a run: rows that were stopped, faults, hot windings, a dead battery, limits, misses, way-points.

An event depends on nothing that comes after its frame, so that events can be told while a run goes on.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from omni_control.reference.iterated import ARRIVAL_ANGLE_RAD, ARRIVAL_RADIUS_M
from omni_mj.measure import causes
from omni_mj.scenarios import references
from omni_mj.scenarios.faults import span
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.simulate.log import Log

if TYPE_CHECKING:
    from omni_mj.simulate.simulation import Failure

STOPPED, TEMPERATURE, BATTERY, LIMIT, VOLTAGE, CURRENT, VISION, WAY_POINT, FAULT = KINDS = (
    "stopped", "temperature", "battery", "limit", "voltage", "current", "vision", "way-point", "fault",
)  # fmt: skip
ALWAYS = (STOPPED, TEMPERATURE, BATTERY, FAULT, CURRENT)  # what is told of every row
QUIET_FRAMES = FRAME_RATE_HZ // 4  # what was at a limit no longer ago than this has not left it
ROUNDING = 1e-9  # of a reference that arrives


@dataclass(frozen=True)
class Event:
    """Something that happened to one robot; `kind` is one of `KINDS`, `place` its number in its world."""

    frame: int
    time_s: float
    controller: str
    seed: int
    kind: str
    text: str
    place: int = 0


Happening = tuple[int, str, str]  # frame, kind, text


def find(log: Log, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """Return the important events of all rows in order of time; of current limits only each row's first."""
    failures, found = list(failures), list[Event]()
    for row in range(len(log.rows)):
        events = [event for event in of_row(log, row, failures) if event.kind in ALWAYS]
        first_current = next((event for event in events if event.kind == CURRENT), None)
        found += [event for event in events if event.kind != CURRENT or event is first_current]
    return sorted(found, key=lambda event: (event.frame, event.kind != STOPPED))


def of_row(log: Log, row: int, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """Return all events of a row in order of time: while its log grows, those before stay the same."""
    whose = log.rows[row]
    happened = [
        *((round(f.time_s / PERIOD_S), STOPPED, f"stopped: {f.cause}") for f in failures if f.row == row),
        *_states(log, row),
        *_misses(log, row),
        *_passed_way_points(log, row),
    ]
    return [
        Event(frame, frame * PERIOD_S, whose.controller, whose.seed, kind, text, whose.place)
        for frame, kind, text in sorted(happened, key=lambda event: event[0])
    ]


def _states(log: Log, row: int) -> Iterator[Happening]:
    """Yield faults, and what motors and commands do.

    A limit is met in the first frame at it, `QUIET_FRAMES` after the last.
    """
    length, settings = int(log.lengths[row]), log.rows[row].settings
    names = "battery", "winding", "command", "duty_peak", "current_limited"
    channel = {name: log.channel(name)[:length, row] for name in names}
    battery = channel["battery"][:, 0]
    with np.errstate(invalid="ignore"):  # not a number where there are no motors
        hot = (channel["winding"] > settings.motor.limit_c).any(-1)
    dead_text = f"the battery sank below {settings.battery.cut_off_v:g} V and gives no more power"
    for kind, happens, text in (
        (TEMPERATURE, hot, f"a winding is above {settings.motor.limit_c:g} deg C"),
        (BATTERY, battery == 0, dead_text),
    ):
        if happens.any():
            yield int(happens.argmax()), kind, text
    for fault in log.rows[row].faults:
        for frame, does in zip(span(fault), ("begins", "ends"), strict=True):
            if frame < length:
                yield int(frame), FAULT, f"{does}: {fault.text}"
    full_voltage = (channel["duty_peak"][:, 0] >= 1) & (battery > 0)
    states = [(full_voltage, VOLTAGE, "a motor takes all the battery's voltage")]
    for unit, (value, met) in causes.at_limits(channel["command"], np.zeros(3), settings.control).items():
        states.append((met, LIMIT, f"the command is held back to {value:g} {unit}"))
    for motor, share in enumerate(channel["current_limited"].T, start=1):
        text = f"the driver limits the current of motor {motor} to {settings.firmware.current_limit_a:g} A"
        states.append((share > 0, CURRENT, text))
    for active, kind, text in states:
        frames = np.flatnonzero(active)
        begins = np.diff(frames, prepend=-QUIET_FRAMES - 1) > QUIET_FRAMES
        yield from ((frame, kind, text) for frame in frames[begins].tolist())


def _misses(log: Log, row: int) -> Iterator[Happening]:
    """Yield where vision lost sight of the robot, and where it saw it again after several frames."""
    valid = log.channel("vision_valid")[: log.lengths[row], row, 0].astype(int)
    edges = np.flatnonzero(np.diff(valid, prepend=1)).tolist()
    for i, frame in enumerate(edges):
        if i % 2 == 0:
            yield frame, VISION, "vision does not see the robot"
        elif frame - edges[i - 1] > 1:
            yield frame, VISION, f"vision sees the robot again after {frame - edges[i - 1]} frames"


def _passed_way_points(log: Log, row: int) -> Iterator[Happening]:
    """Yield where the robot reaches a way-point, with the tolerances of the iterated reference.

    The robot passes a way-point between the timed reference's arrivals at its neighbours. An iterated reference has no
    timetable: the robot passes one way-point after the other.
    """
    settings, length = log.rows[row].settings.reference, int(log.lengths[row])
    points = references.waypoints(settings, log.rows[row].where)
    reference, pose = log.channel("ref")[:length, row], log.channel("pose")[:length, row]
    arrivals, frame = [0], 0
    while settings.mode == "timed" and len(arrivals) < len(points):
        is_there = np.abs(reference[arrivals[-1] :] - points[len(arrivals)]).max(-1) < ROUNDING
        if not is_there.any():
            break
        arrivals.append(arrivals[-1] + int(is_there.argmax()))
    for i in range(1, len(points)):
        end = length
        if settings.mode == "timed":
            if i > len(arrivals):
                return
            frame, end = arrivals[i - 1], arrivals[i + 1] if i + 1 < len(arrivals) else length
        offset = np.abs(pose[frame:end] - points[i])
        near = (np.hypot(offset[:, 0], offset[:, 1]) < ARRIVAL_RADIUS_M) & (offset[:, 2] < ARRIVAL_ANGLE_RAD)
        if near.any():
            frame += int(near.argmax())
            yield frame, WAY_POINT, f"way-point {i} of {len(points) - 1} reached"
        elif settings.mode != "timed":
            return

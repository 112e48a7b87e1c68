"""What happened in a run: rows that were stopped, faults, hot windings, a dead battery, limits, misses, way-points.

An event depends on nothing that comes after its frame, so that events can be told while a run goes on.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference.iterated import ARRIVAL_ANGLE_RAD, ARRIVAL_RADIUS_M
from omni_mj.measure import causes
from omni_mj.scenarios import references
from omni_mj.scenarios.faults import span
from omni_mj.scenarios.rows import Row
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


def find(log: Log, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """What a user must know of each row, in the order of time: stopped rows, faults; once, heat, battery, drivers."""
    failures, found = list(failures), list[Event]()
    for row in range(len(log.rows)):
        events = [event for event in of_row(log, row, failures) if event.kind in ALWAYS]
        first_current = next((event for event in events if event.kind == CURRENT), None)
        found += [event for event in events if event.kind != CURRENT or event is first_current]
    return sorted(found, key=lambda event: (event.frame, event.kind != STOPPED))


class Watch:
    """Tells each event of a row once while its log grows.

    Args:
        log: of a simulation that goes on.
        row: whose events are told.
    """

    def __init__(self, log: Log, row: int) -> None:
        self._log, self._row = log, row
        self._known: set[Event] = set()

    def new(self, failures: "Iterable[Failure]" = ()) -> list[Event]:
        """What happened since this was asked last, in the order of time."""
        fresh = [event for event in of_row(self._log, self._row, failures) if event not in self._known]
        self._known.update(fresh)
        return fresh


def of_row(log: Log, row: int, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """Everything that happened to a row, in the order of time: also limits, misses, way-points.

    A limit is met in the first frame at it, `QUIET_FRAMES` after the last.
    """
    own, settings = log.rows[row], log.rows[row].settings
    frames = int(log.lengths[row])
    happened = list[tuple[int, str, str]]()
    for failure in failures:
        if failure.row == row:
            happened.append((round(failure.time_s / PERIOD_S), STOPPED, f"stopped: {failure.cause}"))
    channel = {
        name: log.channel(name)[:frames, row]
        for name in ("pose", "ref", "command", "vision_valid", "duty_peak", "current_limited", "battery", "winding")
    }
    battery = channel["battery"][:, 0]
    with np.errstate(invalid="ignore"):  # not a number where there are no motors
        hot = (channel["winding"] > settings.motor.limit_c).any(-1)
    happened += _once(hot, TEMPERATURE, f"a winding is above {settings.motor.limit_c:g} deg C")
    text = f"the battery sank below {settings.battery.cut_off_v:g} V and gives no more power"
    happened += _once(battery == 0, BATTERY, text)
    for fault in own.faults:
        for frame, does in zip(span(fault), ("begins", "ends"), strict=True):
            if frame < frames:
                happened.append((int(frame), FAULT, f"{does}: {fault.text}"))
    for motor, share in enumerate(channel["current_limited"].T):
        limit = f"{settings.firmware.current_limit_a:g} A"
        happened += _met(share > 0, CURRENT, f"the driver limits the current of motor {motor + 1} to {limit}")
    for unit, (value, met) in causes.at_limits(channel["command"], np.zeros(3), settings.control).items():
        happened += _met(met, LIMIT, f"the command is held back to {value:g} {unit}")
    full = (channel["duty_peak"][:, 0] >= 1) & (battery > 0)
    happened += _met(full, VOLTAGE, "a motor takes all the battery's voltage")
    happened += _misses(channel["vision_valid"][:, 0])
    happened += _way_points(own, channel["pose"], channel["ref"])
    found = [
        Event(frame, frame * PERIOD_S, own.controller, own.seed, kind, text, own.place)
        for frame, kind, text in happened
    ]
    return sorted(found, key=lambda event: event.frame)


def _once(happens: Any, kind: str, text: str) -> list[tuple[int, str, str]]:
    """Return the first frame in which it happens (frames,)."""
    return [(int(happens.argmax()), kind, text)] if happens.any() else []


def _met(active: np.ndarray, kind: str, text: str) -> Iterator[tuple[int, str, str]]:
    """Yield the frames (frames,) in which it becomes active that was not so in the `QUIET_FRAMES` before."""
    frames = np.flatnonzero(active)
    for frame in frames[np.diff(frames, prepend=-QUIET_FRAMES - 1) > QUIET_FRAMES].tolist():
        yield frame, kind, text


def _misses(valid: np.ndarray) -> Iterator[tuple[int, str, str]]:
    """Yield where vision (frames,) lost sight of a robot, and where it saw one again that was away for several."""
    edges = np.flatnonzero(np.diff(valid.astype(int), prepend=1)).tolist()
    for lost, again in zip(edges[::2], [*edges[1::2], None], strict=False):
        yield lost, VISION, "vision does not see the robot"
        if again is not None and again - lost > 1:
            yield again, VISION, f"vision sees the robot again after {again - lost} frames"


def _way_points(row: Row, pose: Array, reference: Array) -> Iterator[tuple[int, str, str]]:
    """Yield where a robot reaches a way-point, as close as the iterated reference asks for.

    A robot passes a way-point between the timed reference's arrivals at the one before and the one after; one that
    plans anew in every frame keeps no timetable and passes them one after the other.
    """
    settings = row.settings.reference
    points = references.waypoints(settings, row.where)
    arrivals = [0]
    for point in points[1:]:
        there = np.flatnonzero(np.abs(reference[arrivals[-1] :] - point).max(-1) < ROUNDING)
        if not there.size:
            break
        arrivals.append(arrivals[-1] + int(there[0]))
    reached = 0
    for i in range(1, len(points)):
        timed = settings.mode == "timed"
        if timed and i > len(arrivals):
            return
        first = arrivals[i - 1] if timed else reached
        stop = arrivals[i + 1] if timed and i + 1 < len(arrivals) else len(pose)
        offset = np.abs(pose[first:stop] - points[i])
        near = (np.hypot(offset[:, 0], offset[:, 1]) < ARRIVAL_RADIUS_M) & (offset[:, 2] < ARRIVAL_ANGLE_RAD)
        if near.any():
            reached = first + int(near.argmax())
            yield reached, WAY_POINT, f"way-point {i} of {len(points) - 1} reached"
        elif not timed:
            return

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
    """Return all events of a row in order of time."""
    return Watch(log, row).new(failures)


class Watch:
    """Search for the events of one row while its log grows; each call looks at the new frames only.

    Args:
        log: Log of a simulation, which may go on.
        row: Row of the log.
    """

    def __init__(self, log: Log, row: int) -> None:
        self._log, self._row = log, row
        self._start = 0  # first frame that was not searched
        self._once = set[str]()  # kinds that happened and do so once
        self._lost: int | None = None  # frame from which on vision does not see the robot
        settings = log.rows[row].settings.reference
        self._way_points = references.waypoints(settings, log.rows[row].where)
        self._is_timed = settings.mode == "timed"
        self._arrivals = [0]  # frames in which the timed reference is at the way-points, as far as known
        self._reached = {0: 0}  # way-point -> frame in which the robot reached it

    def new(self, failures: "Iterable[Failure]" = ()) -> list[Event]:
        """Return what happened since the last call, in order of time.

        A limit is met in the first frame at it, `QUIET_FRAMES` after the last.
        """
        row, stop = self._log.rows[self._row], int(self._log.lengths[self._row])
        happened = [
            *self._stops(failures),
            *(event for event in self._states(stop) if event[0] >= self._start),
            *self._misses(stop),
            *self._passed_way_points(stop),
        ]
        self._start = stop
        events = [
            Event(frame, frame * PERIOD_S, row.controller, row.seed, kind, text, row.place)
            for frame, kind, text in happened
        ]
        return sorted(events, key=lambda event: event.frame)

    def _channel(self, name: str, first: int, stop: int) -> np.ndarray:
        return self._log.channel(name)[first:stop, self._row]

    def _stops(self, failures: "Iterable[Failure]") -> Iterator[Happening]:
        for failure in failures:
            if failure.row == self._row and STOPPED not in self._once:
                self._once.add(STOPPED)
                yield round(failure.time_s / PERIOD_S), STOPPED, f"stopped: {failure.cause}"

    def _states(self, stop: int) -> Iterator[Happening]:
        """Yield faults, and what motors and commands do; also again what happened in the quiet time before."""
        first, row = max(0, self._start - QUIET_FRAMES), self._log.rows[self._row]
        settings = row.settings
        battery = self._channel("battery", first, stop)[:, 0]
        with np.errstate(invalid="ignore"):  # not a number where there are no motors
            hot = (self._channel("winding", first, stop) > settings.motor.limit_c).any(-1)
        dead_text = f"the battery sank below {settings.battery.cut_off_v:g} V and gives no more power"
        for kind, happens, text in (
            (TEMPERATURE, hot, f"a winding is above {settings.motor.limit_c:g} deg C"),
            (BATTERY, battery == 0, dead_text),
        ):
            if happens.any() and kind not in self._once:
                self._once.add(kind)
                yield first + int(happens.argmax()), kind, text
        for fault in row.faults:
            for frame, does in zip(span(fault), ("begins", "ends"), strict=True):
                if frame < stop:
                    yield int(frame), FAULT, f"{does}: {fault.text}"
        command = self._channel("command", max(0, first - 1), stop)
        before, command = (command[0], command[1:]) if first else (np.zeros(3), command)
        full_voltage = (self._channel("duty_peak", first, stop)[:, 0] >= 1) & (battery > 0)
        states = [(full_voltage, VOLTAGE, "a motor takes all the battery's voltage")]
        for unit, (value, met) in causes.at_limits(command, before, settings.control).items():
            states.append((met, LIMIT, f"the command is held back to {value:g} {unit}"))
        for motor, share in enumerate(self._channel("current_limited", first, stop).T):
            limit = f"motor {motor + 1} to {settings.firmware.current_limit_a:g} A"
            states.append((share > 0, CURRENT, f"the driver limits the current of {limit}"))
        for active, kind, text in states:
            frames = np.flatnonzero(active)
            begins = np.diff(frames, prepend=-QUIET_FRAMES - 1) > QUIET_FRAMES
            yield from ((first + frame, kind, text) for frame in frames[begins].tolist())

    def _misses(self, stop: int) -> Iterator[Happening]:
        """Yield where vision lost sight of the robot, and where it saw it again after several frames."""
        valid = self._channel("vision_valid", self._start, stop)[:, 0].astype(int)
        for edge in np.flatnonzero(np.diff(valid, prepend=int(self._lost is None))).tolist():
            frame = self._start + edge
            if self._lost is None:
                self._lost = frame
                yield frame, VISION, "vision does not see the robot"
            else:
                away, self._lost = frame - self._lost, None
                if away > 1:
                    yield frame, VISION, f"vision sees the robot again after {away} frames"

    def _passed_way_points(self, stop: int) -> Iterator[Happening]:
        """Yield where the robot reaches a way-point, with the tolerances of the iterated reference.

        The robot passes a way-point between the timed reference's arrivals at its neighbours. An iterated reference
        has no timetable: the robot passes one way-point after the other.
        """
        points, arrivals = self._way_points, self._arrivals
        while self._is_timed and len(arrivals) < len(points):
            first = max(self._start, arrivals[-1])
            offset = self._channel("ref", first, stop) - points[len(arrivals)]
            arrived = np.flatnonzero(np.abs(offset).max(-1) < ROUNDING)
            if not arrived.size:
                break
            arrivals.append(first + int(arrived[0]))
        for i in range(1, len(points)):
            if i in self._reached:
                continue
            if self._is_timed and i > len(arrivals):
                return
            first = max(self._start, arrivals[i - 1] if self._is_timed else self._reached[i - 1])
            end = arrivals[i + 1] if i + 1 < len(arrivals) else stop
            offset = np.abs(self._channel("pose", first, end) - points[i])
            near = np.hypot(offset[:, 0], offset[:, 1]) < ARRIVAL_RADIUS_M
            near &= offset[:, 2] < ARRIVAL_ANGLE_RAD
            if near.any():
                self._reached[i] = first + int(near.argmax())
                yield self._reached[i], WAY_POINT, f"way-point {i} of {len(points) - 1} reached"
            elif not self._is_timed:
                return

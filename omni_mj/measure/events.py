"""What happened in a run: rows that were stopped, faults, hot windings, a dead battery, limits, misses, way-points.

An event depends on nothing that comes after its frame, so that events can be told while a run goes on.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

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
QUIET_FRAMES = FRAME_RATE_HZ // 4  # what was at a limit no longer ago than this has not left it
ROUNDING = 1e-9  # of a reference that arrives


_Happening = tuple[int, str, str]  # frame, kind, text


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
    found = list(_stopped(log, failures))
    for i in range(len(log.rows)):
        once, own = _Once(log.rows[i]), slice(log.lengths[i])
        told = once.new(log.channel("winding")[own, i], log.channel("battery")[own, i, 0], 0)
        found += [_event(log, i, *each) for each in (*told, *_faults(log.rows[i], 0, int(log.lengths[i])))]
        limited = log.channel("current_limited")[own, i] > 0
        if limited.any():
            frame, motor = np.argwhere(limited)[0]
            found.append(_event(log, i, int(frame), CURRENT, _driver_limits(log.rows[i], int(motor))))
    return _sorted(found)


def find_all(log: Log, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """Everything that happened to each controller's first row, in the order of time."""
    failures = list(failures)
    first = [log.first(controller) for controller in log.controllers]
    return _sorted(event for row in first for event in of_row(log, row, failures))


def of_row(log: Log, row: int, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """Everything that happened to a row, in the order of time: also limits, misses, way-points.

    A limit is met in the first frame at it, `QUIET_FRAMES` after the last.
    """
    return Watch(log, row).new(failures)


class Watch:
    """Tells what happens to a row while its log grows, looking at each frame once.

    Args:
        log: of a simulation that goes on.
        row: whose events are told.
    """

    def __init__(self, log: Log, row: int) -> None:
        self._log, self._row = log, row
        self._seen = 0
        self._stopped = False
        self._once = _Once(log.rows[row])
        self._quiet: dict[str, _Quiet] = {}
        self._command = np.zeros(3)
        self._lost_at: int | None = None
        self._way = _Way(log.rows[row])

    def new(self, failures: "Iterable[Failure]" = ()) -> list[Event]:
        """What happened since this was asked last, in the order of time."""
        log, row, start = self._log, self._row, self._seen
        self._seen = int(log.lengths[row])
        names = "pose", "ref", "command", "vision_valid", "duty_peak", "current_limited", "battery", "winding"
        track = {name: log.channel(name)[start : self._seen, row] for name in names}
        happened = [
            *self._once.new(track["winding"], track["battery"][:, 0], start),
            *_faults(log.rows[row], start, self._seen),
            *self._limits(track["command"], start),
            *self._full_voltage(track["duty_peak"][:, 0], track["battery"][:, 0], start),
            *self._held_back(track["current_limited"], start),
            *self._misses(track["vision_valid"][:, 0], start),
            *self._way.reached(track["pose"], track["ref"], start),
        ]
        stopped = [] if self._stopped else list(_stopped(log, (each for each in failures if each.row == row)))
        self._stopped |= bool(stopped)
        return _sorted([*stopped, *(_event(log, row, *each) for each in happened)])

    def _limits(self, command: Array, start: int) -> Iterator[_Happening]:
        """Where commands (frames, 3) were held back by a limit of speed or acceleration."""
        met = causes.at_limits(command, self._command, self._log.rows[self._row].settings.control)
        self._command = command[-1] if len(command) else self._command
        for unit, (limit, frames) in met.items():
            for frame in self._met(unit, frames, start):
                yield frame, LIMIT, f"the command is held back to {limit:g} {unit}"

    def _full_voltage(self, duty: Array, battery: Array, start: int) -> Iterator[_Happening]:
        for frame in self._met(VOLTAGE, (duty >= 1) & (battery > 0), start):
            yield frame, VOLTAGE, "a motor takes all the battery's voltage"

    def _held_back(self, limited: Array, start: int) -> Iterator[_Happening]:
        """Where drivers held back a motor's current, in shares (frames, motors) of each frame."""
        for motor, share in enumerate(limited.T):
            text = _driver_limits(self._log.rows[self._row], motor)
            for frame in self._met(text, share > 0, start):
                yield frame, CURRENT, text

    def _met(self, name: str, active: np.ndarray, start: int) -> list[int]:
        return self._quiet.setdefault(name, _Quiet()).met(active, start)

    def _misses(self, valid: np.ndarray, start: int) -> Iterator[_Happening]:
        """Where vision (frames,) lost sight of a robot, and where it saw one again that was away for several frames."""
        change = np.diff(valid.astype(int), prepend=int(self._lost_at is None))
        for frame in start + np.flatnonzero(change):
            if self._lost_at is None:
                self._lost_at = int(frame)
                yield self._lost_at, VISION, "vision does not see the robot"
            else:
                away, self._lost_at = int(frame) - self._lost_at, None
                if away > 1:
                    yield int(frame), VISION, f"vision sees the robot again after {away} frames"


def _stopped(log: Log, failures: "Iterable[Failure]") -> Iterator[Event]:
    for each in failures:
        yield _event(log, each.row, round(each.time_s / PERIOD_S), STOPPED, f"stopped: {each.cause}")


def _faults(row: Row, start: int, stop: int) -> Iterator[_Happening]:
    """What began and ended in the frames from `start` until before `stop`."""
    for fault in row.faults:
        for frame, does in zip(span(fault), ("begins", "ends"), strict=True):
            if start <= frame < stop:
                yield int(frame), FAULT, f"{does}: {fault.text}"


def _driver_limits(row: Row, motor: int) -> str:
    return f"the driver limits the current of motor {motor + 1} to {row.settings.firmware.current_limit_a:g} A"


def _event(log: Log, i: int, frame: int, kind: str, text: str) -> Event:
    row = log.rows[i]
    return Event(frame, frame * PERIOD_S, row.controller, row.seed, kind, text, row.place)


def _sorted(events: Iterable[Event]) -> list[Event]:
    return sorted(events, key=lambda event: event.frame)


class _Once:
    """Tells what is told once: windings that are too hot, a battery that gave up."""

    def __init__(self, row: Row) -> None:
        self._limit_c, self._cut_off_v = row.settings.motor.limit_c, row.settings.battery.cut_off_v
        self._told: set[str] = set()

    def new(self, winding: Array, battery: Array, start: int) -> Iterator[_Happening]:
        """What happened in the frames from `start` on: windings (frames, motors), deg C, and battery (frames,), V."""
        with np.errstate(invalid="ignore"):  # not a number where there are no motors
            too_hot = (winding > self._limit_c).any(-1)
        for kind, happened, text in (
            (TEMPERATURE, too_hot, f"a winding is above {self._limit_c:g} deg C"),
            (BATTERY, battery == 0, f"the battery sank below {self._cut_off_v:g} V and gives no more power"),
        ):
            if happened.any() and kind not in self._told:
                self._told.add(kind)
                yield start + int(happened.argmax()), kind, text


class _Quiet:
    """Tells when something becomes active that was not in the `QUIET_FRAMES` before."""

    def __init__(self) -> None:
        self._last = -QUIET_FRAMES - 1

    def met(self, active: np.ndarray, start: int) -> list[int]:
        """The frames in which it does, of those (frames,) from `start` on."""
        frames = start + np.flatnonzero(active)
        fresh = frames[np.diff(frames, prepend=self._last) > QUIET_FRAMES]
        self._last = int(frames[-1]) if frames.size else self._last
        return fresh.tolist()


class _Way:
    """Tells when a robot reaches a way-point, as close as the iterated reference asks for.

    A robot passes a way-point between the timed reference's arrivals at the one before and the one after; one that
    plans anew in every frame keeps no timetable and passes them one after the other.
    """

    def __init__(self, row: Row) -> None:
        settings = row.settings.reference
        self._timed = settings.mode == "timed"
        self._points = references.waypoints(settings, row.where)
        self._arrivals = [0]  # of the timed reference, at the way-points so far
        self._ahead = [*range(1, len(self._points))]  # way-points that are yet to be reached
        self._reached = 0  # frame in which the last was

    def reached(self, pose: Array, ref: Array, start: int) -> Iterator[_Happening]:
        """Way-points reached in the frames from `start` on, by the robot's poses (frames, 3) and the timed ones."""
        self._arrive(ref, start)
        end, last = start + len(pose), len(self._points) - 1
        for i in list(self._ahead):
            low, high = self._window(i)
            if low is None:
                break
            low, stop = max(low, start), end if high is None else min(high, end)
            near = self._is_near(pose[low - start : max(stop - start, 0)], self._points[i])
            if near.any():
                self._reached = low + int(near.argmax())
                self._ahead.remove(i)
                yield self._reached, WAY_POINT, f"way-point {i} of {last} reached"
            elif high is not None and high <= end:
                self._ahead.remove(i)  # too late
            elif not self._timed:
                break

    def _window(self, i: int) -> tuple[int | None, int | None]:
        """First frame in which a robot may reach the i-th way-point, and the first in which no more; None: not yet."""
        if not self._timed:
            return self._reached, None
        known = len(self._arrivals)
        return self._arrivals[i - 1] if i <= known else None, self._arrivals[i + 1] if i + 1 < known else None

    def _arrive(self, ref: Array, start: int) -> None:
        """Find the way-points at which the timed reference arrives in the frames from `start` on."""
        for point in self._points[len(self._arrivals) :]:
            since = max(self._arrivals[-1], start)
            there = np.flatnonzero(np.abs(ref[since - start :] - point).max(-1) < ROUNDING)
            if not there.size:
                return
            self._arrivals.append(since + int(there[0]))

    def _is_near(self, pose: Array, point: Array) -> np.ndarray:
        offset = np.abs(pose - point)
        return (np.hypot(offset[:, 0], offset[:, 1]) < ARRIVAL_RADIUS_M) & (offset[:, 2] < ARRIVAL_ANGLE_RAD)

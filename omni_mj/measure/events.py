"""What happened in a run: rows that were stopped, windings too hot, a battery that gave up, limits, misses, way-points.

An event depends on nothing that comes after its frame, so that events can be told while a run goes on.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference.curves import CURVES
from omni_mj.scenarios import references
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S, ControlSettings
from omni_mj.simulate.log import Log

if TYPE_CHECKING:
    from omni_mj.simulate.simulation import Failure

STOPPED, TEMPERATURE, BATTERY, LIMIT, VOLTAGE, VISION, WAY_POINT = KINDS = (
    "stopped", "temperature", "battery", "limit", "voltage", "vision", "way-point",
)  # fmt: skip
QUIET_FRAMES = FRAME_RATE_HZ // 4  # what was at a limit no longer ago than this has not left it
ROUNDING = 1e-9  # relative, of a command that was scaled to a limit, and of a reference that arrives


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
    """What a user must know, once per row, in the order of time: rows that were stopped, temperature, battery."""
    return _sorted(_must_know(log, range(len(log.rows)), failures))


def find_all(log: Log, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """Everything that happened to each controller's first row, in the order of time."""
    failures = list(failures)
    first = [log.first(controller) for controller in log.controllers]
    return _sorted(event for row in first for event in of_row(log, row, failures))


def of_row(log: Log, row: int, failures: "Iterable[Failure]" = ()) -> list[Event]:
    """Everything that happened to a row, in the order of time: also limits, misses, way-points.

    A limit is met in the first frame at it, `QUIET_FRAMES` after the last.
    """
    own = slice(log.lengths[row])
    track = {name: log.channel(name)[own, row] for name in ("pose", "ref", "command", "vision_valid")}
    duty, battery = (log.channel(name)[own, row, 0] for name in ("duty_peak", "battery"))
    happened = [
        *_limits(track["command"], log.rows[row].settings.control),
        *((f, VOLTAGE, "a motor takes all the battery's voltage") for f in _met((duty >= 1) & (battery > 0))),
        *_lost(track["vision_valid"][:, 0]),
        *_reached(track["pose"], track["ref"], log.rows[row]),
    ]
    told = [_event(log, row, frame, kind, text) for frame, kind, text in happened]
    return _sorted([*_must_know(log, [row], failures), *told])


class Watch:
    """Tells what happens to a row while its log grows.

    Args:
        log: of a simulation that goes on.
        row: whose events are told.
    """

    def __init__(self, log: Log, row: int) -> None:
        self._log, self._row = log, row
        self._told: set[Event] = set()

    def new(self, failures: "Iterable[Failure]" = ()) -> list[Event]:
        """What happened since this was asked last, in the order of time."""
        fresh = [event for event in of_row(self._log, self._row, failures) if event not in self._told]
        self._told.update(fresh)
        return fresh


def _must_know(log: Log, rows: Sequence[int], failures: "Iterable[Failure]") -> list[Event]:
    limit = np.array([log.rows[i].settings.motor.limit_c for i in rows])
    with np.errstate(invalid="ignore"):  # not a number where there are no motors, or no more frames
        too_hot = np.asarray((log.channel("winding")[:, rows] > limit[:, None]).any(-1))
    empty = np.asarray(log.channel("battery")[:, rows, 0] == 0)
    stopped = [f for f in failures if f.row in rows]
    found = [_event(log, f.row, round(f.time_s / PERIOD_S), STOPPED, f"stopped: {f.cause}") for f in stopped]
    for k in np.flatnonzero(too_hot.any(0)).tolist():
        text = f"a winding is above {limit[k]:g} deg C"
        found.append(_event(log, rows[k], int(too_hot[:, k].argmax()), TEMPERATURE, text))
    for k in np.flatnonzero(empty.any(0)).tolist():
        text = f"the battery sank below {log.rows[rows[k]].settings.battery.cut_off_v:g} V and gives no more power"
        found.append(_event(log, rows[k], int(empty[:, k].argmax()), BATTERY, text))
    return found


_Happening = tuple[int, str, str]  # frame, kind, text


def _event(log: Log, i: int, frame: int, kind: str, text: str) -> Event:
    row = log.rows[i]
    return Event(frame, frame * PERIOD_S, row.controller, row.seed, kind, text, row.place)


def _sorted(events: Iterable[Event]) -> list[Event]:
    return sorted(events, key=lambda event: event.frame)


def _met(active: np.ndarray) -> list[int]:
    """Frames in which something becomes active that was not in the `QUIET_FRAMES` before."""
    frames = np.flatnonzero(active)
    return [int(f) for f in frames[np.diff(frames, prepend=-QUIET_FRAMES - 1) > QUIET_FRAMES]]


def _limits(command: Array, s: ControlSettings) -> Iterator[_Happening]:
    """Where commands (frames, 3) were held back by a limit of speed or acceleration."""
    step = np.diff(command, axis=0, prepend=np.zeros((1, 3))) / PERIOD_S
    for size, limit, unit in (
        (np.hypot(*command[:, :2].T), s.max_speed_m_s, "m/s"),
        (np.hypot(*step[:, :2].T), s.max_acceleration_m_s2, "m/s^2"),
        (np.abs(command[:, 2]), s.max_turn_rate_rad_s, "rad/s"),
        (np.abs(step[:, 2]), s.max_turn_acceleration_rad_s2, "rad/s^2"),
    ):
        for frame in _met(size >= limit * (1 - ROUNDING)):
            yield frame, LIMIT, f"the command is held back to {limit:g} {unit}"


def _lost(valid: np.ndarray) -> Iterator[_Happening]:
    """Where vision (frames,) lost sight of a robot, and where it saw one again that was away for several frames."""
    change = np.diff(valid.astype(int), prepend=1)
    lost, seen = np.flatnonzero(change < 0), np.flatnonzero(change > 0)
    yield from ((int(f), VISION, "vision does not see the robot") for f in lost)
    for start, end in zip(lost, seen, strict=False):  # the last one may stay lost
        if end - start > 1:
            yield int(end), VISION, f"vision sees the robot again after {end - start} frames"


def _reached(pose: Array, ref: Array, row: Row) -> Iterator[_Happening]:
    """Where a robot reached a way-point, as close as the iterated reference asks for.

    A robot passes a way-point between the timed reference's arrivals at the one before and the one after; one that
    plans anew in every frame keeps no timetable and passes them one after the other.
    """
    settings = row.settings.reference
    if settings.shape in CURVES:
        return
    plan = references.iterated(settings, 1, row.where)
    arrivals, reached = [0], 0
    for point in plan.waypoints[1:]:
        there = np.flatnonzero(np.abs(ref[arrivals[-1] :] - point).max(-1) < ROUNDING)
        if not there.size:
            break
        arrivals.append(arrivals[-1] + int(there[0]))
    last = len(plan.waypoints) - 1
    for i, point in enumerate(plan.waypoints[1 : len(arrivals) + 1], 1):
        start, stop = arrivals[i - 1], arrivals[i + 1] if i + 1 < len(arrivals) else len(pose)
        if settings.mode == "iterated":
            start, stop = reached, len(pose)
        offset = np.abs(pose[start:stop] - point)
        near = (np.hypot(offset[:, 0], offset[:, 1]) < plan.arrival_radius) & (offset[:, 2] < plan.arrival_angle)
        if near.any():
            reached = start + int(near.argmax())
            yield reached, WAY_POINT, f"way-point {i} of {last} reached"

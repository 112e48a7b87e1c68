"""What happened in a run: windings too hot, a battery that gave up, limits met, frames lost, way-points reached.

An event depends on nothing that comes after its frame, so that events can be told while a run goes on.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_control.reference.curves import CURVES
from omni_mj.scenarios.references import iterated_reference
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S, ControlSettings, ReferenceSettings, Settings
from omni_mj.simulate.log import Trajectory

TEMPERATURE, BATTERY, LIMIT, VOLTAGE, VISION, WAY_POINT = KINDS = (
    "temperature", "battery", "limit", "voltage", "vision", "way-point",
)  # fmt: skip
QUIET_FRAMES = FRAME_RATE_HZ // 4  # what was at a limit no longer ago than this has not left it
ROUNDING = 1e-9  # relative, of a command that was scaled to a limit, and of a reference that arrives


@dataclass(frozen=True)
class Event:
    """Something that happened to one robot; `kind` is one of `KINDS`."""

    frame: int
    time_s: float
    controller: str
    seed: int
    kind: str
    text: str


def find(trajectory: Trajectory, settings: Settings) -> list[Event]:
    """What a user must know, once per robot of any seed, in the order of time: temperature and battery."""
    limit, cut_off = settings.motor.limit_c, settings.battery.cut_off_v
    too_hot = np.asarray((trajectory.channel("winding") > limit).any(-1))
    empty = np.asarray(trajectory.channel("battery")[..., 0] == 0)
    kinds = {
        TEMPERATURE: (too_hot, f"a winding is above {limit:g} deg C"),
        BATTERY: (empty, f"the battery sank below {cut_off:g} V and gives no more power"),
    }
    return _sorted(
        _event(trajectory, int(happened[:, i, j].argmax()), i, j, kind, text)
        for kind, (happened, text) in kinds.items()
        for i, j in np.argwhere(happened.any(0))
    )


def find_all(trajectory: Trajectory, settings: Settings) -> list[Event]:
    """Everything that happened to the first seed's robots, in the order of time: also limits, frames, way-points.

    A limit is met in the first frame at it, `QUIET_FRAMES` after the last.
    """
    found = [event for event in find(trajectory, settings) if event.seed == trajectory.seeds[0]]
    for i in range(len(trajectory.controllers)):
        track = {name: trajectory.channel(name)[:, i, 0] for name in ("pose", "ref", "command", "vision_valid")}
        duty, battery = (trajectory.channel(name)[:, i, 0, 0] for name in ("duty_peak", "battery"))
        happened = [
            *_limits(track["command"], settings.control),
            *((f, VOLTAGE, "a motor takes all the battery's voltage") for f in _met((duty >= 1) & (battery > 0))),
            *_lost(track["vision_valid"][:, 0]),
            *_reached(track["pose"], track["ref"], settings.reference),
        ]
        found += [_event(trajectory, frame, i, 0, kind, text) for frame, kind, text in happened]
    return _sorted(found)


_Happening = tuple[int, str, str]  # frame, kind, text


def _event(trajectory: Trajectory, frame: int, controller: int, seed: int, kind: str, text: str) -> Event:
    names = trajectory.controllers[controller], trajectory.seeds[seed]
    return Event(frame, frame * PERIOD_S, *names, kind, text)


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


def _reached(pose: Array, ref: Array, settings: ReferenceSettings) -> Iterator[_Happening]:
    """Where a robot reached a way-point, as close as the iterated reference asks for.

    A robot passes a way-point between the timed reference's arrivals at the one before and the one after; one that
    plans anew in every frame keeps no timetable and passes them one after the other.
    """
    if settings.shape in CURVES:
        return
    plan = iterated_reference(settings, 1)
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

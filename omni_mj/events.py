"""What happened in a run that a user must know of: windings too hot, a battery that gave up."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from omni_mj.settings import PERIOD_S, Settings
from omni_mj.trajectory import Trajectory


@dataclass(frozen=True)
class Event:
    """The first time something happened to one robot."""

    frame: int
    time_s: float
    controller: str
    seed: int
    text: str


def find(trajectory: Trajectory, settings: Settings) -> list[Event]:
    """All events of a run, in the order of time."""
    limit, cut_off = settings.motor.limit_c, settings.battery.cut_off_v
    too_hot = np.asarray((trajectory.channel("winding") > limit).any(-1))
    empty = np.asarray(trajectory.channel("battery")[..., 0] == 0)
    events = [
        *_first(trajectory, too_hot, f"a winding is above {limit:g} deg C"),
        *_first(trajectory, empty, f"the battery sank below {cut_off:g} V and gives no more power"),
    ]
    return sorted(events, key=lambda event: event.frame)


def _first(trajectory: Trajectory, happened: np.ndarray, text: str) -> Iterator[Event]:
    """An event per robot for the first frame in which something `happened`, (frames, controllers, seeds)."""
    for i, j in np.argwhere(happened.any(0)):
        frame = int(happened[:, i, j].argmax())
        yield Event(frame, frame * PERIOD_S, trajectory.controllers[i], trajectory.seeds[j], text)

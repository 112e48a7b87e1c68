"""Which robots a recording shows: of each controller those of its first world."""

from collections.abc import Sequence
from dataclasses import dataclass

from omni_control.kinematics import Array
from omni_mj.scenarios.rows import Row
from omni_mj.show import style
from omni_mj.show.recording import colours
from omni_mj.simulate.log import Log

PALER = 0.35  # share of white by which a controller's robot is paler than the one at the place before
PALEST = 0.7


@dataclass(frozen=True)
class Robot:
    """A robot that is shown.

    Args:
        row: its number in the log.
        order: its number among those shown.
        name: of its entities: its controller's, and where that drives several in a world, its place there.
        colour: its controller's, paler from place to place.
    """

    row: int
    order: int
    name: str
    colour: colours.Rgb


@dataclass(frozen=True)
class Track:
    """What was recorded of a row.

    Args:
        log: of the run.
        row: its number.
    """

    log: Log
    row: int

    @property
    def length(self) -> int:
        """How many frames it has."""
        return int(self.log.lengths[self.row])

    def __getitem__(self, channel: str) -> Array:
        """A channel's frames (frames, columns)."""
        return self.log.channel(channel)[: self.length, self.row]


def shown(rows: Sequence[Row]) -> list[Robot]:
    """The robots to show of a table of rows, those of one controller after those of the one before."""
    robots: list[Robot] = []
    controllers = list(dict.fromkeys(row.controller for row in rows))
    for slot, controller in zip(style.slots(controllers), controllers, strict=True):
        own = [number for number, row in enumerate(rows) if row.controller == controller]
        together = [number for number in own if rows[number].world == rows[own[0]].world]
        for k, number in enumerate(together):
            name = controller if len(together) == 1 else f"{controller}/{rows[number].place}"
            colour = colours.pale(colours.of(slot), min(k * PALER, PALEST)) if k else colours.of(slot)
            robots.append(Robot(number, len(robots), name, colour))
    return robots

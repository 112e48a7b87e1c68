"""What the figures over time are drawn from: the first row of each controller, as far as it was recorded."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.errors import errors
from omni_mj.show import style
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Failure

TURNED_RAD = 1e-3  # a heading that strays less, from one that stays, has not turned


@dataclass(frozen=True)
class FirstRows:
    """The first row of each controller; arrays hold not a number where a row had come to its end.

    Args:
        log: of the run.
        failures: the rows that were stopped before their end.
    """

    log: Log
    failures: Sequence[Failure] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The controllers' labels."""
        return self.log.controllers

    @property
    def slots(self) -> list[int]:
        """Their slots in `style`."""
        return style.slots(self.names)

    @property
    def rows(self) -> list[int]:
        """Their rows in the log."""
        return [self.log.first(name) for name in self.names]

    @property
    def length(self) -> int:
        """Frames of the row that was recorded longest."""
        return int(self.log.lengths[self.rows].max())

    def channel(self, name: str) -> Array:
        """A channel of the log, (frames, controllers, columns)."""
        return self.log.channel(name)[: self.length, self.rows]

    @property
    def reference(self) -> Array:
        """Poses (frames, 3) of the timed reference of the row that was recorded longest."""
        longest = int(self.log.lengths[self.rows].argmax())
        return self.channel("ref")[:, longest]

    def errors(self, axis: str) -> Array:
        """Absolute errors along one of `errors.AXES`, (frames, controllers), m or rad."""
        return errors(self.log)[axis][: self.length, self.rows]

    @property
    def turns(self) -> bool:
        """Whether the reference turns, or a robot against it."""
        greatest = np.nanmax(self.errors("heading"), initial=0.0)
        return bool(np.ptp(self.reference[:, 2]) > TURNED_RAD or greatest > TURNED_RAD)

    @property
    def failed(self) -> dict[int, Failure]:
        """Which of the controllers' rows were stopped before their end: index of the controller -> failure."""
        by_row = {failure.row: failure for failure in self.failures}
        return {i: by_row[row] for i, row in enumerate(self.rows) if row in by_row}

    def said(self) -> list[str]:
        """A line for each failure."""
        return [f"{each.controller} failed at {each.time_s:.2f} s: {each.cause}" for each in self.failed.values()]

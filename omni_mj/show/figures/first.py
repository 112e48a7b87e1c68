"""Data of the figures over time: the first row of each controller, as far as it was recorded."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.metrics import errors
from omni_mj.show import style
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Failure

TURNED_RAD = 1e-3  # change of heading from which on a robot turns


@dataclass(frozen=True)
class FirstRows:
    """The first row of each controller; arrays hold NaN after the end of a row.

    Args:
        log: Log of the run.
        failures: Rows that were stopped before their end.
    """

    log: Log
    failures: Sequence[Failure] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Labels of the controllers."""
        return self.log.controllers

    @property
    def slots(self) -> list[int]:
        """Slots of the controllers in `style`."""
        return list(style.slots(self.names).values())

    @property
    def rows(self) -> list[int]:
        """Rows of the controllers in the log."""
        return [self.log.first(name) for name in self.names]

    @property
    def lengths(self) -> np.ndarray:
        """Number of frames of each row, (controllers,)."""
        return np.asarray(self.log.lengths)[self.rows]

    @property
    def reference(self) -> Array:
        """Poses (frames, 3) of the reference of the longest row."""
        return self.channel("ref")[:, self.lengths.argmax()]

    @property
    def failed(self) -> dict[int, Failure]:
        """Failures by the index of their controller."""
        by_row = {failure.row: failure for failure in self.failures}
        return {i: by_row[row] for i, row in enumerate(self.rows) if row in by_row}

    def channel(self, name: str) -> Array:
        """Return a channel of the log, (frames, controllers, columns)."""
        return self.log.channel(name)[: self.lengths.max(), self.rows]

    def errors(self, axis: str) -> Array:
        """Return absolute errors along one of `errors.AXES`, (frames, controllers), m or rad."""
        return errors(self.log)[axis][: self.lengths.max(), self.rows]

    def turns(self) -> bool:
        """Return whether the reference turns, or a robot turns away from it."""
        largest = np.nanmax(self.errors("heading"), initial=0.0)
        return bool(max(np.ptp(self.reference[:, 2]), largest) > TURNED_RAD)

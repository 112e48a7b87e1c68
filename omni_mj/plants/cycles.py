"""Cycles of the wheel loops: physics steps of a world's or many worlds' robots, and what happens between these."""

from collections.abc import Sequence

import numpy as np
from mujoco.batch import Batch

from omni_mj.plants.alone import Alone
from omni_mj.plants.at_once import AtOnce
from omni_mj.plants.between import Between, Burst


class Cycles:
    """Goes through them.

    Args:
        plants: what happens to them between physics steps, to one group after the other.
        substeps: physics steps in a cycle.
    """

    def __init__(self, plants: Sequence[AtOnce | Between], substeps: int) -> None:
        self._plants, self._substeps = plants, substeps
        groups = [each for each in plants if isinstance(each, Between)]
        self._burst = Burst(groups, substeps) if groups else None

    def go(self, batch: Batch | Alone, first: int, count: int, living: np.ndarray | None = None) -> None:
        """Go through some cycles of a frame.

        Args:
            batch: of all the robots.
            first: number of the first cycle in its frame.
            count: of the cycles.
            living: worlds that are stepped; None for all.
        """
        if self._burst is not None and isinstance(batch, Alone):
            self._burst.go(batch, first, count, living is None or len(living) > 0)
            return
        plants, substeps = self._plants, self._substeps
        for k in range(first, first + count):
            for each in plants:
                each.before(k)
            for substep in range(substeps):
                batch.step(living)
                for each in plants:
                    each.after(k, substep == 0, substep == substeps - 1)

"""Cycles of the wheel loops: physics steps of a world's or many worlds' robots, and what happens between these."""

from collections.abc import Sequence

import numpy as np
from mujoco.batch import Batch

from omni_mj.plants.alone import Alone
from omni_mj.plants.at_once import AtOnce
from omni_mj.plants.between import Between


def go(
    batch: Batch | Alone,
    plants: Sequence[AtOnce | Between],
    first: int,
    count: int,
    substeps: int,
    living: np.ndarray | None,
) -> None:
    """Go through some cycles of a frame.

    Args:
        batch: of all the robots.
        plants: what happens to them between physics steps, to one group after the other.
        first: number of the first cycle in its frame.
        count: of the cycles.
        substeps: physics steps in a cycle.
        living: worlds that are stepped; None for all.
    """
    groups = [each for each in plants if isinstance(each, Between)]
    if isinstance(batch, Alone) and groups:
        groups[0].burst(batch, groups[1:], first, count, substeps, living is None or len(living) > 0)
        return
    for k in range(first, first + count):
        for each in plants:
            each.before(k)
        for substep in range(substeps):
            batch.step(living)
            for each in plants:
                each.after(k, substep == 0, substep == substeps - 1)

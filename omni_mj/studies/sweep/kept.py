"""Trajectories of some robots of a sweep: the worst, the median, a sample; run again, since a run is what it was."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from omni_control.errors import OmniError
from omni_mj.studies.run import run
from omni_mj.studies.sweep.cells import STRAYED
from omni_mj.studies.sweep.grid import at

if TYPE_CHECKING:
    from omni_mj.studies.sweep.study import Sweep

FOLDER = "kept"
KINDS = ("worst", "median", "sample")
MOST = 1000  # of each kind and controller


@dataclass(frozen=True)
class Wish:
    """Which robots of each controller are to be kept.

    Args:
        kind: of `KINDS`.
        count: how many.
    """

    kind: str
    count: int


def wish(text: str) -> Wish:
    """What the command line says: `worst:3`, `median`, `sample:10`.

    Raises:
        OmniError: it cannot be read.
    """
    found = re.fullmatch(rf"({'|'.join(KINDS)})(?::([0-9]+))?", text.strip())
    count = int(found[2] or 1) if found else 0
    if not found or not 1 <= count <= MOST:
        raise OmniError(f"cannot read --keep {text}; write {', '.join(f'{kind}:N' for kind in KINDS)}, N up to {MOST}")
    return Wish(found[1], count)


def chosen(found: "Sweep", wishes: Iterable[Wish]) -> dict[str, tuple[int, str, int]]:
    """The runs in which these robots are, name -> point, controller and seed.

    Worst are those that failed, the earliest first, then those that strayed farthest; the median is the middle one in
    this order, and others around it; a sample is evenly spread over the rows as they stand.

    Args:
        found: a sweep.
        wishes: which, of each controller.
    """
    table = found.rows()
    names = ("point", "controller", "seed", "failed_at_s", STRAYED)
    point, controller, seed, failed, strayed = (table[name].to_numpy(zero_copy_only=False) for name in names)
    kept: dict[str, tuple[int, str, int]] = {}
    for name in dict.fromkeys(controller.tolist()):
        own = np.flatnonzero(controller == name)
        ranked = own[np.lexsort((np.nan_to_num(failed[own], nan=np.inf), -strayed[own]))]
        for each in wishes:
            count = min(each.count, len(own))
            first = (len(own) - count) // 2
            rows = {
                "worst": ranked[:count],
                "median": ranked[first : first + count],
                "sample": own[np.linspace(0, len(own) - 1, count).round().astype(int)],
            }[each.kind]
            for number, row in enumerate(rows.tolist(), 1):
                kept[f"{name}-{each.kind}-{number}"] = int(point[row]), name, int(seed[row])
    return kept


def keep(found: "Sweep", wishes: Iterable[Wish]) -> list[str]:
    """Run these robots again, each into a folder of its own below `kept` as `omni-mj run` leaves one.

    Returns:
        The folders' names.
    """
    plan = found.plan
    kinds = dict(zip(plan.scenario.labels, plan.scenario.controllers, strict=True))
    runs = chosen(found, wishes)
    for name, (point, controller, seed) in runs.items():
        there = at(plan.scenario, plan.points[point])
        run(there, [kinds[controller]], [seed]).save(found.folder / FOLDER / name)
    return list(runs)

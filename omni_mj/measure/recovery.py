"""How robots come back from faults: how far they strayed from the reference, and how long that took.

A fault is looked at from its first frame until 2 s after its last, or the end of the run. Time counts from its first
frame, not from its end: some last until the end of the run, and a controller may well cope with one that goes on.
Whatever else happens in that time counts too.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.statistics import spread
from omni_mj.measure.table import Table, number
from omni_mj.scenarios.faults import span
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.simulate.log import Log

AFTER_S, NEAR_M = 2.0, 0.02
EXCURSION, RECOVERY = "excursion_m", "recovery_s"
DEFINITIONS = {
    EXCURSION: (
        f"the greatest error in the plane of a seed from the first frame of a fault until {AFTER_S:g} s after its last,"
        " or the end of the run"
    ),
    RECOVERY: (
        f"time from the first frame of a fault until the error in the plane is below {100 * NEAR_M:g} cm and stays so"
        " for the rest of that; zero for a robot that never was farther, without bound for one that does not come back"
    ),
}


def measured(rows: Sequence[Row], distance: Array, failed: Sequence[int]) -> dict[str, Array]:
    """Return each row's `fault_1_excursion_m`, `fault_1_recovery_s` and so on, name -> (n,); nothing without faults.

    NaN of a fault that a row does not have or did not come to; of a row that failed the excursion is infinite, as its
    errors are, and so is the time of one that does not recover.

    Args:
        rows: One per robot; their faults are numbered as in their settings.
        distance: Errors in the plane, (frames, n) m; NaN where a row has no frame.
        failed: Numbers of the rows that failed.
    """
    count = max((len(row.settings.fault) for row in rows), default=0)
    names = [_name(i, what) for i in range(count) for what in (EXCURSION, RECOVERY)]
    found = {name: np.full(len(rows), np.nan) for name in names}
    for place, row in enumerate(rows):
        for i, fault in enumerate(row.settings.fault):
            if not fault.concerns(row.place):
                continue
            first, end = span(fault)
            excursion, recovered = np.inf, np.inf
            if place not in failed:
                stop = min(end + AFTER_S * FRAME_RATE_HZ, len(distance))
                error = distance[int(min(first, stop)) : int(stop), place]
                error = error[~np.isnan(error)]
                if not error.size:
                    continue
                far = np.flatnonzero(error >= NEAR_M)
                excursion = error.max()
                if not far.size or far[-1] + 1 < error.size:
                    recovered = (far[-1] + 1) * PERIOD_S if far.size else 0.0
            found[_name(i, EXCURSION)][place], found[_name(i, RECOVERY)][place] = excursion, recovered
    return found


def results(log: Log, controller: str, measured: Mapping[str, Array]) -> list[dict[str, Any]]:
    """What a summary says of a controller: for each fault of its first row the spreads over its rows that have it.

    Args:
        log: what was recorded.
        controller: whose rows.
        measured: what `metrics.row_metrics` says of the log.
    """
    rows = log.of(controller)
    told = []
    for i, fault in enumerate(log.rows[rows[0]].settings.fault):
        with_it = [row for row in rows if log.rows[row].settings.fault[i : i + 1] == (fault,)]
        same = [row for row in with_it if fault.concerns(log.rows[row].place)]
        numbers = {what: spread(measured[_name(i, what)][same]) for what in (EXCURSION, RECOVERY)}
        told.append({"fault": fault.told, "kind": fault.kind, "at_s": fault.at, "for_s": fault.for_ or None, **numbers})
    return told


def table(summary: Mapping[str, Any]) -> Table | None:
    """Return how controllers came back from each fault of a summary's scenarios; None if there were none.

    Numbers are those of the one seed, or the medians.
    """
    rows = []
    for entry in summary["scenarios"].values():
        recoveries = [result["recovery"] for result in entry["results"].values()]
        for number_of_fault in range(max(map(len, recoveries), default=0)):
            name = ""
            for controller, faults in zip(entry["results"], recoveries, strict=True):
                for fault in faults[number_of_fault : number_of_fault + 1]:
                    time, worst = fault[RECOVERY]["median"], number(fault[EXCURSION]["median"], 100)
                    shown = "" if fault["fault"] == name else fault["fault"]
                    rows.append([shown, controller, worst, "never" if time is None else number(time)])
                    name = fault["fault"]
    if not rows:
        return None
    over = "" if len(summary["seeds"]) == 1 else f", median of {len(summary['seeds'])} seeds"
    title = f"recovery{over}: worst excursion until {AFTER_S:g} s after a fault, time from its start until below "
    headings = ["fault", "controller", "worst, cm", "recovered, s"]
    return Table(f"{title}{100 * NEAR_M:g} cm for good", headings, rows, 2)


def _name(i: int, what: str) -> str:
    return f"fault_{i + 1}_{what}"

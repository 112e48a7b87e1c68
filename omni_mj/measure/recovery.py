"""How robots come back from faults: how far they strayed from the reference, and how long that took.

A fault is looked at from its first frame until 2 s after its last, or the end of the run. Time counts from its first
frame, not from its end: some last until the end of the run, and a controller may well cope with one that goes on.
Whatever else happens in that time counts too.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.metrics import errors
from omni_mj.measure.statistics import Spread, spread
from omni_mj.measure.table import Table, number
from omni_mj.scenarios.faults import span
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.simulate.log import Log

if TYPE_CHECKING:
    from omni_mj.simulate.simulation import Failure

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


def row_metrics(log: Log, failures: "Iterable[Failure]" = ()) -> dict[str, Array]:
    """Each row's `fault_1_excursion_m`, `fault_1_recovery_s` and so on, name -> (n,); nothing without faults.

    Faults are numbered as in the row's settings. Not a number of a fault that a row does not have or did not come to;
    of a row that failed the excursion is infinite, as its errors are, and so is the time of one that does not recover.
    """
    failed = {failure.row for failure in failures}
    count = max((len(row.settings.fault) for row in log.rows), default=0)
    found = {_name(i, what): np.full(len(log.rows), np.nan) for i in range(count) for what in (EXCURSION, RECOVERY)}
    distance = errors(log)["distance"] if count else np.zeros((0, 0))
    for row, own in enumerate(log.rows):
        for i, fault in enumerate(own.settings.fault):
            if not fault.concerns(own.place):
                continue
            start, end = span(fault)
            last = min(end + AFTER_S * FRAME_RATE_HZ, float(log.lengths[row]))
            error = distance[start : int(last), row]
            if row in failed:
                found[_name(i, EXCURSION)][row] = found[_name(i, RECOVERY)][row] = np.inf
            elif error.size:
                found[_name(i, EXCURSION)][row], found[_name(i, RECOVERY)][row] = error.max(), _recovery(error)
    return found


def results(log: Log, controller: str, measured: Mapping[str, Array]) -> list[dict[str, Any]]:
    """What a summary says of a controller: for each fault of its first row the spreads over its rows that have it.

    Args:
        log: what was recorded.
        controller: whose rows.
        measured: what `row_metrics` says of the log.
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
    """How controllers came back from each fault of a summary's scenarios; None where there were none.

    Numbers are those of the one seed, or the medians.
    """
    rows = list(_lines(summary))
    if not rows:
        return None
    over = "" if len(summary["seeds"]) == 1 else f", median of {len(summary['seeds'])} seeds"
    title = f"recovery{over}: worst excursion until {AFTER_S:g} s after a fault, time from its start until below "
    headings = ["fault", "controller", "worst, cm", "recovered, s"]
    return Table(f"{title}{100 * NEAR_M:g} cm for good", headings, rows, 2)


def matrix(summary: Mapping[str, Any]) -> Table | None:
    """The same of a comparison: a line for each fault of each scenario, a column for each controller.

    A cell has the worst excursion in cm and the time in s, medians over the seeds.
    """
    controllers, rows = list(summary["controllers"]), list[list[str]]()
    for scenario, entry in summary["scenarios"].items():
        found = entry["results"]
        for i, fault in enumerate(next(iter(found.values()))["recovery"] if found else ()):
            told = [found[name]["recovery"][i] if name in found else None for name in controllers]
            rows.append([scenario, f"{fault['kind']}, {fault['at_s']:g} s", *map(_cell, told)])
    if not rows:
        return None
    title = f"Recovery from faults: worst excursion, cm / time until below {100 * NEAR_M:g} cm for good, s; medians"
    return Table(title, ["scenario", "fault", *controllers], rows, 2)


def _cell(told: Mapping[str, Any] | None) -> str:
    if told is None:
        return ""
    return f"{number(told[EXCURSION]['median'], 100)}/{_recovered(told[RECOVERY])}"


def _lines(summary: Mapping[str, Any]) -> Iterator[list[str]]:
    for entry in summary["scenarios"].values():
        told = [
            (i, controller, fault)
            for controller, result in entry["results"].items()
            for i, fault in enumerate(result["recovery"])
        ]
        last = ""
        for _, controller, fault in sorted(told, key=lambda each: each[0]):
            name, last = fault["fault"] if fault["fault"] != last else "", fault["fault"]
            yield [name, controller, number(fault[EXCURSION]["median"], 100), _recovered(fault[RECOVERY])]


def _recovery(error: Array) -> float:
    """From errors (frames,) in m: s until they are small for good; infinite if the last is not."""
    far = np.flatnonzero(error >= NEAR_M)
    frames = int(far[-1]) + 1 if far.size else 0
    return frames * PERIOD_S if frames < len(error) else math.inf


def _name(i: int, what: str) -> str:
    return f"fault_{i + 1}_{what}"


def _recovered(spread: Spread) -> str:
    return "never" if spread["median"] is None else number(spread["median"])

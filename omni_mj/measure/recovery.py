"""How robots come back from faults: how far they strayed from the reference, and how long that took.

A fault is looked at from its first frame until 2 s after its last, or the end of the run. Time counts from its first
frame, not from its end: some last until the end of the run, and a controller may well cope with one that goes on.
Whatever else happens in that time counts too.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure.statistics import Spread, spread
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


class Recoveries:
    """How rows come back from their faults, of errors that come in blocks of frames.

    Args:
        rows: one per robot; their faults are numbered as in their settings.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        shape = max((len(row.settings.fault) for row in rows), default=0), len(rows)
        self._first, self._stop = np.full(shape, np.inf), np.full(shape, np.inf)  # frames; none is for a row without
        for own, row in enumerate(rows):
            for i, fault in enumerate(row.settings.fault):
                if fault.concerns(row.place):
                    start, end = span(fault)
                    self._first[i, own], self._stop[i, own] = start, end + AFTER_S * FRAME_RATE_HZ
        self._excursion = np.full(shape, np.nan)
        self._near, self._end = np.zeros(shape), np.zeros(shape)  # frames after the last that is not near, and the last

    def add(self, distance: Array, first: int) -> None:
        """Go on with errors in the plane (frames, n) from the frame `first` on, m; not a number where there is none."""
        frame = first + np.arange(len(distance))[:, None]
        for i in range(len(self._first)):
            error = np.where((frame >= self._first[i]) & (frame < self._stop[i]), distance, np.nan)
            self._excursion[i] = np.fmax(self._excursion[i], np.fmax.reduce(error, axis=0))
            for after, met in ((self._near, error >= NEAR_M), (self._end, ~np.isnan(error))):
                after[i] = np.maximum(after[i], np.where(met, frame + 1, 0).max(0))

    def value(self, failed: Sequence[int]) -> dict[str, Array]:
        """Each row's `fault_1_excursion_m`, `fault_1_recovery_s` and so on, name -> (n,); nothing without faults.

        Not a number of a fault that a row does not have or did not come to; of a row that failed the excursion is
        infinite, as its errors are, and so is the time of one that does not recover.

        Args:
            failed: numbers of the rows that failed.
        """
        found: dict[str, Array] = {}
        for i, first in enumerate(self._first):
            excursion, recovered = self._excursion[i].copy(), np.full(len(first), np.nan)
            met = ~np.isnan(excursion)
            times = np.maximum(self._near[i] - first, 0)[met] * PERIOD_S
            recovered[met] = np.where((self._near[i] < self._end[i])[met], times, np.inf)
            lost = [row for row in failed if np.isfinite(first[row])]
            excursion[lost] = recovered[lost] = np.inf
            found |= {_name(i, EXCURSION): excursion, _name(i, RECOVERY): recovered}
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


def _name(i: int, what: str) -> str:
    return f"fault_{i + 1}_{what}"


def _recovered(spread: Spread) -> str:
    return "never" if spread["median"] is None else number(spread["median"])

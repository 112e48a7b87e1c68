"""The summary of a study: what was run and what came out, every figure recomputable from the trajectories."""

import platform
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import PERIOD_S
from omni_mj.files import read_json
from omni_mj.results import events, metrics, paper_tables, saturation, statistics
from omni_mj.results.metrics import AXES, EXCURSION, RECOVERY, STATISTICS, UNITS
from omni_mj.results.statistics import SeedStatistics, finite_or_none, seed_statistics
from omni_mj.simulation.log import Log

if TYPE_CHECKING:
    from omni_mj.simulation.simulation import Failure

FORMAT = 5  # of summary.json
UNFINISHED = "unfinished (it goes on, or was killed)"  # in place of why a study was stopped
Entry = dict[str, Any]  # what a summary says of one scenario
SINGLE = ("effort_m_s2", "excess_effort_m_s2", "settle_s")  # a number of each row beside its errors

DEFINITIONS = {
    "error": (
        "absolute difference between the true pose (x_m, y_m, heading_rad) and the timed reference (ref_x_m, ref_y_m,"
        " ref_heading_rad), which is the same for all controllers: in x, in y, as distance in the plane, along and"
        " across the path, and of the heading (to the nearest turn); maximum, 99th percentile (p99), mean and root mean"
        " square over all frames of a seed"
    ),
    "along, across": (
        "the part of the error in the plane that lies in the direction in which the reference travels, from"
        " (ref_x_m, ref_y_m)[k-1] to [k+1], and the part to the left of it; where the reference rests, its last"
        " direction; before its first move, that of the first; where it never moves, x"
    ),
    "spread": (
        "each seed's value, and over the seeds median, least, greatest and mean; ci95_half_width is half the"
        f" {100 * statistics.CONFIDENCE:g} % confidence interval of the mean by Student's t, which one seed"
        " does not have"
    ),
    "failed": (
        "rows that were stopped before their end: their errors, efforts and times to settle count as infinite, written"
        " as null, so that a median can stand them and a mean cannot; everything else of them is left out"
    ),
    "effort_m_s2": (
        "root mean square over the frames of the change of the sent translational command per second; what following"
        " the reference without any error needs is part of it"
    ),
    "excess_effort_m_s2": (
        "what effort_m_s2 is above the same of the reference's own velocities, (ref[k+1] - ref[k]) / T: the root of the"
        " difference of their squares, 0 for one that asks for less. It compares no frames, so that commands count the"
        " same however early they are sent"
    ),
    "settle_s": (
        "time from the end of the reference's last move until the error in the plane stays below"
        f" {100 * metrics.SETTLED_M:g} cm to the end of the run; infinite, written as null, for a seed that never"
        " settles, so that a mean over the seeds is that of all or none; settled: how many do"
    ),
    "alpha": (
        f"(x_m[k+n] - x_m[k]) / (T sum of applied_vx_m_s[k:k+n]) with n = {metrics.ALPHA_WINDOW_FRAMES}, T = 1/60 s;"
        " percentiles over all seeds and those k where the magnitude of applied_vx_m_s[k:k+n]'s mean is above"
        f" {metrics.ALPHA_MIN_SPEED_M_S} m/s"
    ),
    "peak": (
        "over all seeds the largest of peak_voltage_v and peak_current_a, which cover every physics step and motor, and"
        " of the temperatures of the windings"
    ),
    "drawn_parameters": (
        "what [randomization] drew for the robot of a seed at a place, numbered by wheels: factors of friction, torque"
        " constant and of the mass that the wheels carry, what wheels have lost of their radius, the shift of the"
        " middle of that mass"
    ),
    "events": "the first frame of each kind, controller and seed; of faults each beginning and end",
    EXCURSION: (
        "the greatest error in the plane of a seed from the first frame of a fault until"
        f" {metrics.RECOVERY_WINDOW_S:g} s after its last, or the end of the run"
    ),
    RECOVERY: (
        "time from the first frame of a fault until the error in the plane is below"
        f" {100 * metrics.RECOVERED_M:g} cm and stays so for the rest of that; zero for a robot that never was farther,"
        " without bound for one that does not come back"
    ),
    **saturation.DEFINITIONS,
    **statistics.DEFINITIONS,
}


def empty_entry(scenario: Scenario) -> Entry:
    """The entry of a scenario that was not run, or not yet."""
    return {
        "description": scenario.description, "plant": scenario.plant, "robot": scenario.robot,
        "status": "not run", "reason": None, "seeds": [], "frames": 0, "simulated_s": 0.0, "wall_s": 0.0,
        "settings": scenario.settings_to_dict(), "paper_table": scenario.paper_table, "paper": paper_tables.find_paper_table(scenario),
        "drawn_parameters": [], "events": [], "failures": [], "results": {}, "verdict": None,
    }  # fmt: skip


def scenario_entry(
    scenario: Scenario,
    log: Log,
    failures: "Iterable[Failure]",
    measured: Mapping[str, Array],
    wall_s: float,
    stopped: str | None,
    drawn: Mapping[str, Array] | None = None,
) -> Entry:
    """The entry of a scenario that was run, without its verdict, which depends on what else was.

    Args:
        scenario: what was run.
        log: what was recorded.
        failures: the rows that were stopped.
        measured: what `metrics` says of its rows; empty where errors mean nothing.
        wall_s: how long it took, s.
        stopped: why it ended before its time, or None.
        drawn: what sets the rows' robots apart, name -> (n,).
    """
    failures, frames = list(failures), int(log.lengths.max(initial=0))
    found = controller_results(log, failures, measured) if measured and (frames or failures) else {}
    return empty_entry(scenario) | {
        "status": "stopped" if stopped else "done",
        "reason": stopped,
        "seeds": log.seeds,
        "frames": frames,
        "simulated_s": frames * PERIOD_S,
        "wall_s": round(wall_s, 3),
        "drawn_parameters": _drawn_parameters(log, drawn) if drawn else [],
        "events": [asdict(event) for event in events.find_events(log, failures)],
        "failures": [
            {
                "controller": f.controller, "seed": f.seed, "slot": log.rows[f.row].slot,
                "time_s": f.time_s, "cause": f.cause,
            }
            for f in failures
        ],
        "results": found,
    }  # fmt: skip


def controller_results(
    log: Log, failures: "Iterable[Failure]", measured: Mapping[str, Array]
) -> dict[str, Any]:
    """Per controller its errors, efforts, time to settle, recovery, causes, alpha and peaks over its rows."""
    failed = {failure.row for failure in failures}
    found: dict[str, Any] = {}
    for controller in log.controllers:
        rows = log.rows_of(controller)
        error = {
            axis: {
                statistic: seed_statistics(measured[f"{axis}_{statistic}_{UNITS[axis]}"][rows])
                for statistic in STATISTICS
            }
            for axis in AXES
        }
        found[controller] = {
            "error_m": {axis: error[axis] for axis in AXES if UNITS[axis] == "m"},
            "error_rad": {axis: error[axis] for axis in AXES if UNITS[axis] == "rad"},
            **{name: seed_statistics(measured[name][rows]) for name in SINGLE},
            "recovery": _recovery(log, rows, measured),
            "saturation": {
                name: _known_spread(measured[name][rows]) for name in saturation.METRIC_LABELS
            },
            "alpha": metrics.alpha_percentiles(log, rows),
            **{name: _peak(measured[name][rows]) for name in metrics.PEAKS},
            "n_failed": len(failed.intersection(rows.tolist())),
            "n_settled": int(np.isfinite(measured["settle_s"][rows]).sum()),
        }
    return found


def build_summary(entries: Mapping[str, Entry], head: Mapping[str, Any]) -> dict[str, Any]:
    """Return the whole summary, with verdicts, of scenarios that were run with the same controllers.

    Args:
        entries: Of the scenarios, by their names.
        head: All that is said of the study as a whole, by the keys of summary.json.
    """
    judged = statistics.judge_subject(entries, head["privileged"], head["subject"])
    scenarios = {name: {**entry, "verdict": judged[name]} for name, entry in entries.items()}
    return {
        "format": FORMAT,
        **head,
        "scenarios": scenarios,
        "definitions": DEFINITIONS,
        "versions": package_versions(),
    }


def read_summary(folder: Path) -> dict[str, Any]:
    """Return the summary in the folder of a run or comparison.

    Raises:
        OmniError: There is none, or one that cannot be read.
    """
    path = folder / "summary.json"
    if not path.exists():
        raise OmniError(
            f"{folder} holds no run: it has no {path.name}; give the folder of a run. omni-mj serve leaves none:"
            " without a reference there are no errors to report"
        )
    summary = read_json(path)
    if summary.get("format") != FORMAT or not summary.get("scenarios"):
        raise OmniError(
            f"{path} is not a run's summary of format {FORMAT}, which this version reads"
        )
    return summary


@cache
def package_versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that decide the result, as far as they are installed."""
    found = {"python": platform.python_version()}
    for name in (
        "omni-mj",
        "mujoco",
        "numpy",
        "scipy",
        "rerun-sdk",
        "pyarrow",
        "piqp",
        "jax",
    ):  # the last two: extras
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def flatten(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the names `section.field` of nested settings, and their values."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _drawn_parameters(log: Log, drawn: Mapping[str, Array]) -> list[dict[str, Any]]:
    """What was drawn for each seed and place, which is the same for all controllers."""
    first = {(row.seed, row.slot): i for i, row in reversed(list(enumerate(log.rows)))}
    return [
        {
            "seed": seed,
            "slot": place,
            **{name: finite_or_none(values[i]) for name, values in drawn.items()},
        }
        for (seed, place), i in sorted(first.items())
    ]


def _recovery(log: Log, rows: np.ndarray, measured: Mapping[str, Array]) -> list[dict[str, Any]]:
    """What a summary says of a controller: for each fault of its first row the spreads over its rows that have it."""
    found = []
    for i, fault in enumerate(log.rows[rows[0]].settings.fault):
        same = [
            row for row in rows
            if log.rows[row].settings.fault[i : i + 1] == (fault,) and fault.affects(log.rows[row].slot)
        ]  # fmt: skip
        numbers = {
            key: seed_statistics(measured[f"fault_{i + 1}_{key}"][same])
            for key in (EXCURSION, RECOVERY)
        }
        found.append(
            {
                "fault": fault.description,
                "kind": fault.kind,
                "at_s": fault.start_s,
                "for_s": fault.duration_s or None,
                **numbers,
            }
        )
    return found


def _known_spread(values: Array) -> SeedStatistics:
    """Return the spread over the seeds that did not fail, with None as the value of those that did."""
    known = values[~np.isnan(values)]
    return seed_statistics(known if known.size else np.array([np.nan])) | {
        "per_seed": [finite_or_none(value) for value in values]
    }


def _peak(values: Array) -> float | None:
    known = values[~np.isnan(values)]
    return finite_or_none(known.max()) if known.size else None

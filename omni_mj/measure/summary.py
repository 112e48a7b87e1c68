"""The summary of a study: what was run and what came out, every figure recomputable from the trajectories."""

import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure import events, metrics, paper, recovery
from omni_mj.measure.statistics import CONFIDENCE, Spread, plain, spread
from omni_mj.measure.verdict import DEFINITIONS as VERDICTS
from omni_mj.measure.verdict import verdict
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.log import Log

if TYPE_CHECKING:
    from omni_mj.simulate.simulation import Failure

FORMAT = 2
Entry = dict[str, Any]  # what a summary says of one scenario

DEFINITIONS = {
    "error": (
        "absolute difference between the true pose (x_m, y_m, heading_rad) and the timed reference (ref_x_m, ref_y_m,"
        " ref_heading_rad), which is the same for all controllers: along x, along y, as distance in the plane, and of"
        " the heading (to the nearest turn); maximum, mean and root mean square over all frames of a seed"
    ),
    "spread": (
        "each seed's value, and over the seeds median, least, greatest and mean; plus_minus is half the"
        f" {100 * CONFIDENCE:g} % confidence interval of the mean by Student's t, which one seed does not have"
    ),
    "failed": (
        "rows that were stopped before their end: their errors count as infinite, so that a median can stand them and"
        " a mean cannot; everything else of them is left out"
    ),
    "reduction_percent": "100 (1 - median of this controller / median of the first controller)",
    "effort_m_s2": (
        "root mean square over the frames of the change of the sent translational command per second; what following"
        " the reference without any error needs is part of it"
    ),
    "settle_s": (
        "time from the end of the reference's last move until the error in the plane stays below"
        f" {100 * metrics.SETTLED_M:g} cm to the end of the run; over the seeds that settle"
    ),
    "greatest_at_s": "time at which the greatest error in the plane of a seed is reached",
    "alpha": (
        f"(x_m[k+n] - x_m[k]) / (T sum of applied_vx_m_s[k:k+n]) with n = {metrics.ALPHA_WINDOW_FRAMES}, T = 1/60 s;"
        " percentiles over all seeds and those k where the magnitude of applied_vx_m_s[k:k+n]'s mean is above"
        f" {metrics.ALPHA_MIN_SPEED_M_S} m/s"
    ),
    "peak": (
        "over all seeds the largest of voltage_peak_v and current_peak_a, which cover every physics step and motor, and"
        " of the temperatures of the windings"
    ),
    "drawn": (
        "what [variation] drew for the robot of a seed at a place, numbered by wheels: factors of friction, torque"
        " constant and of the mass that the wheels carry, what wheels have lost of their radius, the shift of the"
        " middle of that mass"
    ),
    "events": "the first frame of each kind, controller and seed; of faults each beginning and end",
    **recovery.DEFINITIONS,
    **VERDICTS,
}


def nothing_run(scenario: Scenario) -> Entry:
    """The entry of a scenario that was not run, or not yet."""
    return {
        "description": scenario.description, "plant": scenario.plant, "robot": scenario.robot,
        "status": "not run", "reason": None, "frames": 0, "simulated_s": 0.0, "wall_s": 0.0,
        "settings": scenario.settings.plain(), "paper_table": scenario.paper_table, "paper": paper.table(scenario),
        "drawn": [], "events": [], "failed": [], "results": {}, "verdict": None,
    }  # fmt: skip


def entry(
    scenario: Scenario,
    log: Log,
    failures: "Iterable[Failure]",
    measured: Mapping[str, Array],
    wall_s: float,
    stopped: str | None,
    limits: Iterable[str] = (),
    subject: str | None = None,
    drawn: Mapping[str, Array] | None = None,
) -> Entry:
    """The entry of a scenario that was run.

    Args:
        scenario: what was run.
        log: what was recorded.
        failures: the rows that were stopped.
        measured: what `metrics` and `recovery` say of its rows; empty where errors mean nothing.
        wall_s: how long it took, s.
        stopped: why it ended before its time, or None.
        limits: controllers that are no competitors.
        subject: the controller of which a verdict is asked for, or None.
        drawn: what sets the rows' robots apart, name -> (n,).
    """
    failures, frames = list(failures), int(log.lengths.max(initial=0))
    found = results(log, failures, measured) if measured and (frames or failures) else {}
    return nothing_run(scenario) | {
        "status": "stopped" if stopped else "done",
        "reason": stopped,
        "frames": frames,
        "simulated_s": frames * PERIOD_S,
        "wall_s": round(wall_s, 3),
        "drawn": _each_robot(log, drawn) if drawn else [],
        "events": [asdict(event) for event in events.find(log, failures)],
        "failed": [
            {
                "controller": f.controller, "seed": f.seed, "place": log.rows[f.row].place,
                "time_s": f.time_s, "cause": f.cause,
            }
            for f in failures
        ],
        "results": found,
        "verdict": None if stopped else verdict(found, limits, subject),
    }  # fmt: skip


def results(log: Log, failures: "Iterable[Failure]", measured: Mapping[str, Array]) -> dict[str, Any]:
    """Per controller its errors, effort, time to settle, recovery from faults, alpha and peaks over its rows."""
    failed = {failure.row for failure in failures}
    found: dict[str, Any] = {}
    base: dict[str, dict[str, Spread]] = {}
    for controller in log.controllers:
        rows = log.of(controller)
        error = {
            axis: {
                statistic: spread(measured[f"{axis}_{statistic}_{metrics.UNITS[axis]}"][rows])
                for statistic in metrics.STATISTICS
            }
            for axis in metrics.AXES
        }
        found[controller] = {
            "error_m": {axis: error[axis] for axis in metrics.AXES if metrics.UNITS[axis] == "m"},
            "error_rad": {axis: error[axis] for axis in metrics.AXES if metrics.UNITS[axis] == "rad"},
            "reduction_percent": _reduction(error, base) if base else None,
            **{name: spread(measured[name][rows]) for name in ("effort_m_s2", "settle_s", "greatest_at_s")},
            "recovery": recovery.results(log, controller, measured),
            "alpha": metrics.alpha_percentiles(log, rows),
            **{name: _peak(measured[name][rows]) for name in metrics.PEAKS},
            "failed": len(failed.intersection(rows.tolist())),
        }
        base = base or error
    return found


def document(
    entries: Mapping[str, Entry],
    controllers: Iterable[str],
    limits: Iterable[str],
    seeds: Iterable[int],
    *,
    created: str,
    wall_s: float,
    complete: bool,
    stopped: str | None,
    subject: str | None,
    repeat: str | None,
) -> dict[str, Any]:
    """The whole summary, of one scenario or several that were run with the same controllers and seeds."""
    return {
        "format": FORMAT, "created": created, "complete": complete, "stopped": stopped, "wall_s": round(wall_s, 3),
        "repeat": repeat, "controllers": list(controllers), "limits": list(limits), "seeds": list(seeds),
        "subject": subject, "scenarios": dict(entries), "definitions": DEFINITIONS, "versions": versions(),
    }  # fmt: skip


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the result."""
    packages = ("omni-mj", "mujoco", "numpy", "rerun-sdk", "pyarrow")
    return {"python": platform.python_version()} | {name: version(name) for name in packages}


def _each_robot(log: Log, drawn: Mapping[str, Array]) -> list[dict[str, Any]]:
    """What was drawn for each seed and place, which is the same for all controllers."""
    first = {(row.seed, row.place): i for i, row in reversed(list(enumerate(log.rows)))}
    return [
        {"seed": seed, "place": place, **{name: plain(values[i]) for name, values in drawn.items()}}
        for (seed, place), i in sorted(first.items())
    ]


def _reduction(error: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, dict[str, float | None]]:
    """By how much the medians are below the first controller's, %; None where there is none, or it is zero."""
    return {
        axis: {
            name: None
            if error[axis][name]["median"] is None or not base[axis][name]["median"]
            else 100 * (1 - error[axis][name]["median"] / base[axis][name]["median"])
            for name in metrics.STATISTICS
        }
        for axis in metrics.AXES
    }


def _peak(values: Array) -> float | None:
    known = values[~np.isnan(values)]
    return plain(known.max()) if known.size else None

"""The content of summary.json: scenarios, results of the controllers, definitions, versions."""

import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config import PERIOD_S
from omni_mj.config.scenario import Scenario
from omni_mj.io.atomic_files import read_json
from omni_mj.results import events, metrics, paired_comparison, paper_tables, saturation
from omni_mj.results.alpha_windows import alpha_percentiles
from omni_mj.results.metrics import AXES, EXCURSION, RECOVERY, STATISTICS, UNITS
from omni_mj.results.seed_statistics import SeedStatistics, finite_or_none, summarize_seeds
from omni_mj.results.summary_definitions import DEFINITIONS
from omni_mj.simulation.log import Failure, Log

SUMMARY_FORMAT = 5  # version of the keys of summary.json
UNFINISHED = "unfinished (still running, or killed)"  # reason while a study is not complete
# Packages that affect the results. The last two are optional.
PACKAGES = (
    "omni-mj",
    "mujoco",
    "numpy",
    "scipy",
    "rerun-sdk",
    "pyarrow",
    "piqp",
    "jax",
)
Entry = dict[str, Any]  # of one scenario in a summary
OTHER_METRICS = ("effort_m_s2", "excess_effort_m_s2", "settle_s")


def empty_entry(scenario: Scenario) -> Entry:
    """Return the entry of a scenario that was not run."""
    return {
        "description": scenario.description,
        "plant": scenario.plant,
        "robot": scenario.robot,
        "status": "not run",
        "reason": None,
        "seeds": [],
        "frames": 0,
        "simulated_s": 0.0,
        "wall_s": 0.0,
        "settings": scenario.settings_to_dict(),
        "paper_table": scenario.paper_table,
        "paper": paper_tables.find_paper_table(scenario),
        "drawn_parameters": [],
        "events": [],
        "failures": [],
        "results": {},
        "verdict": None,
    }


def scenario_entry(
    scenario: Scenario,
    log: Log,
    failures: Sequence[Failure],
    row_metrics: Mapping[str, Array],
    wall_s: float,
    stopped: str | None,
    drawn_parameters: Mapping[str, Array],
) -> Entry:
    """Return the entry of a scenario that was run, without its verdict.

    Args:
        scenario: The scenario.
        log: Its recorded frames.
        failures: Rows that were stopped.
        row_metrics: Metrics of its rows, name -> shape (n,). Empty for a scenario without results.
        wall_s: Duration of the run, s.
        stopped: Reason why the run ended early, or None.
        drawn_parameters: Parameters drawn for each row, name -> shape (n,).
    """
    frames = int(log.lengths.max(initial=0))
    has_results = row_metrics and (frames or failures)
    return empty_entry(scenario) | {
        "status": "stopped" if stopped else "done",
        "reason": stopped,
        "seeds": log.seeds,
        "frames": frames,
        "simulated_s": frames * PERIOD_S,
        "wall_s": round(wall_s, 3),
        "drawn_parameters": _list_drawn_parameters(log, drawn_parameters),
        "events": [asdict(event) for event in events.find_events(log, failures)],
        "failures": [
            {
                "controller": failure.controller,
                "seed": failure.seed,
                "slot": log.rows[failure.row].slot,
                "time_s": failure.time_s,
                "cause": failure.cause,
            }
            for failure in failures
        ],
        "results": controller_results(log, failures, row_metrics) if has_results else {},
    }


def controller_results(
    log: Log, failures: Sequence[Failure], row_metrics: Mapping[str, Array]
) -> dict[str, Any]:
    """Return the results of each controller over its rows, by the controllers' labels."""
    failed = {failure.row for failure in failures}
    results: dict[str, Any] = {}
    for controller in log.controllers:
        rows = log.rows_of(controller)
        errors = {
            axis: {
                statistic: summarize_seeds(row_metrics[f"{axis}_{statistic}_{UNITS[axis]}"][rows])
                for statistic in STATISTICS
            }
            for axis in AXES
        }
        heading_error = errors.pop("heading")
        results[controller] = {
            "error_m": errors,
            "error_rad": {"heading": heading_error},
            **{name: summarize_seeds(row_metrics[name][rows]) for name in OTHER_METRICS},
            "recovery": _recovery_results(log, rows, row_metrics),
            "saturation": {
                name: _statistics_without_failed(row_metrics[name][rows])
                for name in saturation.METRIC_LABELS
            },
            "alpha": alpha_percentiles(log, rows),
            **{
                # fmax ignores NaN, which failed rows have.
                name: finite_or_none(np.fmax.reduce(row_metrics[name][rows]))
                for name in metrics.PEAKS
            },
            "n_failed": len(failed.intersection(rows.tolist())),
            "n_settled": int(np.isfinite(row_metrics["settle_s"][rows]).sum()),
        }
    return results


def build_summary(entries: Mapping[str, Entry], head: Mapping[str, Any]) -> dict[str, Any]:
    """Return the summary of a study, with verdicts.

    Args:
        entries: Scenario -> its entry. All were run with the same controllers.
        head: Keys of summary.json about the study as a whole.
    """
    verdicts = paired_comparison.judge_subject(entries, head["privileged"], head["subject"])
    scenarios = {name: {**entry, "verdict": verdicts[name]} for name, entry in entries.items()}
    return {
        "format": SUMMARY_FORMAT,
        **head,
        "scenarios": scenarios,
        "definitions": DEFINITIONS,
        "versions": package_versions(),
    }


def read_summary(folder: Path) -> dict[str, Any]:
    """Return the summary in the folder of a run or comparison.

    Raises:
        OmniError: The summary does not exist, or cannot be read.
    """
    path = folder / "summary.json"
    if not path.exists():
        raise OmniError(
            f"{folder} holds no run: it has no {path.name}. Name the folder of a run; folders of"
            " omni-mj serve have no summary, because there is no reference to compare with"
        )
    summary = read_json(path)
    if summary.get("format") != SUMMARY_FORMAT or not summary.get("scenarios"):
        raise OmniError(
            f"{path} is not a run's summary of format {SUMMARY_FORMAT}, which is supported"
        )
    return summary


@cache
def package_versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that affect the results."""
    versions = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return versions


def flatten(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the names `section.field` of nested values, and the values.

    Args:
        values: Mapping from name to value or to a further mapping.
        prefix: Text before each name.
    """
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _list_drawn_parameters(log: Log, parameters: Mapping[str, Array]) -> list[dict[str, Any]]:
    """Return the parameters drawn for each seed and slot, which all controllers share."""
    if not parameters:
        return []
    indices = {(row.seed, row.slot): i for i, row in enumerate(log.rows)}
    return [
        {
            "seed": seed,
            "slot": slot,
            **{name: finite_or_none(values[i]) for name, values in parameters.items()},
        }
        for (seed, slot), i in sorted(indices.items())
    ]


def _recovery_results(
    log: Log, rows: np.ndarray, row_metrics: Mapping[str, Array]
) -> list[dict[str, Any]]:
    """Return statistics of a controller's excursion and recovery time for each fault.

    The faults are those of its first row. The statistics are over its rows that have the same
    fault.
    """
    results = []
    for i, fault in enumerate(log.rows[rows[0]].settings.fault):
        affected = [
            row
            for row in rows
            if log.rows[row].settings.fault[i : i + 1] == (fault,)
            and fault.affects(log.rows[row].slot)
        ]
        result = {
            "fault": fault.description,
            "kind": fault.kind,
            "start_s": fault.start_s,
            "duration_s": fault.duration_s or None,
        }
        for key in (EXCURSION, RECOVERY):
            result[key] = summarize_seeds(row_metrics[f"fault_{i + 1}_{key}"][affected])
        results.append(result)
    return results


def _statistics_without_failed(values: Array) -> SeedStatistics:
    """Return statistics over the seeds that did not fail. Failed ones are None in `per_seed`."""
    known = values[~np.isnan(values)]
    statistics_of_known = summarize_seeds(known if known.size else np.array([np.nan]))
    return statistics_of_known | {"per_seed": finite_or_none(values)}

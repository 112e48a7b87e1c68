"""Logs with given channels, and their metrics and results."""
# ruff: noqa: F401

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import omni_mj as om
from omni_mj.config.resolve import resolve_settings
from omni_mj.config.rows import Row
from omni_mj.config.settings import Settings
from omni_mj.results import (
    events,
    paired_comparison,
    paper_tables,
    saturation,
    seed_statistics,
    summary,
)
from omni_mj.results.alpha_windows import alpha_windows
from omni_mj.results.metrics import row_metrics, tracking_errors
from omni_mj.results.paired_comparison import judge_subject
from omni_mj.results.result import Outcome
from omni_mj.results.result_tables import recovery_table, results_table
from omni_mj.simulation.log import Failure, Log


def rows(
    controllers: Sequence[str] = ("flc",),
    seeds: Sequence[int] = (0,),
    settings: Settings | None = None,
) -> list[Row]:
    """Return rows of all controllers with all seeds."""
    named = [(controller, seed) for controller in controllers for seed in seeds]
    chosen = resolve_settings() if settings is None else settings
    return [
        Row(world, 0, controller, seed, chosen, "tigers-v2016")
        for world, (controller, seed) in enumerate(named)
    ]


def fill_log(
    log_rows: Sequence[Row],
    frames: int,
    lengths: ArrayLike | None = None,
    controller_channels: Mapping[str, NDArray] | None = None,
    **channels: NDArray | float | bool,
) -> Log:
    """Return a log with given channels, of rows that end after `lengths`.

    `channels` are (frames, n, columns), or what broadcasts to it; poses, references and commands
    are zero otherwise. Those of controllers' `own` are (n, columns), the same in all frames.
    """
    log = Log(log_rows, 4)
    ends = np.full(len(log_rows), frames) if lengths is None else np.asarray(lengths)
    defaults = {"ref": 0.0, "pose": 0.0, "command": 0.0, **channels}
    values = {
        name: np.broadcast_to(np.asarray(value), (frames, len(log_rows), len(log.columns[name])))
        for name, value in defaults.items()
    }
    for frame in range(frames):
        log.append(
            frame < ends,
            controller_channels or {},
            **{name: value[frame] for name, value in values.items()},
        )
    return log


def failure(log: Log, row: int, cause: str = "toppled over") -> Failure:
    """Return the failure of a row after its last frame."""
    of = log.rows[row]
    return Failure(row, of.controller, of.seed, log.lengths[row] / 60, cause)


def metrics_of(log: Log, failures: Sequence[Failure] = ()) -> dict[str, NDArray]:
    """Return the metrics of each row."""
    return row_metrics(log, failures)


def results(log: Log, failures: Sequence[Failure] = ()) -> dict[str, Any]:
    """Return the results of each controller."""
    return summary.controller_results(log, failures, row_metrics(log, failures))


def outcome(scenario: om.Scenario, log: Log, failures: Sequence[Failure] = ()) -> Outcome:
    """Return the outcome of a scenario with the frames of a log."""
    metrics = row_metrics(log, failures)
    entry = summary.scenario_entry(scenario, log, failures, metrics, 1.0, None, {})
    return Outcome(scenario, entry, log.rows, failures, metrics, log)


def comparison_summary(
    results: Mapping[str, Any], privileged: Sequence[str], subject: str | None
) -> dict[str, Any]:
    """Return the summary of a comparison on one scenario."""
    entry = {
        "description": "one | two", "plant": "mujoco", "robot": "tigers-v2016",
        "status": "done", "reason": None,
        "frames": 60, "simulated_s": 1.0, "wall_s": 1.0, "settings": {},
        "paper_table": 0, "paper": None,
        "events": [], "failures": [], "results": results, "seeds": [0, 1, 2, 3],
    }  # fmt: skip
    head = {
        "created": "", "complete": True, "stopped": None, "wall_s": 1.0,
        "repeat_command": "", "controllers": list(results),
        "privileged": list(privileged), "seeds": list(range(20)), "subject": subject,
    }  # fmt: skip
    return summary.build_summary({"rect": entry}, head)

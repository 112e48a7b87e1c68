"""A shard: some runs of a sweep, simulated together and measured; a table of one line per robot is what remains."""

import gc
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_mj import parquet
from omni_mj.measure.metrics import row_metrics
from omni_mj.scenarios.distributions import value
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.outcome import nothing
from omni_mj.studies.sweep.plan import Job, Plan

if TYPE_CHECKING:
    import pyarrow as pa

FOLDER = "shards"


def simulation(plan: Plan, job: Job) -> Simulation:
    """The simulation of a shard's robots, at its start.

    Raises:
        OmniError: they cannot share a plant, or a seed draws what is not allowed.
    """
    return Simulation(next(iter(plan.scenarios(job).values())), rows=plan.rows(job))


def run(plan: Plan, job: Job, after_frame: Callable[[int], None] = nothing) -> "pa.Table":
    """Simulate a shard and measure it.

    Args:
        plan: of the sweep.
        job: which shard.
        after_frame: called with each frame's number; what it raises ends the shard, of which then nothing is kept.

    Returns:
        A line per robot: `point`, what is varied, `controller`, `seed`, `place`, `failed_at_s`, `cause`, what was
        drawn, and the numbers of `metrics.row_metrics`, infinite errors for a robot that failed.
    """
    import pyarrow as pa

    gc.collect()  # the shard before, which is held by itself in circles, and would take as much memory again
    driven = simulation(plan, job)
    log = driven.run(after_frame)
    rows, measured = driven.rows, row_metrics(log, driven.failures)
    failures = {failure.row: failure for failure in driven.failures}
    there = plan.scenarios(job)
    count = len(plan.scenario.controllers)
    number = [point for point, _ in job.runs for _ in range(count * len(there[point].settings.world.places))]
    columns: dict[str, object] = {"point": np.array(number, np.int32)}
    columns |= {name.name: [plan.points[point][name.name] for point in number] for name in plan.axes}
    columns |= {
        "controller": [row.controller for row in rows],
        "seed": np.array([row.seed for row in rows], np.int64),
        "place": np.array([row.place for row in rows], np.int32),
        "failed_at_s": [failures[i].time_s if i in failures else math.nan for i in range(len(rows))],
        "cause": pa.array([failures[i].cause if i in failures else None for i in range(len(rows))], pa.string()),
    }
    drawn = {name for each in there.values() for name in each.distributions}
    columns |= {name: [value(row.settings, name) for row in rows] for name in sorted(drawn)}
    return pa.table(columns | measured)


def save(table: "pa.Table", path: Path) -> None:
    """Write a table as Parquet; the file appears whole or not at all, and is then on the disk."""
    parquet.write([table], path)


def file(folder: Path, job: Job) -> Path:
    """Where a shard's table is in the folder of a sweep."""
    return folder / FOLDER / f"{job.number:06d}.parquet"

"""Runs a sweep shard by shard, each written when it is done, so that what was computed is never computed again."""

import gc
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_mj import parquet
from omni_mj.config.rows import Row
from omni_mj.config.rows import table as rows_of
from omni_mj.config.scenario import Scenario
from omni_mj.files import write_text
from omni_mj.results.metrics import row_metrics
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.run_scenario import resolve_scenario
from omni_mj.studies.study_runner import AfterFrame, StoppedError, ignore_frame
from omni_mj.studies.sweep.sweep_plan import BATCH_SIZE, Shard, SweepPlan, check_axes
from omni_mj.studies.sweep.sweep_statistics import cells, correlations, worst
from omni_mj.studies.sweep.workers import processes, tables

if TYPE_CHECKING:
    import pyarrow as pa

ROWS, SHARDS = "rows.parquet", "shards"
BeforeShard = Callable[[Shard], AfterFrame]


@dataclass(frozen=True)
class SweepResult:
    """What came of a sweep.

    Attributes:
        plan: What was asked for.
        done: How many of its shards are.
        stopped: Why it ended before its time, or None.
        folder: Where it is.
    """

    plan: SweepPlan
    done: int
    stopped: str | None
    folder: Path

    @property
    def complete(self) -> bool:
        """Return whether all of it is there."""
        return self.done == len(self.plan.shards)

    def rows(self) -> "pa.Table":
        """Return a line per robot that was simulated, by point, controller, seed and place; see `run_shard`."""
        whole = self.folder / ROWS
        return parquet.read_table(whole) if whole.is_file() else _gathered(self.plan, self.folder)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Return what summary.json holds."""
        table, names = self.rows(), list(self.plan.axes)
        return {
            "complete": self.complete, "shards": len(self.plan.shards), "done": self.done, "cells": cells(table, names),
            "correlations": correlations(table), "worst": worst(table, self.plan, self.folder),
        }  # fmt: skip


def sweep(
    scenario: Scenario | str,
    vary: Mapping[str, Iterable[Any]],
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: int | Iterable[int] | None = None,
    *,
    out: str | Path,
    batch_size: int = BATCH_SIZE,
    **how: Any,
) -> SweepResult:
    """Run a scenario under all combinations of settings, with all seeds and controllers.

    Args:
        scenario: All that is not varied; what it draws from distributions is drawn anew for each
            seed.
        vary: Settings `section.field` -> values; none for a scenario that draws some.
        controllers: Names, `file.py:Class`, or classes derived from `Controller`. [the scenario's]
        seeds: Of the random numbers, counting up, or how many from 0 on; the same everywhere. [the
            scenario's]
        out: Folder that a sweep is begun in, or gone on with if it is the same.
        batch_size: Robots that are simulated at once: memory grows with them, and not with the number
            of runs.
        how: It is run: `jobs`, `executor`, `before_shard` of `run`.

    Raises:
        OmniError: Something is unknown or not allowed, what is asked for does not fit into memory,
            or another sweep is in the folder.
    """
    return run_sweep(
        SweepPlan(resolve_scenario(scenario, controllers, seeds), check_axes(vary), batch_size),
        out,
        **how,
    )


def run_sweep(
    plan: SweepPlan,
    out: str | Path,
    *,
    jobs: int = 1,
    executor: Executor | None = None,
    before_shard: BeforeShard = lambda job: ignore_frame,
    check: Callable[[], None] = lambda: None,
) -> SweepResult:
    """Run a plan, or the shards of it that are not in its folder yet.

    Args:
        plan: Of the sweep.
        out: Its folder.
        jobs: Processes of this machine that run shards side by side.
        executor: Runs shards in their place, anywhere, such as that of a Dask cluster.
        before_shard: Called with each shard; what it returns is called after each frame, and may
            raise `StoppedError`. Of shards that other processes run, both are called once, when
            they are done.
        check: Called now and then while others run shards; it may raise `StoppedError`.

    Raises:
        OmniError: See `sweep`.
    """
    folder, stopped = Path(out), None
    plan.check(jobs)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in plan.files.items():
        if not (folder / name).exists():
            write_text(folder / name, text)
        elif (folder / name).read_text(encoding="utf-8") != text:
            raise OmniError(f"{folder} holds another sweep, by its {name}; name another --out")
    (folder / SHARDS).mkdir(exist_ok=True)
    missing = remaining_shards(plan, folder)
    try:
        with nullcontext(executor) if executor or jobs == 1 else processes(jobs) as workers:
            if workers is None:
                for job in missing:
                    parquet.write_tables(
                        [run_shard(plan, job, before_shard(job))], _file(folder, job)
                    )
            else:
                for job, table in tables(workers, run_shard, plan, missing, check):
                    parquet.write_tables([table], _file(folder, job))
                    before_shard(job)(plan.frames - 1)
    except StoppedError as error:
        stopped = error.reason
    result = SweepResult(
        plan, len(plan.shards) - len(remaining_shards(plan, folder)), stopped, folder
    )
    if result.complete and not (folder / ROWS).exists():
        parquet.write_tables([_gathered(plan, folder)], folder / ROWS)
    if result.done:
        write_text(
            folder / "summary.json", json.dumps(result.summary, indent=1, allow_nan=False) + "\n"
        )
    if result.complete:
        for job in plan.shards:
            _file(folder, job).unlink(missing_ok=True)
        (folder / SHARDS).rmdir()
    return result


def remaining_shards(plan: SweepPlan, folder: Path) -> list[Shard]:
    """Return the shards that are still to be run."""
    return (
        []
        if (folder / ROWS).exists()
        else [job for job in plan.shards if not _file(folder, job).exists()]
    )


def simulation(plan: SweepPlan, job: Shard) -> Simulation:
    """Return the simulation of a shard's robots at its start, a world for each run and controller.

    Raises:
        OmniError: What a seed draws is not allowed.
    """
    there = {point: plan.at(point) for point in dict.fromkeys(point for point, _ in job.runs)}
    rows = list[Row]()
    for point, seed in job.runs:
        for row in rows_of(
            there[point].labels, [seed], there[point].settings_of, there[point].robot
        ):
            world = rows[-1].world + (row.slot == 0) if rows else 0
            rows.append(Row(world, row.slot, row.controller, row.seed, row.settings, row.robot))
    return Simulation(there[job.runs[0][0]], rows=rows)


def run_shard(plan: SweepPlan, job: Shard, after_frame: AfterFrame = ignore_frame) -> "pa.Table":
    """Simulate a shard and measure it.

    Args:
        plan: Of the sweep.
        job: Which shard.
        after_frame: Called with each frame's number; what it raises ends the shard, of which then
            nothing is kept.

    Returns:
        A line per robot: `point`, what is varied, `controller`, `seed`, `place`, `failed_at_s`,
            `cause`, what was
        drawn, and the numbers of `metrics.row_metrics`, infinite errors for a robot that failed.
    """
    import pyarrow as pa

    # The shard before, which is held by itself in circles, and would take as much memory again
    gc.collect()
    driven = simulation(plan, job)
    log = driven.run(after_frame)
    failures = {failure.row: failure for failure in driven.failures}
    n = len(driven.rows) // len(job.runs)  # rows of a run
    point = np.repeat([point for point, _ in job.runs], n).astype(np.int32)
    columns: dict[str, object] = {"point": point}
    columns |= {name: [plan.points[i][name] for i in point] for name in plan.axes}
    columns |= {
        "controller": [row.controller for row in driven.rows],
        "seed": np.array([row.seed for row in driven.rows], np.int64),
        "slot": np.array([row.slot for row in driven.rows], np.int32),
        "failed_at_s": [failures[i].time_s if i in failures else np.nan for i in range(len(point))],
        "cause": pa.array(
            [failures[i].cause if i in failures else None for i in range(len(point))], pa.string()
        ),
    }
    drawn = sorted(set(plan.scenario.distributions) - set(plan.points[0]))
    columns |= {name: [attrgetter(name)(row.settings) for row in driven.rows] for name in drawn}
    return pa.table(columns | row_metrics(log, driven.failures))


def _gathered(plan: SweepPlan, folder: Path) -> "pa.Table":
    import pyarrow as pa

    files = [_file(folder, job) for job in plan.shards if _file(folder, job).exists()]
    if not files:
        raise OmniError(f"nothing of the sweep in {folder} has been run yet")
    table = pa.concat_tables(
        [parquet.read_table(file) for file in files], promote_options="permissive"
    )
    order = pa.array(
        [plan.scenario.labels.index(label) for label in table["controller"].to_pylist()]
    )
    keys = [(name, "ascending") for name in ("point", "order", "seed", "slot")]
    return table.append_column("order", order).sort_by(keys).drop_columns("order")


def _file(folder: Path, job: Shard) -> Path:
    return folder / SHARDS / f"{job.number:06d}.parquet"

"""Runs a sweep shard by shard, each written when it is done, so that what was computed is never computed again."""

import gc
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_mj import parquet
from omni_mj.files import write
from omni_mj.measure.metrics import row_metrics
from omni_mj.scenarios.distributions import value
from omni_mj.scenarios.scenario import Scenario
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies import run as runs
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing
from omni_mj.studies.sweep import cells
from omni_mj.studies.sweep.plan import AT_ONCE, Axis, Job, Plan, axes
from omni_mj.studies.sweep.workers import Workers, tables

if TYPE_CHECKING:
    import pyarrow as pa

ROWS, SHARDS, KEPT = "rows.parquet", "shards", "kept"
KEEPS = ("worst", "median", "sample")  # which robots' trajectories can be kept
MOST_KEPT = 1000  # of each kind and controller
BeforeShard = Callable[[Job], AfterFrame]
Keep = tuple[str, int]  # of `KEEPS`, and how many of each controller


@dataclass(frozen=True)
class Sweep:
    """What came of a sweep.

    Attributes:
        plan: What was asked for.
        done: How many of its shards are.
        stopped: Why it ended before its time, or None.
        folder: Where it is.
    """

    plan: Plan
    done: int
    stopped: str | None
    folder: Path

    @property
    def complete(self) -> bool:
        """Return whether all of it is there."""
        return self.done == len(self.plan.jobs)

    def rows(self) -> "pa.Table":
        """Return a line per robot that was simulated, by point, controller, seed and place; see `run_shard`."""
        whole = self.folder / ROWS
        return parquet.read(whole) if whole.is_file() else _gathered(self.plan, self.folder)

    def cells(self) -> list[dict[str, Any]]:
        """Return failure rate and errors of each point and controller; see `cells.of`."""
        return cells.of(self.rows(), [axis.name for axis in self.plan.axes])


def sweep(
    scenario: Scenario | str,
    vary: Mapping[str, Iterable[Any]] | Sequence[Axis],
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: Iterable[int] | None = None,
    *,
    out: str | Path,
    at_once: int = AT_ONCE,
    **how: Any,
) -> Sweep:
    """Run a scenario under all combinations of settings, with all seeds and controllers.

    Args:
        scenario: All that is not varied; what it draws from distributions is drawn anew for each seed.
        vary: Settings `section.field` -> values.
        controllers: Names, `file.py:Class`, or classes derived from `Controller`. [the scenario's]
        seeds: Of the random numbers, counting up, the same everywhere. [the scenario's]
        out: Folder that a sweep is begun in, or gone on with if it is the same.
        at_once: Robots that are simulated at once: memory grows with them, and not with the number of runs.
        how: It is run: `jobs`, `cluster`, `keep`, `before_shard` of `run`.

    Raises:
        OmniError: Something is unknown or not allowed, what is asked for does not fit into memory, or another sweep is
            in the folder.
    """
    return run(Plan(runs.chosen(scenario, controllers, seeds), axes(vary), at_once), out, **how)


def run(
    plan: Plan,
    out: str | Path,
    *,
    jobs: int = 1,
    cluster: Any = None,
    keep: Iterable[str] = (),
    before_shard: BeforeShard = lambda job: nothing,
    check: Callable[[], None] = lambda: None,
) -> Sweep:
    """Run a plan, or the shards of it that are not in its folder yet.

    Args:
        plan: Such as that of `sensitivity.plan`.
        out: Its folder.
        jobs: Processes of this machine that run shards side by side.
        cluster: Address of a Dask scheduler, or a `distributed.Client`, on whose workers shards are run in their place.
        keep: Of which robots of each controller the trajectories are kept: "worst:3", "median", "sample:10".
        before_shard: Called with each shard; what it returns is called after each frame, and may raise `StoppedError`.
            Of shards that other processes run, both are called once, when they are done.
        check: Called now and then while others run shards; it may raise `StoppedError`.

    Raises:
        OmniError: See `sweep`.
    """
    folder, where, kept, stopped = Path(out), Workers(jobs, cluster), [parse_keep(text) for text in keep], None
    plan.check_memory(jobs)
    if not (folder / "sweep.json").exists():
        folder.mkdir(parents=True, exist_ok=True)
        plan.save(folder)
    elif Plan.read(folder).key != plan.key:
        raise OmniError(f"{folder} holds another sweep; name another --out, or go on with that: --resume {folder}")
    (folder / SHARDS).mkdir(exist_ok=True)
    try:
        for job, table in _tables(plan, left(plan, folder), before_shard, where, check):
            parquet.write([table], _file(folder, job))
    except StoppedError as error:
        stopped = error.reason
    result = Sweep(plan, len(plan.jobs) - len(left(plan, folder)), stopped, folder)
    if result.complete and not (folder / ROWS).exists():
        parquet.write([_gathered(plan, folder)], folder / ROWS)
    if result.done:
        summary = {"complete": result.complete, "shards": len(plan.jobs), "done": result.done, "cells": result.cells()}
        write(folder / "summary.json", json.dumps(summary, indent=1, allow_nan=False, default=int) + "\n")
    if result.complete:
        for job in plan.jobs:
            _file(folder, job).unlink(missing_ok=True)
        (folder / SHARDS).rmdir()
        for name, robot in chosen(result, kept).items():
            _run_again(result, *robot).save(folder / KEPT / name)
    return result


def resume(folder: str | Path, **how: Any) -> Sweep:
    """Go on with a sweep that was stopped or killed, anywhere; see `run`.

    Raises:
        OmniError: There is none in the folder.
    """
    return run(Plan.read(Path(folder)), folder, **how)


def left(plan: Plan, folder: Path) -> list[Job]:
    """Return the shards that are still to be run."""
    return [] if (folder / ROWS).exists() else [job for job in plan.jobs if not _file(folder, job).exists()]


def simulation(plan: Plan, job: Job) -> Simulation:
    """Return the simulation of a shard's robots, at its start.

    Raises:
        OmniError: They cannot share a plant, or a seed draws what is not allowed.
    """
    return Simulation(plan.at(job.runs[0][0]), rows=plan.rows(job))


def run_shard(plan: Plan, job: Job, after_frame: AfterFrame = nothing) -> "pa.Table":
    """Simulate a shard and measure it.

    Args:
        plan: Of the sweep.
        job: Which shard.
        after_frame: Called with each frame's number; what it raises ends the shard, of which then nothing is kept.

    Returns:
        A line per robot: `point`, what is varied, `controller`, `seed`, `place`, `failed_at_s`, `cause`, what was
        drawn, and the numbers of `metrics.row_metrics`, infinite errors for a robot that failed.
    """
    import pyarrow as pa

    gc.collect()  # the shard before, which is held by itself in circles, and would take as much memory again
    driven = simulation(plan, job)
    log = driven.run(after_frame)
    failures = {failure.row: failure for failure in driven.failures}
    there = {point: plan.at(point) for point, _ in job.runs}
    count = len(plan.scenario.controllers)
    number = [point for point, _ in job.runs for _ in range(count * len(there[point].settings.world.places))]
    columns: dict[str, object] = {"point": np.array(number, np.int32)}
    columns |= {axis.name: [plan.points[point][axis.name] for point in number] for axis in plan.axes}
    columns |= {
        "controller": [row.controller for row in driven.rows],
        "seed": np.array([row.seed for row in driven.rows], np.int64),
        "place": np.array([row.place for row in driven.rows], np.int32),
        "failed_at_s": [failures[i].time_s if i in failures else np.nan for i in range(len(number))],
        "cause": pa.array([failures[i].cause if i in failures else None for i in range(len(number))], pa.string()),
    }
    drawn = {name for scenario in there.values() for name in scenario.distributions}
    columns |= {name: [value(row.settings, name) for row in driven.rows] for name in sorted(drawn)}
    return pa.table(columns | row_metrics(log, driven.failures))


def parse_keep(text: str) -> Keep:
    """Read what the command line says: `worst:3`, `median`, `sample:10`.

    Raises:
        OmniError: It cannot be read.
    """
    found = re.fullmatch(rf"({'|'.join(KEEPS)})(?::([0-9]+))?", text.strip())
    count = int(found[2] or 1) if found else 0
    if not found or not 1 <= count <= MOST_KEPT:
        ways = ", ".join(f"{kind}:N" for kind in KEEPS)
        raise OmniError(f"cannot read --keep {text}; write {ways}, N up to {MOST_KEPT}")
    return found[1], count


def chosen(result: Sweep, keeps: Iterable[Keep]) -> dict[str, tuple[int, str, int]]:
    """Return the runs in which the robots are whose trajectories are kept, name -> point, controller and seed.

    Worst are those that failed, the earliest first, then those that strayed farthest; the median is the middle one in
    this order, and others around it; a sample is evenly spread over the rows as they stand.
    """
    table, found = result.rows(), dict[str, tuple[int, str, int]]()
    names = ("point", "controller", "seed", "failed_at_s", cells.STRAYED)
    point, controller, seed, failed, strayed = (table[name].to_numpy(zero_copy_only=False) for name in names)
    for name in dict.fromkeys(controller.tolist()):
        own = np.flatnonzero(controller == name)
        ranked = own[np.lexsort((np.nan_to_num(failed[own], nan=np.inf), -strayed[own]))]
        for kind, wanted in keeps:
            count = min(wanted, len(own))
            first = (len(own) - count) // 2
            rows = {
                "worst": ranked[:count],
                "median": ranked[first : first + count],
                "sample": own[np.linspace(0, len(own) - 1, count).round().astype(int)],
            }[kind]
            for number, row in enumerate(rows.tolist(), 1):
                found[f"{name}-{kind}-{number}"] = int(point[row]), name, int(seed[row])
    return found


def _run_again(result: Sweep, point: int, controller: str, seed: int) -> Any:
    """Return what `run` says of a robot of a sweep."""
    scenario = result.plan.scenario
    kinds = dict(zip(scenario.labels, scenario.controllers, strict=True))
    return runs.run(result.plan.at(point), [kinds[controller]], [seed])


def _tables(
    plan: Plan, jobs: Sequence[Job], before_shard: BeforeShard, where: Workers, check: Callable[[], None]
) -> "Iterator[tuple[Job, pa.Table]]":
    """Yield the tables of shards, in the order in which they are done."""
    if where.here or not jobs:
        for job in jobs:
            yield job, run_shard(plan, job, before_shard(job))
        return
    for job, table in tables(where, run_shard, plan, jobs, check):
        yield job, table
        before_shard(job)(plan.frames - 1)


def _gathered(plan: Plan, folder: Path) -> "pa.Table":
    import pyarrow as pa

    files = [_file(folder, job) for job in plan.jobs if _file(folder, job).exists()]
    if not files:
        raise OmniError(f"nothing of the sweep in {folder} has been run yet")
    table = pa.concat_tables([parquet.read(file) for file in files], promote_options="permissive")
    names = {label: i for i, label in enumerate(plan.scenario.labels)}
    order = pa.array([names[label] for label in table["controller"].to_pylist()])
    keys = [(name, "ascending") for name in ("point", "order", "seed", "place")]
    return table.append_column("order", order).sort_by(keys).drop_columns("order")


def _file(folder: Path, job: Job) -> Path:
    return folder / SHARDS / f"{job.number:06d}.parquet"

"""Runs a sweep: shard by shard, each written when it is done, so that what was computed is never computed again."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_mj import parquet
from omni_mj.files import write
from omni_mj.scenarios.scenario import Scenario
from omni_mj.studies.outcome import AfterFrame, StoppedError, nothing
from omni_mj.studies.run import chosen
from omni_mj.studies.sweep import cells, elsewhere, kept, shard
from omni_mj.studies.sweep.elsewhere import Workers, workers
from omni_mj.studies.sweep.grid import Axis, axes
from omni_mj.studies.sweep.plan import AT_ONCE, Job, Plan

if TYPE_CHECKING:
    import pyarrow as pa

ROWS = "rows.parquet"
BeforeShard = Callable[[Job], AfterFrame]


@dataclass(frozen=True)
class Sweep:
    """What came of a sweep.

    Attributes:
        plan: what was asked for.
        done: how many of its shards are.
        stopped: why it ended before its time, or None.
        folder: where it is.
    """

    plan: Plan
    done: int
    stopped: str | None
    folder: Path

    @property
    def complete(self) -> bool:
        """Whether all of it is there."""
        return self.done == len(self.plan.jobs)

    def rows(self) -> "pa.Table":
        """A line per robot that was simulated, by point, controller, seed and place; see `shard.run`."""
        whole = self.folder / ROWS
        return parquet.read(whole) if whole.is_file() else _gathered(self.plan, self.folder)

    def cells(self) -> list[dict[str, Any]]:
        """Failure rate and errors of each point and controller; see `cells.of`."""
        return cells.of(self.rows(), [each.name for each in self.plan.axes])


def sweep(
    scenario: Scenario | str,
    vary: Mapping[str, Iterable[Any]] | Sequence[Axis],
    controllers: Sequence[str | type[Controller]] | None = None,
    seeds: Iterable[int] | None = None,
    *,
    out: str | Path,
    at_once: int = AT_ONCE,
    jobs: int = 1,
    cluster: Any = None,
    keep: Iterable[str] = (),
    before_shard: BeforeShard = lambda job: nothing,
) -> Sweep:
    """Run a scenario under all combinations of settings, with all seeds and controllers.

    Args:
        scenario: all that is not varied; what it draws from distributions is drawn anew for each seed.
        vary: settings `section.field` -> values.
        controllers: names, `file.py:Class`, or classes derived from `Controller`. [the scenario's]
        seeds: of the random numbers, counting up, the same everywhere. [the scenario's]
        out: folder that a sweep is begun in, or gone on with if it is the same.
        at_once: robots that are simulated at once: memory grows with them, and not with the number of runs.
        jobs: processes of this machine that run shards side by side.
        cluster: address of a Dask scheduler, or a `distributed.Client`, on whose workers shards are run in their place.
        keep: of which robots of each controller the trajectories are kept: "worst:3", "median", "sample:10".
        before_shard: called with each shard; what it returns is called after each frame, and may raise `StoppedError`.
            Of shards that other processes run, both are called once, when they are done.

    Raises:
        OmniError: something is unknown or not allowed, what is asked for does not fit into memory, or another sweep is
            in the folder.
    """
    plan, wishes = Plan(chosen(scenario, controllers, seeds), axes(vary), at_once), [kept.wish(each) for each in keep]
    found = run(plan, out, jobs=jobs, cluster=cluster, before_shard=before_shard)
    if found.complete:
        kept.keep(found, wishes)
    return found


def run(
    plan: Plan,
    out: str | Path,
    *,
    jobs: int = 1,
    cluster: Any = None,
    before_shard: BeforeShard = lambda job: nothing,
) -> Sweep:
    """Run a plan, such as one of `sensitivity.plan`; see `sweep`."""
    folder, where = Path(out), workers(jobs, cluster)
    plan.check_memory(jobs)
    if (folder / "sweep.json").exists():
        _check_same(Plan.read(folder), plan, folder)
    else:
        folder.mkdir(parents=True, exist_ok=True)
        plan.save(folder)
    return carry_on(plan, folder, before_shard, where)


def resume(
    folder: str | Path, before_shard: BeforeShard = lambda job: nothing, *, jobs: int = 1, cluster: Any = None
) -> Sweep:
    """Go on with a sweep that was stopped or killed, anywhere.

    Raises:
        OmniError: there is none in the folder.
    """
    return carry_on(Plan.read(Path(folder)), Path(folder), before_shard, workers(jobs, cluster))


def carry_on(
    plan: Plan,
    folder: Path,
    before_shard: BeforeShard,
    where: Workers | None = None,
    check: Callable[[], None] = lambda: None,
) -> Sweep:
    """Run the shards that are not there yet; with the last one, gather them.

    Args:
        plan: of the sweep.
        folder: its own.
        before_shard: see `sweep`.
        where: they are run, if not here.
        check: called now and then while others run them; it may raise `StoppedError`.
    """
    stopped = None
    (folder / shard.FOLDER).mkdir(exist_ok=True)
    try:
        for job, table in _tables(plan, left(plan, folder), before_shard, where, check):
            shard.save(table, shard.file(folder, job))
    except StoppedError as error:
        stopped = error.reason
    done = len(plan.jobs) - len(left(plan, folder))
    if done == len(plan.jobs) and not (folder / ROWS).exists():
        shard.save(_gathered(plan, folder), folder / ROWS)
    found = Sweep(plan, done, stopped, folder)
    if done:
        summary = {"complete": found.complete, "shards": len(plan.jobs), "done": done, "cells": found.cells()}
        write(folder / "summary.json", json.dumps(summary, indent=1, allow_nan=False, default=int) + "\n")
    if found.complete:
        for job in plan.jobs:
            shard.file(folder, job).unlink(missing_ok=True)
        (folder / shard.FOLDER).rmdir()
    return found


def left(plan: Plan, folder: Path) -> list[Job]:
    """The shards that are still to be run."""
    return [] if (folder / ROWS).exists() else [job for job in plan.jobs if not shard.file(folder, job).exists()]


def _tables(
    plan: Plan, jobs: Sequence[Job], before_shard: BeforeShard, where: Workers | None, check: Callable[[], None]
) -> Iterator[tuple[Job, "pa.Table"]]:
    """The tables of shards, in the order in which they are done."""
    if where is None or not jobs:
        for job in jobs:
            yield job, shard.run(plan, job, before_shard(job))
        return
    with where as executor:
        for job, table in elsewhere.tables(plan, jobs, executor, check):
            yield job, table
            before_shard(job)(plan.frames - 1)


def _gathered(plan: Plan, folder: Path) -> "pa.Table":
    import pyarrow as pa

    there = [shard.file(folder, job) for job in plan.jobs if shard.file(folder, job).exists()]
    if not there:
        raise OmniError(f"nothing of the sweep in {folder} has been run yet")
    table = pa.concat_tables([parquet.read(each) for each in there], promote_options="permissive")
    names = {label: i for i, label in enumerate(plan.scenario.labels)}
    order = pa.array([names[each] for each in table["controller"].to_pylist()])
    keys = [(name, "ascending") for name in ("point", "order", "seed", "place")]
    return table.append_column("order", order).sort_by(keys).drop_columns("order")


def _check_same(known: Plan, plan: Plan, folder: Path) -> None:
    """See that a folder's sweep is this one, whatever the robots at once: shards are those of the one that began it."""
    if known.key != plan.key:
        raise OmniError(f"{folder} holds another sweep; name another --out, or go on with that: --resume {folder}")

"""Run a sweep shard by shard.

The rows of a shard are stored as soon as it is done, so a sweep that was stopped or killed can be
resumed.
"""

import json
import warnings
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow as pa

from omni_control.arguments import check_types
from omni_control.errors import OmniError
from omni_mj.config.plugins import ControllerSpec
from omni_mj.config.scenario import Scenario
from omni_mj.io import parquet
from omni_mj.io.atomic_files import check_folder, create_folder, lock_folder, write_json, write_text
from omni_mj.results.provenance import (
    check_unchanged,
    describe_options,
    save_provenance,
    sha256,
)
from omni_mj.studies.run_scenario import (
    StartProgress,
    StoppedError,
    no_progress,
    resolve_scenario,
)
from omni_mj.studies.sweep.sweep_plan import BATCH_SIZE, Shard, SweepPlan, check_axes
from omni_mj.studies.sweep.sweep_statistics import (
    rank_correlations,
    summarize_points,
    worst_runs,
)
from omni_mj.studies.sweep.workers import (
    dependencies,
    process_pool,
    run_shards,
    run_shards_on_workers,
)

STUDY, ROWS, SHARDS = "sweep", "rows.parquet", "shards"
ORIGIN = b"origin"  # key of a file's metadata: hash of everything that determines its rows


@dataclass(frozen=True)
class SweepResult:
    """Result of a complete or stopped sweep.

    Attributes:
        plan: Plan of the sweep.
        n_done: Number of shards that are done.
        stopped: Reason why it ended early, or None.
        folder: Folder of the sweep.
    """

    plan: SweepPlan
    n_done: int
    stopped: str | None
    folder: Path

    @property
    def complete(self) -> bool:
        """Whether all shards are done."""
        return self.n_done == len(self.plan.shards)

    def rows(self) -> pa.Table:
        """Return a row per robot, sorted by point, controller, seed and slot; see `run_shard`."""
        path = self.folder / ROWS
        return parquet.read_table(path) if path.is_file() else _merge_shards(self.plan, self.folder)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json."""
        return summarize_sweep(self.plan, self.rows(), self.n_done, self.folder)


def summarize_sweep(plan: SweepPlan, rows: pa.Table, n_done: int, folder: Path) -> dict[str, Any]:
    """Return the content of summary.json.

    Args:
        plan: Plan of the sweep.
        rows: Rows of all shards that are done.
        n_done: Number of these shards.
        folder: Folder of the sweep.
    """
    return {
        "complete": n_done == len(plan.shards),
        "n_shards": len(plan.shards),
        "n_done": n_done,
        "settings": plan.scenario.settings_to_dict(),
        "points": summarize_points(rows, list(plan.axes)),
        "correlations": rank_correlations(rows),
        "worst": worst_runs(rows, plan, folder),
    }


@check_types
def sweep(
    scenario: Scenario | str,
    vary: Mapping[str, Iterable[Any]],
    controllers: ControllerSpec | Sequence[ControllerSpec] | None = None,
    seeds: int | Iterable[int] | None = None,
    *,
    out: str | Path,
    batch_size: int = BATCH_SIZE,
    jobs: int = 1,
    **run_options: Any,
) -> SweepResult:
    """Run a scenario with all combinations of settings, seeds and controllers.

    Args:
        scenario: Scenario with all settings that do not vary. Settings with a distribution are
            drawn for each seed.
        vary: Settings `section.field` -> values; empty for a scenario with distributions.
        controllers: Names, `file.py:Class`, or classes derived from `Controller`. Default: the
            scenario's.
        seeds: Consecutive seeds, or a number of seeds that start at 0; the same at all points.
            Default: the scenario's.
        out: Folder of the sweep. If it holds shards of the same sweep, only the others are run.
        batch_size: Largest number of robots that are simulated together. Memory grows with it, not
            with the number of runs.
        jobs: Number of local processes.
        run_options: `executor` and `start_progress` of `run_sweep`.

    Raises:
        OmniError: A name is unknown or a value not valid, the sweep does not fit into memory,
            another program writes to the folder, or it holds another sweep or one of another
            version, processor, robot, model, controller or plant.
    """
    scenario, folder = resolve_scenario(scenario, controllers, seeds), Path(out)
    plan = SweepPlan(scenario, check_axes(vary.items()), int(batch_size))
    plan.check(jobs)
    create_folder(folder)
    with lock_folder(folder):
        return run_sweep(plan, folder, jobs=jobs, **run_options)


@check_types
def run_sweep(
    plan: SweepPlan,
    folder: Path,
    *,
    command: str | None = None,
    jobs: int = 1,
    executor: Executor | None = None,
    start_progress: StartProgress = no_progress,
) -> SweepResult:
    """Run the shards of a plan that are not stored in its folder yet.

    Args:
        plan: Plan of the sweep, which has been checked.
        folder: Folder of the sweep, which exists. The caller locks it.
        command: Command line, or None.
        jobs: Number of local processes.
        executor: Executor that runs shards instead, such as that of a Dask cluster.
        start_progress: Called with a title and the number of frames of all shards. It returns a
            function that is called with each frame's number and may raise `StoppedError`. If other
            processes run the shards, it is called a few times per second.

    Raises:
        OmniError: See `sweep`.
    """
    stopped = None
    _prepare_folder(plan, folder, command)
    expected = dependencies(plan)
    stored = stored_shards(plan, folder)
    remaining = sorted(set(plan.shards) - set(stored))
    after_frame = start_progress("sweep", plan.frames * len(remaining))
    n_done = len(stored)
    tasks = remaining if executor else plan.split_shards(remaining, jobs)
    n_processes = 1 if executor else min(jobs, len(tasks))
    if remaining and not executor and n_processes < jobs:
        warnings.warn(
            f"only {n_processes} of {jobs} processes run: a run with its controllers cannot be "
            "divided, nor can a shard with the backend jax",
            stacklevel=5,  # the caller of `sweep`
        )
    pool = process_pool(n_processes) if n_processes > 1 else nullcontext(executor)
    try:
        with pool as workers:
            if workers is None:
                shard_tables = run_shards(plan, remaining, after_frame)
            else:
                shard_tables = run_shards_on_workers(workers, plan, tasks, after_frame)
            for shard, rows in shard_tables:
                if dependencies(plan) != expected:
                    raise OmniError(
                        "a file of the robot, model, controller or plant was changed during the "
                        f"sweep; the completed shards in {folder} are of the former file"
                    )
                _write_rows(plan, [shard], rows, _shard_file(folder, shard))
                n_done += 1
    except StoppedError as error:
        stopped = str(error)
    result = SweepResult(plan, n_done, stopped, folder)
    _write_result(result)
    return result


def _prepare_folder(plan: SweepPlan, folder: Path, command: str | None) -> None:
    """Create the files that identify the sweep, or compare them if it is continued.

    Raises:
        OmniError: The folder holds another sweep, or one that cannot be continued here.
    """
    is_continued = bool(stored_shards(plan, folder))
    if is_continued:  # checked first, because settings that are computed depend on the processor
        check_unchanged(folder, STUDY, plan.recorded_scenarios)
    for name, text in plan.files.items():
        if not (folder / name).exists():
            write_text(folder / name, text)
        elif (folder / name).read_text(encoding="utf-8") != text:
            raise OmniError(f"{folder} holds another sweep, by its {name}; name another --out")
    if is_continued:
        _check_stored_rows(plan, folder)
    else:
        options = describe_options(plan.files)
        save_provenance(folder, STUDY, command, plan.recorded_scenarios, options)
    create_folder(folder / SHARDS)


def _write_result(result: SweepResult) -> None:
    """Write summary.json, and replace the shards by one table if all are done."""
    plan, folder = result.plan, result.folder
    check_folder(folder)
    if result.complete and not (folder / ROWS).exists():
        _write_rows(plan, plan.shards, _merge_shards(plan, folder), folder / ROWS)
    if result.n_done:
        write_json(folder / "summary.json", result.summary)
    if result.complete:
        for shard in plan.shards:
            _shard_file(folder, shard).unlink(missing_ok=True)
        (folder / SHARDS).rmdir()


def _write_rows(plan: SweepPlan, shards: Sequence[Shard], rows: pa.Table, path: Path) -> None:
    """Write the rows of shards with a hash of everything that determines them."""
    metadata = {ORIGIN: _hash_origin(plan, shards)}
    parquet.write_tables([rows.replace_schema_metadata(metadata)], path)


def _check_stored_rows(plan: SweepPlan, folder: Path) -> None:
    """Raise `OmniError` if a stored file holds rows of other runs than its name says."""
    contents = list_row_files(plan, folder)
    for path in [*folder.glob(ROWS), *folder.glob(f"{SHARDS}/*.parquet")]:
        metadata = parquet.read_table(path, ["point"]).schema.metadata or {}
        shards = contents.get(path)
        if shards is None or metadata.get(ORIGIN) != _hash_origin(plan, shards):
            raise OmniError(
                f"{path} holds rows of other runs, or of another sweep: delete it, and repeat the "
                "command"
            )


def list_row_files(plan: SweepPlan, folder: Path) -> dict[Path, list[Shard]]:
    """Return the shards in each file of rows that a sweep may have at some time."""
    files = {_shard_file(folder, shard): [shard] for shard in plan.shards}
    return files | {folder / ROWS: plan.shards}


def _hash_origin(plan: SweepPlan, shards: Sequence[Shard]) -> bytes:
    """Return a hash of everything that determines the rows of shards."""
    runs = [shard.runs for shard in shards]
    return sha256(json.dumps([plan.files, dependencies(plan), runs]).encode()).encode()


def stored_shards(plan: SweepPlan, folder: Path) -> list[Shard]:
    """Return the shards whose rows are stored in the folder."""
    is_complete = (folder / ROWS).exists()
    return [s for s in plan.shards if is_complete or _shard_file(folder, s).exists()]


def _merge_shards(plan: SweepPlan, folder: Path) -> pa.Table:
    """Return the rows of all stored shards in the order of `merge_rows`.

    Raises:
        OmniError: No shard is stored.
    """
    stored = stored_shards(plan, folder)
    if not stored:
        raise OmniError(f"nothing of the sweep in {folder} has been run yet")
    return merge_rows(plan, [parquet.read_table(_shard_file(folder, shard)) for shard in stored])


def merge_rows(plan: SweepPlan, shard_rows: Sequence[pa.Table]) -> pa.Table:
    """Return the rows of shards, sorted by point, controller, seed and slot."""
    rows = pa.concat_tables(shard_rows, promote_options="permissive")
    labels = plan.scenario.labels
    order = pa.array([labels.index(label) for label in rows["controller"].to_pylist()])
    keys = [(name, "ascending") for name in ("point", "order", "seed", "slot")]
    return rows.append_column("order", order).sort_by(keys).drop_columns("order")


def _shard_file(folder: Path, shard: Shard) -> Path:
    return folder / SHARDS / f"{shard.number:06d}.parquet"

"""Run shards in this process, in others, or on a Dask cluster. Only the caller writes files."""

import multiprocessing
import os
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace
from operator import attrgetter
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any

import numpy as np
import pyarrow as pa

from omni_control.errors import OmniError
from omni_control.install_hints import describe_installation
from omni_mj.config.rows import build_rows
from omni_mj.results.arithmetic import describe_arithmetic
from omni_mj.results.metrics import row_metrics
from omni_mj.results.provenance import describe_scenarios, sha256, source_digest
from omni_mj.results.result import list_row_columns
from omni_mj.results.summary import package_versions
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies.run_scenario import AfterFrame, ignore_frame, quiet_mujoco
from omni_mj.studies.sweep.sweep_plan import Shard, SweepPlan

POLL_S = 0.2  # interval of calls to `after_frame`
SCHEDULER_TIMEOUT_S = 10.0


def run_shards(
    plan: SweepPlan, shards: Sequence[Shard], after_frame: AfterFrame
) -> Iterator[tuple[Shard, pa.Table]]:
    """Run shards in this process, and yield each shard's table as soon as it is done.

    Args:
        plan: Plan of the sweep.
        shards: Shards to run.
        after_frame: Called with the number of each frame, counted over all shards. Its exceptions
            end the iteration.
    """
    for i, shard in enumerate(shards):
        yield shard, run_shard(plan, shard, _count_from(i * plan.frames, after_frame))


def _count_from(start: int, after_frame: AfterFrame) -> AfterFrame:
    """Return a callback that adds a number to each frame's number."""
    return lambda frame: after_frame(start + frame)


def run_shard(plan: SweepPlan, shard: Shard, after_frame: AfterFrame = ignore_frame) -> pa.Table:
    """Simulate a shard and compute the metrics of its rows.

    Args:
        plan: Plan of the sweep.
        shard: The shard.
        after_frame: Called with each frame's number. If it raises an exception, the shard is
            discarded.

    Returns:
        A row per robot: `point`, the settings that vary, `controller`, `seed`, `slot`,
        `failed_at_s`, `cause`, the settings that were drawn, and the numbers of
        `metrics.row_metrics`. Errors are infinite for a robot that failed.
    """
    simulation = create_simulation(plan, shard)
    log = simulation.run(after_frame)
    # The team refers to the simulation. This cycle would keep the log and double the memory.
    del simulation.team
    rows = simulation.rows
    rows_per_run = len(rows) // len(shard.runs)
    points = np.repeat([point for point, _ in shard.runs], rows_per_run).astype(np.int32)
    columns: dict[str, object] = {"point": points}
    for name in plan.axes:
        columns[name] = [plan.points[point][name] for point in points]
    columns |= list_row_columns(rows, simulation.failures)
    for name in sorted(set(plan.scenario.distributions) - set(plan.axes)):
        columns[name] = [attrgetter(name)(row.settings) for row in rows]
    return pa.table(columns | row_metrics(log, simulation.failures))


def create_simulation(plan: SweepPlan, shard: Shard) -> Simulation:
    """Return the simulation of a shard at its start, with a world for each run and controller.

    Raises:
        OmniError: A value that a seed draws is not valid.
    """
    points = dict.fromkeys(point for point, _ in shard.runs)
    scenarios = {point: plan.scenario_at(point) for point in points}
    rows, world_index = [], -1
    for point, seed in shard.runs:
        scenario = scenarios[point]
        for row in build_rows(scenario.labels, [seed], scenario.settings_for_seed, scenario.robot):
            world_index += row.slot == 0
            rows.append(replace(row, world_index=world_index))
    return Simulation(scenarios[shard.runs[0][0]], rows=rows)


def run_shards_on_workers(
    executor: Executor, plan: SweepPlan, tasks: Sequence[Shard], after_frame: AfterFrame
) -> Iterator[tuple[Shard, pa.Table]]:
    """Run shards in other processes and yield each shard's table as soon as it is done.

    Args:
        executor: Executor of the processes.
        plan: Plan of the sweep.
        tasks: Shards, or parts of shards in the order of their runs.
        after_frame: Called every `POLL_S` with the number of the last frame of the shards that are
            done. Its exceptions end the iteration.

    Raises:
        OmniError: A shard cannot be run, a process was killed, or a worker has other versions of
            the packages.
    """
    expected = dependencies(plan)
    done = SimpleQueue[Future[pa.Table]]()
    pending: dict[Future[pa.Table], Shard] = {}
    for task in tasks:
        future = executor.submit(_run_on_worker, plan, task, expected)
        pending[future] = task
        future.add_done_callback(done.put)
    rows_by_task: dict[Shard, pa.Table] = {}
    n_frames = len({task.number for task in tasks}) * plan.frames
    while pending:
        after_frame(n_frames * (len(tasks) - len(pending)) // len(tasks) - 1)
        try:
            future = done.get(timeout=POLL_S)
        except Empty:
            continue
        task = pending.pop(future)
        try:
            rows_by_task[task] = future.result()
        except BrokenProcessPool:
            after_frame(-1)  # a signal to all processes is the reason
            raise OmniError(
                "a process of --jobs ended, for lack of memory or for a reason given above; "
                "completed shards are saved: to resume, repeat the command with fewer --jobs"
            ) from None
        except OmniError:
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise OmniError(f"a worker could not run shard {task.number}: {reason}") from error
        siblings = [sibling for sibling in tasks if sibling.number == task.number]
        if all(sibling in rows_by_task for sibling in siblings):
            rows = [rows_by_task.pop(sibling) for sibling in siblings]
            yield plan.shards[task.number], pa.concat_tables(rows, promote_options="permissive")
    after_frame(n_frames - 1)


def _run_on_worker(plan: SweepPlan, shard: Shard, expected: dict[str, str]) -> pa.Table:
    """Run a shard if this worker has the expected versions of packages, source and files.

    Raises:
        OmniError: The worker has other versions.
    """
    actual = dependencies(plan)
    differences = [
        f"{name} {actual.get(name)}, not {version}"
        for name, version in expected.items()
        if actual.get(name) != version
    ]
    if differences:
        raise OmniError(
            "a worker has other versions than this program, or another processor, and may compute "
            "other numbers: "
            f"{'; '.join(differences)}"
        )
    return run_shard(plan, shard)


def dependencies(plan: SweepPlan) -> dict[str, str]:
    """Return versions, arithmetic and hashes of files that must be equal for equal results."""
    copies: dict[str, bytes] = {}
    describe_scenarios(plan.recorded_scenarios, copies)
    hashes = {name: sha256(data)[:12] for name, data in copies.items()}
    source = {"source": source_digest()[:12]}
    return package_versions() | source | describe_arithmetic() | hashes


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Provide an executor of the workers of a Dask scheduler at tcp://host:port.

    Raises:
        OmniError: Dask is not installed, no scheduler answers, or it has no workers.
    """
    try:
        import distributed
    except ModuleNotFoundError:
        raise OmniError(
            "--cluster needs the package distributed, which is not installed; install it with "
            f"{describe_installation('cluster')} on every machine"
        ) from None
    connect: Any = distributed.Client
    try:
        client = connect(address, timeout=SCHEDULER_TIMEOUT_S)
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise OmniError(f"no Dask scheduler answers at {address}: {reason}") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise OmniError(
                f"the scheduler at {address} has no workers: start some with `dask worker`"
            )
        yield client.get_executor(pure=False)


@contextmanager
def process_pool(count: int) -> Iterator[Executor]:
    """Provide an executor of local processes; an exception in the block terminates them."""
    previous = multiprocessing.active_children()
    # Forked processes would inherit locks of threads that do not exist in them.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, context, _initialize_process) as executor:
        try:
            # Processes inherit the mask, which leaves Ctrl-C to this one from their start.
            previous_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            for _ in range(count):
                executor.submit(int)  # starts a process
            signal.pthread_sigmask(signal.SIG_SETMASK, previous_mask)
            yield executor
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                if child not in previous:
                    child.terminate()
            raise


def _initialize_process() -> None:
    """Use one thread, leave warnings to the parent process, and end with it."""
    from omni_mj.plants import mujoco_plant

    warnings.simplefilter("ignore")
    Thread(target=_exit_after_parent, daemon=True).start()
    mujoco_plant.MIN_ROBOTS_FOR_THREADS = sys.maxsize
    quiet_mujoco()


def _exit_after_parent() -> None:
    """Wait for the end of the parent process, even if it was killed, and end this one."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)

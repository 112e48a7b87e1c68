"""Shards run in other processes, of this machine or a Dask cluster: tables come back, files are written here alone."""

import gc
import multiprocessing
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError
from omni_mj.measure.summary import versions
from omni_mj.provenance import here
from omni_mj.studies.sweep import shard
from omni_mj.studies.sweep.plan import Job, Plan

if TYPE_CHECKING:
    import pyarrow as pa

LOOK_S = 0.2  # between two looks at whether it shall stop
ANSWER_S = 10.0  # that a scheduler may take
Workers = AbstractContextManager[Executor]


def workers(jobs: int = 1, cluster: Any = None) -> Workers | None:
    """Where shards are run: processes of this machine, a cluster, or, if None, here.

    Entered, it gives an executor.

    Args:
        jobs: processes; 1 for this one alone.
        cluster: address of a Dask scheduler, or a `distributed.Client` of one.

    Raises:
        OmniError: both are given, or neither processes nor a cluster can be there.
    """
    if jobs < 1 or (cluster is not None and jobs > 1):
        raise OmniError(
            f"jobs must be at least 1, not {jobs}"
            if jobs < 1
            else "give jobs, which are processes of this machine, or a cluster"
        )
    if cluster is not None:
        return _cluster(cluster)
    return _processes(jobs) if jobs > 1 else None


def tables(
    plan: Plan, jobs: Sequence[Job], executor: Executor, check: Callable[[], None]
) -> Iterator[tuple[Job, "pa.Table"]]:
    """Have shards run, and give their tables, each as soon as it is there.

    Args:
        plan: of the sweep.
        jobs: its shards.
        executor: that of `workers`.
        check: called a few times a second; what it raises ends this.

    Raises:
        OmniError: a shard cannot be run, a process was killed, or a worker has other versions than are here.
    """
    expected = _same()
    waiting = {executor.submit(_run, plan, job, expected): job for job in jobs}
    while waiting:
        check()
        for future in wait(waiting, LOOK_S, FIRST_COMPLETED).done:
            job = waiting.pop(future)
            try:
                yield job, future.result()
            except BrokenProcessPool:
                raise OmniError(
                    "a process of --jobs was killed, perhaps for want of memory; what was done is kept: go on with"
                    " --resume, with fewer --jobs"
                ) from None
            except OmniError:
                raise
            except Exception as error:
                raise OmniError(
                    f"a worker could not run shard {job.number}: {type(error).__name__}: {error}"
                ) from error


def _run(plan: Plan, job: Job, expected: dict[str, str]) -> "pa.Table":
    """A shard's table; on a worker."""
    own = _same()
    differ = [
        f"{name} {own.get(name, 'missing')}, not {value}" for name, value in expected.items() if own.get(name) != value
    ]
    if differ:
        raise OmniError(f"a worker has other versions than are here, and may find other numbers: {'; '.join(differ)}")
    return shard.run(plan, job)


@cache
def _same() -> dict[str, str]:
    """What must be the same everywhere for the same numbers: versions, and the package's own source by its hash."""
    found = {name: value for name, value in versions().items() if name != "rerun-sdk"}
    return found | {f"source of {name}": value[:12] for name, value in here.source().items()}


@contextmanager
def _processes(count: int) -> Iterator[Executor]:
    before = multiprocessing.active_children()
    context = multiprocessing.get_context("spawn")  # forked ones would inherit threads, of which they know nothing
    with ProcessPoolExecutor(count, context, _begin) as executor:
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                if child not in before:
                    child.terminate()
            raise


def _begin() -> None:
    """Make a process one of several: a thread each, and Ctrl-C is for the one that began them."""
    from omni_mj.cli.console import quiet_mujoco
    from omni_mj.plants import mujoco

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    mujoco.THREADED = sys.maxsize
    quiet_mujoco()


@contextmanager
def _cluster(cluster: Any) -> Iterator[Executor]:
    try:
        from distributed import Client as Scheduler
    except ModuleNotFoundError:
        raise OmniError("a cluster needs the package distributed: pip install 'omni-mj[cluster]'") from None
    own = not isinstance(cluster, Scheduler)
    client = _connected(Scheduler, cluster) if own else cluster
    try:
        try:
            client.wait_for_workers(1, timeout=ANSWER_S)
        except TimeoutError:
            raise OmniError(f"the scheduler at {cluster} has no workers: start some with `dask worker`") from None
        yield client.get_executor(pure=False)
    finally:
        if own:
            client.close()


def _connected(connect: Any, address: str) -> Any:
    """A client of the scheduler at an address."""
    try:
        return connect(address, timeout=ANSWER_S)
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0]
    # Its finalizer waits for a lock that the start of another client holds, and must not run in the thread of that one.
    gc.collect()
    raise OmniError(f"no Dask scheduler answers at {address}: {reason}")

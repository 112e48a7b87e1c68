"""Shards run in other processes, of this machine or a Dask cluster: tables come back, files are written here alone."""

import gc
import multiprocessing
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from omni_control.errors import OmniError
from omni_mj.measure.summary import versions
from omni_mj.provenance.record import source_digest
from omni_mj.studies.sweep.plan import Job, Plan

if TYPE_CHECKING:
    import pyarrow as pa

LOOK_S = 0.2  # between two looks at whether it shall stop
ANSWER_S = 10.0  # that a scheduler may take
Shard = Callable[[Plan, Job], "pa.Table"]


def check_workers(jobs: int, cluster: Any) -> None:
    """Raise OmniError if shards cannot be run in so many processes of this machine, or on a cluster."""
    if jobs < 1:
        raise OmniError(f"jobs must be at least 1, not {jobs}")
    if cluster is not None and jobs > 1:
        raise OmniError("give jobs, which are processes of this machine, or a cluster")


def tables(
    n_processes: int, cluster: Any, shard: Shard, plan: Plan, jobs: Sequence[Job], check: Callable[[], None]
) -> "Iterator[tuple[Job, pa.Table]]":
    """Have shards run, and yield their tables, each as soon as it is there.

    Args:
        n_processes: Of this machine.
        cluster: Address of a Dask scheduler or a `distributed.Client` of one, in their place.
        shard: Runs one.
        plan: Of the sweep.
        jobs: Its shards.
        check: Called a few times a second; what it raises ends this.

    Raises:
        OmniError: A shard cannot be run, a process was killed, or a worker has other versions than are here.
    """
    with _processes(n_processes) if cluster is None else _workers(cluster) as executor:
        waiting = {executor.submit(_run, shard, plan, job, _dependencies()): job for job in jobs}
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
                    reason = f"{type(error).__name__}: {error}"
                    raise OmniError(f"a worker could not run shard {job.number}: {reason}") from error


def _run(shard: Shard, plan: Plan, job: Job, expected: dict[str, str]) -> "pa.Table":
    """Return a shard's table; on a worker."""
    present = _dependencies()
    differ = [f"{name} {present.get(name)}, not {v}" for name, v in expected.items() if present.get(name) != v]
    if differ:
        raise OmniError(f"a worker has other versions than are here, and may find other numbers: {'; '.join(differ)}")
    return shard(plan, job)


@cache
def _dependencies() -> dict[str, str]:
    """Return what must be the same everywhere for the same numbers: versions, and hashes of the package's source."""
    return versions() | {"source": source_digest()[:12]}


@contextmanager
def _processes(count: int) -> Iterator[Executor]:
    """Give an executor of processes of this machine, which end at once if it is left by an exception."""
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
def _workers(cluster: Any) -> Iterator[Executor]:
    """Give an executor of the workers of a Dask scheduler."""
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise OmniError("a cluster needs the package distributed: pip install 'omni-mj[cluster]'") from None
    client = cluster if isinstance(cluster, Client) else _client(Client, cluster)
    try:
        try:
            client.wait_for_workers(1, timeout=ANSWER_S)
        except TimeoutError:
            raise OmniError(f"the scheduler at {cluster} has no workers: start some with `dask worker`") from None
        yield client.get_executor(pure=False)
    finally:
        if client is not cluster:
            client.close()


def _client(connect: Any, address: str) -> Any:
    try:
        return connect(address, timeout=ANSWER_S)
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0]
    # Its finalizer waits for a lock that the start of another client holds, and must not run in the thread of that one.
    gc.collect()
    raise OmniError(f"no Dask scheduler answers at {address}: {reason}")

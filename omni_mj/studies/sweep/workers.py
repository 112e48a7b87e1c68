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


class Workers:
    """Where shards are run: processes of this machine, a cluster, or here.

    Args:
        jobs: Processes; 1 for this one alone.
        cluster: Address of a Dask scheduler, or a `distributed.Client` of one.

    Raises:
        OmniError: Both are given, or neither processes nor a cluster can be there.
    """

    def __init__(self, jobs: int = 1, cluster: Any = None) -> None:
        if jobs < 1:
            raise OmniError(f"jobs must be at least 1, not {jobs}")
        if cluster is not None and jobs > 1:
            raise OmniError("give jobs, which are processes of this machine, or a cluster")
        self._jobs, self._cluster = jobs, cluster
        self.here = cluster is None and jobs == 1

    @contextmanager
    def executor(self) -> Iterator[Executor]:
        """Give an executor that runs functions there."""
        if self._cluster is None:
            yield from _processes(self._jobs)
            return
        client, ours = _client(self._cluster)
        try:
            try:
                client.wait_for_workers(1, timeout=ANSWER_S)
            except TimeoutError:
                where = f"the scheduler at {self._cluster}"
                raise OmniError(f"{where} has no workers: start some with `dask worker`") from None
            yield client.get_executor(pure=False)
        finally:
            if ours:
                client.close()


def tables(
    where: Workers, shard: Shard, plan: Plan, jobs: Sequence[Job], check: Callable[[], None]
) -> "Iterator[tuple[Job, pa.Table]]":
    """Have shards run, and yield their tables, each as soon as it is there.

    Args:
        where: They are run.
        shard: Runs one.
        plan: Of the sweep.
        jobs: Its shards.
        check: Called a few times a second; what it raises ends this.

    Raises:
        OmniError: A shard cannot be run, a process was killed, or a worker has other versions than are here.
    """
    with where.executor() as executor:
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
    own = _dependencies()
    differ = [f"{name} {own.get(name, 'missing')}, not {v}" for name, v in expected.items() if own.get(name) != v]
    if differ:
        raise OmniError(f"a worker has other versions than are here, and may find other numbers: {'; '.join(differ)}")
    return shard(plan, job)


@cache
def _dependencies() -> dict[str, str]:
    """Return what must be the same everywhere for the same numbers: versions, and hashes of the package's source."""
    found = {name: value for name, value in versions().items() if name != "rerun-sdk"}
    return found | {"source": source_digest()[:12]}


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


def _client(cluster: Any) -> tuple[Any, bool]:
    """Return a client of a scheduler, and whether it was made here."""
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise OmniError("a cluster needs the package distributed: pip install 'omni-mj[cluster]'") from None
    if isinstance(cluster, Client):
        return cluster, False
    connect: Any = Client
    try:
        return connect(cluster, timeout=ANSWER_S), True
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0]
    # Its finalizer waits for a lock that the start of another client holds, and must not run in the thread of that one.
    gc.collect()
    raise OmniError(f"no Dask scheduler answers at {cluster}: {reason}")

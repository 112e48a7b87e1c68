"""Shards run side by side, on this machine or a Dask cluster: tables come back, files are written here alone."""

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
from omni_mj.results.provenance import source_digest
from omni_mj.results.summary import package_versions
from omni_mj.studies.sweep.sweep_plan import Shard, SweepPlan

if TYPE_CHECKING:
    import pyarrow as pa

LOOK_S = 0.2  # between two looks at whether it shall stop
ANSWER_S = 10.0  # that a scheduler may take
RunShard = Callable[[SweepPlan, Shard], "pa.Table"]


def tables(
    executor: Executor,
    shard: RunShard,
    plan: SweepPlan,
    jobs: Sequence[Shard],
    check: Callable[[], None],
) -> "Iterator[tuple[Shard, pa.Table]]":
    """Have shards run, and yield their tables, each as soon as it is there.

    Args:
        executor: Of processes that run them, here or elsewhere.
        shard: Runs one.
        plan: Of the sweep.
        jobs: Its shards.
        check: Called a few times a second; what it raises ends this.

    Raises:
        OmniError: A shard cannot be run, a process was killed, or a worker has other versions than
            are here.
    """
    waiting = {executor.submit(_run, shard, plan, job, dependencies()): job for job in jobs}
    while waiting:
        check()
        for future in wait(waiting, LOOK_S, FIRST_COMPLETED).done:
            job = waiting.pop(future)
            try:
                yield job, future.result()
            except BrokenProcessPool:
                raise OmniError(
                    "a process of --jobs was killed, perhaps for want of memory; what was done is kept: go on with"
                    " the same command and fewer --jobs"
                ) from None
            except OmniError:
                raise
            except Exception as error:
                reason = f"{type(error).__name__}: {error}"
                raise OmniError(f"a worker could not run shard {job.number}: {reason}") from error


def _run(shard: RunShard, plan: SweepPlan, job: Shard, expected: dict[str, str]) -> "pa.Table":
    """Return a shard's table; on a worker."""
    present = dependencies()
    differ = [
        f"{name} {present.get(name)}, not {v}"
        for name, v in expected.items()
        if present.get(name) != v
    ]
    if differ:
        raise OmniError(
            f"a worker has other versions than are here, and may find other numbers: {'; '.join(differ)}"
        )
    return shard(plan, job)


@cache
def dependencies() -> dict[str, str]:
    """Return what must be the same everywhere for the same numbers: versions, and the hash of the package's source."""
    return package_versions() | {"source": source_digest()[:12]}


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Give an executor of the workers of a Dask scheduler, tcp://host:port.

    Raises:
        OmniError: Dask is not installed, no scheduler answers, or it has no workers.
    """
    try:
        import distributed
    except ModuleNotFoundError:
        raise OmniError(
            "--cluster needs the package distributed: pip install 'omni-mj[cluster]'"
        ) from None
    connect: Any = distributed.Client
    try:
        client = connect(address, timeout=ANSWER_S)
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
def processes(count: int) -> Iterator[Executor]:
    """Give an executor of processes of this machine, which end at once if it is left by an exception."""
    before = multiprocessing.active_children()
    context = multiprocessing.get_context(
        "spawn"
    )  # forked ones would inherit threads, of which they know nothing
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
    mujoco.MIN_ROBOTS_FOR_THREADS = sys.maxsize
    quiet_mujoco()

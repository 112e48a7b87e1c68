"""Processes of this machine that run shards side by side: tables come back, files are written here alone."""

import multiprocessing
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TYPE_CHECKING

from omni_control.errors import OmniError
from omni_mj.studies.sweep.plan import Job, Plan

if TYPE_CHECKING:
    import pyarrow as pa

LOOK_S = 0.2  # between two looks at whether it shall stop
Shard = Callable[[Plan, Job], "pa.Table"]


def tables(
    executor: Executor, shard: Shard, plan: Plan, jobs: Sequence[Job], check: Callable[[], None]
) -> "Iterator[tuple[Job, pa.Table]]":
    """Have shards run, and yield their tables, each as soon as it is there.

    Args:
        executor: Of processes that run them.
        shard: Runs one.
        plan: Of the sweep.
        jobs: Its shards.
        check: Called a few times a second; what it raises ends this.

    Raises:
        OmniError: A shard cannot be run, or a process was killed.
    """
    waiting = {executor.submit(shard, plan, job): job for job in jobs}
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


@contextmanager
def processes(count: int) -> Iterator[Executor]:
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

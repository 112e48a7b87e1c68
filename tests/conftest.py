"""Settings of all tests: number of processes, garbage collection, hypothesis."""

import gc
import os
import signal
import sys

# Every process imports all tests. Cache their compiled code, even if the environment forbids it.
# pytest compiles hypothesis too, which is a plugin.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

from hypothesis import settings  # noqa: E402

# A job in the background ignores these signals, and so would programs that tests start. A handler
# that does nothing is not inherited.
for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
    if signal.getsignal(number) == signal.SIG_IGN:
        signal.signal(number, lambda *_: None)

# The same examples in each run. No deadline, because times depend on the load of the computer.
settings.register_profile("laws", deadline=None, max_examples=30, derandomize=True)
settings.load_profile("laws")


def pytest_collection() -> None:
    """Switch garbage collection off while tests are imported, since imported objects stay."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.set_threshold(10_000)  # most objects are small arrays, which have no cycles
    gc.enable()


def pytest_xdist_auto_num_workers() -> int:
    """Use 1.5 processes per core, because tests of live drives often wait for a clock."""
    cores = len(os.sched_getaffinity(0))
    return cores + (cores + 1) // 2

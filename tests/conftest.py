"""What holds of all tests: how many processes they run in, what those share, and that no example is too slow."""

import gc
import os
import sys

from hypothesis import settings

# Each process imports all tests, which are rewritten and compiled before: once, whatever the
# environment wants.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# The same examples in each run; no deadline, as time says how busy a computer is.
settings.register_profile("laws", deadline=None, max_examples=30, derandomize=True)
settings.load_profile("laws")


def pytest_collection() -> None:
    """What is imported stays until the end: that it is no garbage need not be found out again and again."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.set_threshold(
        10_000
    )  # rather than a few hundred objects, most of which are small arrays' and no cycles
    gc.enable()


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores for every two: tests of what is live wait for a clock as often as they reckon."""
    cores = os.cpu_count() or 1
    return cores + (cores + 1) // 2

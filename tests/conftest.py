"""What holds of all tests: how many processes they run in, and that no example is too slow."""

import os

from hypothesis import settings

settings.register_profile("patient", deadline=None)  # time says how busy a computer is
settings.load_profile("patient")


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores for every two: tests of what is live wait for a clock as often as they reckon."""
    cores = os.cpu_count() or 1
    return cores + (cores + 1) // 2

"""How many processes the tests run in, where `-n auto` leaves it open."""

import os


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores for every two: tests of what is live wait for a clock as often as they reckon."""
    cores = os.cpu_count() or 1
    return cores + (cores + 1) // 2

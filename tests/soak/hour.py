"""A long time of simulation in which memory does not grow."""

import os
import random
import time
from collections.abc import Iterator
from pathlib import Path

import laws
import numpy as np
from moments import Found
from programs import ANY_PORTS, Fork

MB = 1_000_000
EVERY_S = 0.5
MOST_MB = 3.0  # that memory may grow from the first half to the second: some pages more or less


def hour(rng: random.Random, count: int, folder: Path) -> Iterator[Found]:
    """Minutes of simulated time, as many as are asked for, served and recorded."""
    words = ["serve", *ANY_PORTS, "--set", "wheels.model=two-rollers", "--speed", "1000", "--for", str(60 * count)]
    fork = Fork([*words, "--quiet", "--out", str(folder / "hour")])
    held = []
    while not fork.ended():
        held.append(_held_mb(fork.pid))
        time.sleep(EVERY_S)
    done = fork.wait()
    first, second = np.array_split(np.array(held[len(held) // 5 :]), 2)  # without the start, when all is made
    grown = float(np.median(second) - np.median(first))
    wrong = laws.of_program(done.code, done.err, 0)
    wrong += [f"memory grew by {grown:.1f} MB from the first half to the second"] * (grown > MOST_MB)
    yield f"{count} min: {np.median(first):.0f} MB, later {grown:+.1f} MB, at most {max(held):.0f} MB", wrong


def _held_mb(pid: int) -> float:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / MB
    except (OSError, IndexError):
        return 0.0

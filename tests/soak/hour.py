"""An hour of simulated time in which memory does not grow."""

import random
from collections.abc import Iterator
from pathlib import Path


def hour(rng: random.Random, count: int, folder: Path) -> Iterator[tuple[str, list[str]]]:
    yield from ()

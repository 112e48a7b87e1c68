"""What a run will take, before it takes it: memory, which may end the program, and time."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path

from omni_control.errors import OmniError
from omni_mj.scenarios import references
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ

FRAME_BYTES = 1200  # of a robot-frame in the log, with what is made of it to measure, and its reference
# Robots times simulated seconds per second of one core, about (docs/performance.md); the kinematic plant's are numpy's.
PACES = {"kinematic": 300.0, "two-rollers": 35.0, "rollers": 18.0}
FROM_ROBOTS = 16  # in a batch, more cores than one are used
TOLD_B, TOLD_S = 2e9, 1200.0  # from where on a user is told


@dataclass(frozen=True)
class Cost:
    """What a run takes, about.

    Attributes:
        robots: rows.
        frames: of each.
        memory_b: bytes.
        time_s: on this computer.
    """

    robots: int
    frames: int
    memory_b: float
    time_s: float

    def __str__(self) -> str:
        """In words."""
        memory, time = f"{self.memory_b / 1e9:.2g} GB of memory", duration(self.time_s)
        return f"{self.robots} robots of {self.frames} frames take about {memory} and {time}"

    @property
    def big(self) -> bool:
        """Whether a user should know before."""
        return self.memory_b > TOLD_B or self.time_s > TOLD_S


def duration(seconds: float) -> str:
    """Return a duration as text, in seconds, minutes or hours."""
    units = ((120, 1, ".0f", "s"), (7200, 60, ".0f", "min"), (inf, 3600, ".1f", "h"))
    return next(f"{seconds / size:{digits}} {unit}" for most, size, digits, unit in units if seconds < most)


def estimate(scenario: Scenario, seeds: int | None = None) -> Cost:
    """What a scenario takes with all its controllers.

    Args:
        scenario: what is run.
        seeds: at a time. [the scenario's]
    """
    settings = scenario.settings
    robots = (seeds or scenario.seeds) * len(scenario.controllers) * len(settings.world.places)
    frames = references.timed(settings).frames
    pace = PACES.get(scenario.plant, PACES[settings.wheels.model if settings.wheels.model in PACES else "rollers"])
    cores = _cores() if robots >= FROM_ROBOTS else 1
    return Cost(
        robots,
        frames,
        FRAME_BYTES * robots * frames,
        robots * frames / FRAME_RATE_HZ / pace / cores,
    )


def check(costs: Sequence[Cost]) -> None:
    """See that each of several runs, one after the other, fits into this computer's memory.

    Raises:
        OmniError: one does not.
    """
    free = free_b()
    for cost in costs:
        if free is not None and cost.memory_b > free:
            raise OmniError(
                f"{cost}, but {free / 1e9:.2g} GB of memory are free; run fewer seeds at a time, or fewer controllers, "
                "or something shorter"
            )


def free_b() -> float | None:
    """How many bytes of memory are free for programs; None where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        found = {name: float(value.split()[0]) * 1024 for name, _, value in (line.partition(":") for line in lines)}
        return found["MemAvailable"]
    except (OSError, KeyError, ValueError, IndexError):
        return None


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

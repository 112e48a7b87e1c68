"""Bench of the loop: short runs, and their logs as a grid of controllers and seeds."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_mj.config import scenario
from omni_mj.config.rows import Row
from omni_mj.simulation.log import Log
from omni_mj.simulation.simulation import Simulation

FRAME_S = 1 / 60
FAST = (
    "physics.backend=numpy",
    "wheels.model=two-rollers",
)  # what the loop has to do with wheels needs no others
SHORT = ("reference.waypoints=[[0,0],[0.5,0]]", "reference.settle_s=0.2")
# Equation 7 without doubt: no noise, a plant that does as told, limits out of the way.
IDEAL = (
    "vision.position_noise_m=0",
    "vision.heading_noise_rad=0",
    "vision.miss_probability=0",
    "kinematic.alpha_low=1",
    "kinematic.alpha_high=1",
    "control.max_acceleration_m_s2=1000",
)
PLANTS = ("kinematic", "mujoco")
DISTURBED = ("disturbance.velocity_m_s=0.1", "disturbance.force_n=10")
FLC, COMPENSATED = 0, 1  # of the default controllers


class Grid:
    """A log whose rows are all seeds of all controllers: channels (frames, controllers, seeds, columns)."""

    def __init__(self, log: Log) -> None:
        self.log, self.controllers, self.seeds, self.length = (
            log,
            log.controllers,
            log.seeds,
            log.length,
        )
        self.time = log.time

    def channel(self, name: str) -> NDArray:
        data = self.log.channel(name)
        return data.reshape(len(data), len(self.controllers), len(self.seeds), data.shape[-1])


def simulation(
    plant: str,
    overrides: tuple[str, ...] = (),
    controllers: tuple[str, ...] = ("flc", "comp-flc"),
    seed: int = 0,
    seeds: int = 1,
    name: str = "rect",
    route: tuple[str, ...] = SHORT,
) -> Simulation:
    if plant == "mujoco":
        overrides = (*FAST, *overrides)
    head = {"plant": plant, "controllers": controllers, "seed": seed, "seeds": seeds}
    return Simulation(scenario.load_with_overrides(name, route + overrides, head))


@cache
def run(*what: Any, **more: Any) -> Grid:
    """What came of `simulation`, which takes the same, run once for all who ask."""
    return finished(simulation(*what, **more))


def batch(
    cases: Sequence[tuple[str, ...]],
    controllers: Sequence[str],
    seeds: Sequence[int],
    route: tuple[str, ...] = SHORT,
) -> Simulation:
    """All cases on the kinematic plant at once, which costs little more than one: a row is what it is alone.

    Its rows are all seeds of all controllers of all cases.
    """
    sets = "physics.backend=numpy", *route
    chosen = [
        scenario.load_with_overrides("rect", sets + case, {"plant": "kinematic"}) for case in cases
    ]
    each = [(c, name, seed) for c in chosen for name in controllers for seed in seeds]
    rows = [Row(i, 0, name, seed, c.settings, c.robot) for i, (c, name, seed) in enumerate(each)]
    return Simulation(chosen[0], controllers, rows=rows)


def finished(
    simulated: Simulation, after_frame: Callable[[int], None] = lambda frame: None
) -> Grid:
    """Run to the end; no row may fail."""
    return Grid(whole(simulated, after_frame))


def whole(simulated: Simulation, after_frame: Callable[[int], None] = lambda frame: None) -> Log:
    """As above, all rows in a line."""
    log = simulated.run(after_frame)
    assert not simulated.failures, simulated.failures[0]
    return log


def ages(command: NDArray, applied: NDArray) -> NDArray:
    """Frames since what is applied was commanded (frames, a, b), of both (frames, a, b, 3); k + 1 for nothing in k."""
    sent = np.concatenate(
        [np.zeros_like(command[:1]), command]
    )  # 0 is what is applied before anything arrives
    same = (sent[None] == applied[:, None]).all(-1)
    assert (same.sum(1) == 1).all(), "noisy commands, no two of which are equal"
    return np.arange(1, len(command) + 1)[:, None, None] - same.argmax(1)


def variants(
    plant: str, changes: Sequence[dict[str, Any]], labels: Sequence[str], route: tuple[str, ...]
) -> Simulation:
    """Return a simulation with a row for each change of the settings, the labels in turn, and other seeds."""
    chosen = scenario.load_with_overrides(
        "rect", route, {"plant": plant, "controllers": tuple(labels)}
    )
    settings = [chosen.settings.replace(**change) for change in changes]
    rows = [
        Row(i, 0, labels[i % len(labels)], 5 + i // 3, own, chosen.robot)
        for i, own in enumerate(settings)
    ]
    return Simulation(chosen, rows=rows)


def alone(simulated: Simulation, row: int) -> Simulation:
    """Return a simulation of one of the rows by itself."""
    own = simulated.rows[row]
    return Simulation(simulated.scenario, [own.controller], rows=[replace(own, world=0)])


def assert_rows_equal(log: Log, row: int, other: Log, other_row: int) -> None:
    """Check every frame that both recorded, to the last bit."""
    assert log.lengths[row] == other.lengths[other_row]
    frames = slice(log.lengths[row])
    for name in log.columns.keys() & other.columns.keys():
        one, two = log.channel(name)[frames, row], other.channel(name)[frames, other_row]
        np.testing.assert_array_equal(one, two, err_msg=name)

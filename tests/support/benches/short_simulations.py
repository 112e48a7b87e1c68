"""Short simulations for tests, and logs as grids of controllers and seeds."""

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
)  # the loop does not depend on the wheel model
SHORT = ("reference.waypoints=[[0,0],[0.5,0]]", "reference.settle_s=0.2")
# Equation 7 without noise, with alpha 1 and without limits.
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
    """Log with channels of shape (frames, controllers, seeds, columns)."""

    def __init__(self, log: Log) -> None:
        self.log, self.controllers, self.seeds, self.length = (
            log,
            log.controllers,
            log.seeds,
            log.length,
        )

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
def run(*arguments: Any, **named_arguments: Any) -> Grid:
    """Return the log of `simulation` with these arguments. Equal runs are cached."""
    return run_to_grid(simulation(*arguments, **named_arguments))


def batch(
    cases: Sequence[tuple[str, ...]],
    controllers: Sequence[str],
    seeds: Sequence[int],
    route: tuple[str, ...] = SHORT,
) -> Simulation:
    """Return a kinematic simulation whose rows are all seeds of all controllers of all cases.

    It costs little more than a single case.
    """
    sets = "physics.backend=numpy", *route
    chosen = [
        scenario.load_with_overrides("rect", sets + case, {"plant": "kinematic"}) for case in cases
    ]
    cases_of_rows = [(c, name, seed) for c in chosen for name in controllers for seed in seeds]
    rows = [
        Row(i, 0, name, seed, c.settings, c.robot)
        for i, (c, name, seed) in enumerate(cases_of_rows)
    ]
    return Simulation(chosen[0], controllers, rows=rows)


def run_to_grid(
    simulated: Simulation, after_frame: Callable[[int], None] = lambda frame: None
) -> Grid:
    """Run to the end and return the log as a grid; no row may fail."""
    return Grid(run_to_end(simulated, after_frame))


def run_to_end(
    simulated: Simulation, after_frame: Callable[[int], None] = lambda frame: None
) -> Log:
    """Run to the end and return the log; no row may fail."""
    log = simulated.run(after_frame)
    assert not simulated.failures, simulated.failures[0]
    return log


def command_ages(command: NDArray, applied: NDArray) -> NDArray:
    """Return the age of applied commands in frames, shape (frames, a, b); k + 1 for none in k."""
    sent = np.concatenate(
        [np.zeros_like(command[:1]), command]
    )  # 0 is what is applied before anything arrives
    same = (sent[None] == applied[:, None]).all(-1)
    assert (same.sum(1) == 1).all(), "noisy commands, no two of which are equal"
    return np.arange(1, len(command) + 1)[:, None, None] - same.argmax(1)


def variants(
    plant: str, changes: Sequence[dict[str, Any]], labels: Sequence[str], route: tuple[str, ...]
) -> Simulation:
    """Return a simulation with a row for each change of the settings, labels in turn."""
    chosen = scenario.load_with_overrides(
        "rect", route, {"plant": plant, "controllers": tuple(labels)}
    )
    settings = [chosen.settings.replace(**change) for change in changes]
    rows = [
        Row(i, 0, labels[i % len(labels)], 5 + i // 3, row_settings, chosen.robot)
        for i, row_settings in enumerate(settings)
    ]
    return Simulation(chosen, rows=rows)


def isolate_row(simulated: Simulation, row: int) -> Simulation:
    """Return a simulation of one of the rows by itself."""
    row_settings = simulated.rows[row]
    return Simulation(
        simulated.scenario, [row_settings.controller], rows=[replace(row_settings, world_index=0)]
    )


def assert_rows_equal(log: Log, row: int, other_log: Log, other_row: int) -> None:
    """Check that two rows have equal frames, to the last bit."""
    assert log.lengths[row] == other_log.lengths[other_row]
    frames = slice(log.lengths[row])
    for name in log.columns.keys() & other_log.columns.keys():
        values, other_values = (
            log.channel(name)[frames, row],
            other_log.channel(name)[frames, other_row],
        )
        np.testing.assert_array_equal(values, other_values, err_msg=name)

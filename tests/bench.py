"""Benchmark of `make bench`: the time of a run over that of its physics, also in bench.json.

Ratios are measured within one process.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from benches.plant import receive_at_once
from mujoco import MjData, mj_step
from mujoco.batch import Batch

from omni_mj.config import PERIOD_S, scenario
from omni_mj.config.scenario import Scenario
from omni_mj.mjcf import world_builder
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants import mujoco_plant
from omni_mj.plants.mujoco_plant import MujocoPlant
from omni_mj.results import provenance
from omni_mj.simulation.simulation import Simulation

ROUNDS = 3  # the fastest counts, because other work on the machine only adds time

DRIVE = ["reference.waypoints=[[0, 0], [1, 0.5]]", "reference.settle_s=0"]
SHORT = ["reference.waypoints=[[0, 0], [0.1, 0.05]]", "reference.settle_s=0"]  # for many robots
BACKENDS, SCOPES = ("numpy", "jax"), ("plant ", "loop ")
CASES = (1, "rollers"), (1, "two-rollers"), (16, "rollers"), (64, "rollers"), (64, "two-rollers")
PLANAR = 1, 64, 1024
OUT = Path("bench.json")
Prepare = Callable[[], Callable[[], object]]  # sets up a task and returns it


def measure_fastest(tasks: dict[str, Prepare], rounds: int) -> dict[str, float]:
    """Return CPU seconds of the fastest of some rounds of each task, in turn in each round."""
    times = dict.fromkeys(tasks, np.inf)
    for _ in range(rounds):
        for name, prepare in tasks.items():
            task = prepare()
            start = time.process_time()
            task()
            times[name] = min(times[name], time.process_time() - start)
    return times


class VoltageRecorder:
    """A batch that records the voltages of every step."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self.voltages: list[np.ndarray] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._batch, name)

    def step(self, ids: None = None) -> None:
        """Record, then step."""
        self.voltages.append(self._batch.ctrl.copy())
        self._batch.step(ids)


def report(robots: int, wheels: str) -> dict[str, float]:
    """Return CPU times of the plant, and of the whole loop, over those of bare steps of the model.

    The motion is the same, on one thread.
    """
    sets = [*(SHORT if robots >= 16 else DRIVE), f"wheels.model={wheels}"]
    head = {"seeds": robots, "controllers": ("comp-flc",)}
    chosen = scenario.load_with_overrides("rect", [*sets, "physics.backend=numpy"], head)
    recorded = Simulation(chosen)
    assert isinstance(recorded.plant, MujocoPlant)
    recorder = VoltageRecorder(recorded.plant._batch)
    recorded.plant._batch = recorder
    log = recorded.run()
    assert not recorded.failures
    commands = [receive_at_once(command) for command in log.channel("applied")]

    def prepare_bare() -> Callable[[], object]:
        step, ctrl = _make_single_robot(chosen) if robots == 1 else _make_batch(chosen, robots)

        def task() -> None:
            for voltage in recorder.voltages:
                ctrl[:] = voltage
                step()

        return task

    tasks = {"bare": prepare_bare, **_make_tasks({"numpy": chosen}, commands)}
    times = measure_fastest(tasks, ROUNDS if robots < 64 else 1)
    simulated = len(commands) * PERIOD_S * robots
    ratios = {name: used / times["bare"] for name, used in times.items() if name != "bare"}
    return {"bare simulated s per CPU-s": simulated / times["bare"], **ratios}


def report_planar(robots: int) -> dict[str, float]:
    """Return simulated seconds per CPU second of the plant `planar` and of the whole loop."""
    chosen = {
        backend: scenario.load_with_overrides(
            "rect",
            [*(SHORT if robots > 1 else DRIVE), f"physics.backend={backend}"],
            {"plant": "planar", "seeds": robots, "controllers": ("comp-flc",)},
        )
        for backend in BACKENDS
    }
    log = Simulation(chosen["numpy"]).run()
    commands = [receive_at_once(command) for command in log.channel("applied")]

    simulated = len(commands) * PERIOD_S * robots
    times = measure_fastest(_make_tasks(chosen, commands), ROUNDS)
    return {name: simulated / used for name, used in times.items()}


def _make_tasks(
    chosen: dict[str, Scenario], commands: Sequence[ReceivedCommand]
) -> dict[str, Prepare]:
    """Return tasks by name, for each backend: the plant alone under commands, and the loop."""
    tasks: dict[str, Prepare] = {}
    for backend, scenario_i in chosen.items():
        tasks |= {
            f"plant, {backend}": partial(_prepare_plant, scenario_i, commands),
            f"loop, {backend}": partial(_prepare_loop, scenario_i),
        }
    return tasks


def _prepare_plant(chosen: Scenario, commands: Sequence[ReceivedCommand]) -> Callable[[], object]:
    plant = Simulation(chosen).plant

    def task() -> None:
        for received in commands:
            plant.advance(received)

    return task


def _prepare_loop(chosen: Scenario) -> Callable[[], object]:
    return Simulation(chosen).run


def _make_single_robot(chosen: Scenario) -> tuple[Callable[[], object], np.ndarray]:
    """Return the step of a robot and its voltages, without the 7 % more time of a batch of one."""
    world = world_builder.build_world(chosen.settings)
    data = MjData(world.model)
    data.qpos[:] = world.rest_qpos
    return partial(mj_step, world.model, data), data.ctrl


def _make_batch(chosen: Scenario, robots: int) -> tuple[Callable[[], object], np.ndarray]:
    """Return the step of a batch of robots on one thread, and their voltages."""
    world = world_builder.build_world(chosen.settings)
    batch = Batch(world.model, robots, 1)
    batch.qpos[:] = world.rest_qpos
    return batch.step, batch.bind("ctrl")


def main() -> None:
    """Measure, print, and write bench.json."""
    mujoco_plant.MIN_ROBOTS_FOR_THREADS = sys.maxsize  # one thread
    results: dict[str, dict[str, float]] = {}

    def show(title: str, values: dict[str, float]) -> None:
        results[title] = values
        print(f"{title:24s}", *(f"{value:14.3g}" for value in values.values()), flush=True)

    print(
        "CPU time over that of bare steps of the same model, and robot-seconds of these per CPU-s"
    )
    print(f"{'robots, wheels':24s} {'bare':>14s}", *(f"{scope + 'numpy':>14s}" for scope in SCOPES))
    for robots, wheels in CASES:
        show(f"{robots}, {wheels}", report(robots, wheels))
    print("\nthe plant planar, robot-seconds simulated in a CPU-second")
    print(
        f"{'robots':24s}", *(f"{scope + backend:>14s}" for backend in BACKENDS for scope in SCOPES)
    )
    for robots in PLANAR:
        show(f"{robots}, planar", report_planar(robots))
    record = provenance.describe_environment() | {"cores": len(os.sched_getaffinity(0))}
    OUT.write_text(json.dumps(record | {"ratios": results}, indent=2) + "\n")
    print(f"\n{OUT}")


if __name__ == "__main__":
    main()

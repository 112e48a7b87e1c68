"""`make bench`: how much of a run's time is physics, as ratios taken within one process."""

import dataclasses
import os
import time
from collections.abc import Callable

import numpy as np
from mujoco.batch import Batch

from omni_mj import robot, scenario
from omni_mj.loop import Simulation

ROUNDS = 3  # the fastest of these counts: other work on the machine only ever adds time


def fastest(work: Callable[[], object]) -> float:
    """Seconds of the fastest of a few rounds."""
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def loop_against_bare_steps(seeds: int) -> None:
    """Compare the whole loop with stepping its commands' voltages through the same model and nothing else."""
    drive = ["reference.waypoints=[[0, 0], [1, 0.5]]", "reference.settle_s=0"]
    chosen = dataclasses.replace(scenario.load("rect", drive), seeds=seeds, controllers=("comp-flc",))

    def whole() -> Simulation:
        simulation = Simulation(chosen)
        simulation.run()
        return simulation

    voltages = whole().trajectory.channel("voltage")[:, 0]

    def bare() -> None:
        batch = Batch(robot.load_model(), seeds, min(seeds, os.cpu_count() or 1))
        ctrl = batch.bind("ctrl")
        for voltage in voltages:
            ctrl[:] = voltage
            batch.step(nstep=16)

    ratio = fastest(whole) / fastest(bare)
    print(f"{seeds:4d} robots: whole loop / bare steps of the same model {ratio:.2f}")


if __name__ == "__main__":
    np.seterr(all="raise")
    for n in (2, 16, 64):
        loop_against_bare_steps(n)

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


def fastest(prepare: Callable[[], Callable[[], object]]) -> float:
    """Seconds of the fastest of a few rounds of the work that `prepare` sets up."""
    times = []
    for _ in range(ROUNDS):
        work = prepare()
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def report(robots: int) -> None:
    """Compare the plant, and the whole loop around it, with stepping the same model and nothing else."""
    drive = ["reference.waypoints=[[0, 0], [1, 0.5]]", "reference.settle_s=0"]
    chosen = dataclasses.replace(scenario.load("rect", drive), seeds=robots, controllers=("comp-flc",))
    recorded = Simulation(chosen)
    recorded.run()
    commands, voltages = (recorded.trajectory.channel(name)[:, 0] for name in ("applied", "voltage"))
    nothing = np.full(robots, np.nan)

    def plant() -> Callable[[], object]:
        mujoco_plant = Simulation(chosen).plant

        def work() -> None:
            for frame, command in enumerate(commands):
                mujoco_plant.advance(frame, command, nothing)

        return work

    def bare(calls: int, steps: int) -> Callable[[], object]:
        model = robot.load_model()
        batch = Batch(model, robots, min(robots, os.cpu_count() or 1))
        batch.qpos[:] = robot.standing(model)[0]
        ctrl = batch.bind("ctrl")

        def work() -> None:
            for voltage in voltages:
                ctrl[:] = voltage
                for _ in range(calls):
                    batch.step(nstep=steps)

        return work

    single, joined = fastest(lambda: bare(16, 1)), fastest(lambda: bare(1, 16))
    driven, whole = fastest(plant), fastest(lambda: Simulation(chosen).run)
    print(f"{robots:6d} {driven / single:14.2f} {driven / joined:24.2f} {whole / joined:24.2f}", flush=True)


if __name__ == "__main__":
    print("time over that of bare steps of the same model")
    print("robots  plant / steps  plant / 16 steps at once  loop / 16 steps at once")
    for n in (2, 16, 64):
        report(n)

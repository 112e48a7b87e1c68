"""`make bench`: how much of a run's time is physics, as ratios taken within one process."""

import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from mujoco.batch import Batch

from omni_mj.link.radio import Received
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.scenarios import scenario
from omni_mj.simulate.simulation import Simulation
from omni_mj.worlds import build

ROUNDS = 3  # the fastest of these counts: other work on the machine only ever adds time

DRIVE = ["reference.waypoints=[[0, 0], [1, 0.5]]", "reference.settle_s=0"]
CONTROLLERS = "adaptive-comp-flc", "mpc"  # the costliest


def fastest(prepare: Callable[[], Callable[[], object]]) -> float:
    """Seconds of the fastest of a few rounds of the work that `prepare` sets up."""
    times = []
    for _ in range(ROUNDS):
        work = prepare()
        time.sleep(0.5)  # threads of the linear algebra that setting up used spin for a while on their cores
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


class Tape:
    """A batch that remembers the voltages of every step."""

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self.voltages: list[np.ndarray] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._batch, name)

    def step(self, ids: None = None) -> None:
        """Remember, then step."""
        self.voltages.append(self._batch.ctrl.copy())
        self._batch.step(ids)


def report(robots: int) -> None:
    """Compare the plant, and the whole loop around it, with the same motion by bare steps of the same model."""
    chosen = scenario.load("rect", DRIVE, {"seeds": robots, "controllers": ("comp-flc",)})
    taped = Simulation(chosen)
    assert isinstance(taped.plant, MujocoPlant)
    tape = Tape(taped.plant._batch)
    taped.plant._batch = tape
    log = taped.run()
    assert not taped.failures
    commands = log.channel("applied")

    def plant() -> Callable[[], object]:
        mujoco_plant = Simulation(chosen).plant

        def work() -> None:
            for command in commands:
                mujoco_plant.advance(Received.at_once(command))

        return work

    def bare() -> Callable[[], object]:
        one = build.world()
        batch = Batch(one.model, robots, min(robots, os.cpu_count() or 1))
        batch.qpos[:] = one.standing
        ctrl = batch.bind("ctrl")

        def work() -> None:
            for voltage in tape.voltages:
                ctrl[:] = voltage
                batch.step()

        return work

    steps, driven, whole = fastest(bare), fastest(plant), fastest(lambda: Simulation(chosen).run)
    print(f"{robots:6d} {driven / steps:10.2f} {whole / steps:10.2f}", flush=True)


class Clock:
    """Calls a function, and adds up the CPU time that it takes, s."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function, self.time = function, 0.0

    def __call__(self, *given: Any) -> Any:
        """Call it."""
        start = time.process_time()
        answer = self._function(*given)
        self.time += time.process_time() - start
        return answer


def report_controllers(robots: int) -> None:
    """Compare controllers with the bare steps of the robots that they drive, in the same run, both in CPU time."""
    shares = []
    for name in CONTROLLERS:
        chosen = scenario.load("rect", DRIVE, {"seeds": robots, "controllers": (name,)})
        times = []
        for _ in range(ROUNDS if robots == 1 else 1):  # many take long enough for other work to be averaged out
            simulation = Simulation(chosen)
            (controller,) = simulation.team.controllers
            assert isinstance(simulation.plant, MujocoPlant)
            tape = Tape(simulation.plant._batch)
            simulation.plant._batch = tape
            command, steps = Clock(controller.command), Clock(tape.step)
            controller.command, tape.step = command, steps  # type: ignore[method-assign]
            simulation.run()
            assert not simulation.failures
            times.append((command.time, steps.time))
        commanding, stepping = np.min(times, axis=0)
        frames = simulation.frame
        shares += [f"{commanding / stepping:20.3f}", f"{1e3 * commanding / frames:10.2f}"]
    print(f"{robots:6d}", *shares, flush=True)


if __name__ == "__main__":
    print("time over that of bare steps of the same model")
    print("robots      plant       loop")
    for n in (1, 2, 16, 64):
        report(n)
    print("\nCPU time of a controller over that of bare steps of the same robots, and ms per frame")
    print("robots", *(f"{name:>20s}         ms" for name in CONTROLLERS))
    for n in (1, 64):
        report_controllers(n)

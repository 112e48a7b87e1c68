"""`make bench`: how much of a run's time is physics, as ratios taken within one process; also in bench.json."""

import json
import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from mujoco import MjData, mj_step
from mujoco.batch import Batch

from omni_mj.config import scenario
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import PERIOD_S
from omni_mj.mjcf import world_builder
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants import mujoco
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.simulation.simulation import Simulation

ROUNDS = 3  # the fastest of these counts: other work on the machine only ever adds time
THREAD_ROUNDS, STEPPED = 12, 1600  # of so many steps of a robot

DRIVE = ["reference.waypoints=[[0, 0], [1, 0.5]]", "reference.settle_s=0"]
SHORT = ["reference.waypoints=[[0, 0], [0.1, 0.05]]", "reference.settle_s=0"]  # of many robots
CONTROLLERS = "adaptive-comp-flc", "mpc"  # the costliest
FRAMES = "p", "flc", "comp-flc", "adaptive-comp-flc", "lqr", "mpc"
BACKENDS, WHAT = ("numpy", "jax"), ("plant ", "loop ")
CASES = (1, "rollers"), (1, "two-rollers"), (16, "rollers"), (64, "rollers"), (64, "two-rollers")
PLANAR = 1, 64, 1024
OUT = Path("bench.json")


def fastest(works: dict[str, Callable[[], Callable[[], object]]], rounds: int) -> dict[str, float]:
    """CPU seconds of the fastest of a few rounds of each work that these set up, one after the other in each round."""
    times = dict.fromkeys(works, np.inf)
    for _ in range(rounds):
        for name, prepare in works.items():
            work = prepare()
            start = time.process_time()
            work()
            times[name] = min(times[name], time.process_time() - start)
    return times


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


def report(robots: int, wheels: str) -> dict[str, float]:
    """Compare the plant, and the whole loop around it, with the same motion by bare steps of the same model.

    All on one thread, in CPU time.
    """
    sets = [*(SHORT if robots >= 16 else DRIVE), f"wheels.model={wheels}"]
    chosen = {
        backend: scenario.load_with_overrides(
            "rect",
            [*sets, f"physics.backend={backend}"],
            {"seeds": robots, "controllers": ("comp-flc",)},
        )
        for backend in ("numpy",)
    }
    taped = Simulation(chosen["numpy"])
    assert isinstance(taped.plant, MujocoPlant)
    tape = Tape(taped.plant._batch)
    taped.plant._batch = tape
    log = taped.run()
    assert not taped.failures
    commands = [ReceivedCommand.without_delay(command) for command in log.channel("applied")]

    def bare() -> Callable[[], object]:
        step, ctrl = (
            _alone(chosen["numpy"]) if robots == 1 else _standing(chosen["numpy"], robots, 1)
        )

        def work() -> None:
            for voltage in tape.voltages:
                ctrl[:] = voltage
                step()

        return work

    times = fastest({"bare": bare, **_works(chosen, commands)}, ROUNDS if robots < 64 else 1)
    simulated = len(commands) * PERIOD_S * robots
    found = {name: used / times["bare"] for name, used in times.items() if name != "bare"}
    return {"bare simulated s per CPU-s": simulated / times["bare"], **found}


def report_planar(robots: int) -> dict[str, float]:
    """Simulated seconds per CPU second of the plant `planar`, firmware included, and of the loop around it."""
    chosen = {
        backend: scenario.load_with_overrides(
            "rect",
            [*(SHORT if robots > 1 else DRIVE), f"physics.backend={backend}"],
            {"plant": "planar", "seeds": robots, "controllers": ("comp-flc",)},
        )
        for backend in BACKENDS
    }
    log = Simulation(chosen["numpy"]).run()
    commands = [ReceivedCommand.without_delay(command) for command in log.channel("applied")]

    simulated = len(commands) * PERIOD_S * robots
    return {
        name: simulated / used for name, used in fastest(_works(chosen, commands), ROUNDS).items()
    }


def report_frames(controller: str) -> dict[str, float]:
    """CPU time of a frame of one robot through the whole loop on `planar`, ms, by each backend."""
    works, frames = {}, 0
    for backend in BACKENDS:
        head = {"plant": "planar", "seeds": 1, "controllers": (controller,)}
        chosen = scenario.load_with_overrides("rect", [*DRIVE, f"physics.backend={backend}"], head)
        frames = Simulation(chosen).run().length
        works[f"{backend}, ms"] = partial(_whole, chosen)
    return {name: 1e3 * used / frames for name, used in fastest(works, ROUNDS).items()}


def _works(
    chosen: dict[str, Scenario], commands: Sequence[ReceivedCommand]
) -> dict[str, Callable[[], Callable[[], object]]]:
    """What is timed, by name: the plant alone under these commands, and the loop around it, by each backend."""
    works: dict[str, Callable[[], Callable[[], object]]] = {}
    for backend, own in chosen.items():
        works |= {
            f"plant, {backend}": partial(_plant, own, commands),
            f"loop, {backend}": partial(_whole, own),
        }
    return works


def _plant(chosen: Scenario, commands: Sequence[ReceivedCommand]) -> Callable[[], object]:
    driven = Simulation(chosen).plant

    def work() -> None:
        for received in commands:
            driven.advance(received)

    return work


def _whole(chosen: Scenario) -> Callable[[], object]:
    return Simulation(chosen).run


def _alone(chosen: Scenario) -> tuple[Callable[[], object], np.ndarray]:
    """What steps a robot that stands, and the voltages that it is told: a batch of one takes 7 % longer."""
    one = world_builder.build_world(chosen.settings)
    data = MjData(one.model)
    data.qpos[:] = one.rest_qpos
    return partial(mj_step, one.model, data), data.ctrl


def _standing(
    chosen: Scenario, robots: int, threads: int
) -> tuple[Callable[[], object], np.ndarray]:
    """What steps a batch of standing robots, and the voltages that it is told."""
    one = world_builder.build_world(chosen.settings)
    batch = Batch(one.model, robots, threads)
    batch.qpos[:] = one.rest_qpos
    return batch.step, batch.bind("ctrl")


def report_threads(robots: int) -> dict[str, float]:
    """How many times faster several threads step the same robots, in wall time.

    Rounds are short and many, as somebody else's work on either core costs two threads more than
    one.
    """
    chosen, times = scenario.load_with_overrides("rect", DRIVE, {}), {}
    steps = max(1, STEPPED // robots)
    for _ in range(THREAD_ROUNDS):
        for threads in (1, 2):
            step, ctrl = _standing(chosen, robots, threads)
            ctrl[:] = 3.0
            step()  # starts the threads
            start = time.perf_counter()
            for _ in range(steps):
                step()
            times[threads] = min(times.get(threads, np.inf), time.perf_counter() - start)
    return {"two threads over one": times[1] / times[2]}


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


def report_controllers(robots: int) -> dict[str, float]:
    """Compare controllers with the bare steps of the robots that they drive, in the same run, both in CPU time."""
    found = {}
    for name in CONTROLLERS:
        chosen = scenario.load_with_overrides(
            "rect", DRIVE if robots == 1 else SHORT, {"seeds": robots, "controllers": (name,)}
        )
        times = []
        for _ in range(
            ROUNDS if robots == 1 else 1
        ):  # many take long enough for other work to be averaged out
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
        found |= {name: commanding / stepping, f"{name}, ms": 1e3 * commanding / simulation.frame}
    return found


def machine() -> dict[str, str | int | None]:
    """What this was measured on."""
    cpu = platform.processor()
    if (info := Path("/proc/cpuinfo")).exists():
        cpu = next(
            (
                line.split(":")[1].strip()
                for line in info.read_text().splitlines()
                if "model name" in line
            ),
            cpu,
        )
    versions = {name: version(name) for name in ("mujoco", "numpy", "jax")}
    python = platform.python_version()
    return {
        "cpu": cpu,
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": python,
        **versions,
    }


def main() -> None:
    """Measure, print, and write bench.json."""
    mujoco.MIN_ROBOTS_FOR_THREADS = sys.maxsize  # one thread
    results: dict[str, dict[str, float]] = {}

    def show(title: str, found: dict[str, float]) -> None:
        results[title] = found
        print(f"{title:24s}", *(f"{value:14.3g}" for value in found.values()), flush=True)

    print(
        "CPU time over that of bare steps of the same model, and how many robot-seconds these simulate in one"
    )
    print(f"{'robots, wheels':24s} {'bare':>14s}", *(f"{what + 'numpy':>14s}" for what in WHAT))
    for robots, wheels in CASES:
        show(f"{robots}, {wheels}", report(robots, wheels))
    print("\nthe plant planar, robot-seconds simulated in a CPU-second")
    print(f"{'robots':24s}", *(f"{what + backend:>14s}" for backend in BACKENDS for what in WHAT))
    for robots in PLANAR:
        show(f"{robots}, planar", report_planar(robots))
    print("\na frame of one robot on planar through the whole loop, ms of CPU time")
    print(f"{'controller':24s}", *(f"{backend:>14s}" for backend in BACKENDS))
    for name in FRAMES:
        show(f"{name}, planar", report_frames(name))
    print("\nbare steps on two threads, times as fast as on one (wall)")
    for robots in (2, 4, 8, 16, 64):
        show(f"{robots} on two threads", report_threads(robots))
    print("\nCPU time of a controller over that of bare steps of the same robots, and ms per frame")
    print(f"{'robots':24s}", *(f"{name:>14.14s}             ms" for name in CONTROLLERS))
    for robots in (1, 64):
        show(f"controllers of {robots}", report_controllers(robots))
    OUT.write_text(json.dumps({"machine": machine(), "ratios": results}, indent=2) + "\n")
    print(f"\n{OUT}")


if __name__ == "__main__":
    main()

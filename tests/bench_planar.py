"""How far the plant planar agrees with the full one: errors of controllers on the same scenarios, robots and noise.

    python tests/bench_planar.py [--scenario rect ...] [--robot tigers-v2016 ...] [--controller comp-flc ...]
                                 [--seeds 1] [--substeps 4] [--set SECTION.FIELD=VALUE ...] [--out FILE.json]
                                 [--full FILE.json ...]

By default all scenarios and robots, which takes an hour. A line for each scenario and robot: for each controller the
rms of its position error on the full plant in cm, and by how many per cent that on planar differs; with `--substeps`,
also by how many the full plant's own does when it takes so many steps in a cycle. `sliding` is the share of the time
for which a wheel on the full plant slips by more than creep lets it. Controllers that swap their places are named, with
the number of seeds with which the first is the better one on each plant. `--full` takes the errors on the full plant,
which changes less often and costs more, from files that `--out` has written with the same arguments; only what is in
them is compared.
"""

import argparse
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure import metrics
from omni_mj.robots import builtin as builtin_robots
from omni_mj.scenarios import scenario
from omni_mj.scenarios.library import builtin as builtin_scenarios
from omni_mj.simulate.simulation import Simulation

CONTROLLERS = "flc", "comp-flc", "adaptive-comp-flc", "lqr"


def driven(plant: str, name: str, given: argparse.Namespace, robot: str, substeps: int) -> tuple[Array, Array]:
    """rms of the position errors (controllers, seeds) in m, and shares of the time in which a wheel slides."""
    chosen = scenario.load(
        name,
        [*given.set, f"physics.substeps={substeps}"],
        {"plant": plant, "robot": robot, "controllers": given.controller, "seeds": given.seeds},
    )
    simulation = Simulation(chosen)
    log = simulation.run()
    for failure in simulation.failures:
        print(f"    {plant}: {failure}", flush=True)
    error = np.nan_to_num((log.channel("ref") - log.channel("pose"))[..., :2])
    rms = np.sqrt((error**2).sum(-1).mean(0))
    shape = len(given.controller), given.seeds
    return rms.reshape(shape), metrics.row_metrics(log)["sliding_share"].reshape(shape)


def swaps(full: Array, planar: Array, names: list[str]) -> list[str]:
    """Pairs of controllers of which another is the better one by the median over seeds; by how much, how often."""
    one, other = np.median(full, 1), np.median(planar, 1)
    return [
        f"{names[i]} and {names[j]} ({100 * (one[i] / one[j] - 1):+.1f} %, {100 * (other[i] / other[j] - 1):+.1f} %; "
        f"{(full[i] < full[j]).sum()} and {(planar[i] < planar[j]).sum()} of {full.shape[1]})"
        for i, j in itertools.combinations(range(len(names)), 2)
        if (one[i] - one[j]) * (other[i] - other[j]) < 0
    ]


def report(given: argparse.Namespace) -> list[dict[str, Any]]:
    """Compare, and print a line for each scenario and robot as soon as it is known."""
    print(f"{'':32s} sliding", *(f"{name:>24s}" for name in given.controller))
    found = []
    known = [entry for file in given.full for entry in json.loads(file.read_text())]
    runs = {(entry["scenario"], entry["robot"]): entry for entry in known}
    for name, robot in runs or itertools.product(given.scenario, given.robot):
        if runs:
            before = runs[name, robot]
            if before["controllers"] != given.controller or len(before["full"][0]) != given.seeds:
                raise SystemExit(f"{name}, {robot}: other controllers or another number of seeds in the file of --full")
            full, slides = np.array(before["full"]), np.array(before["sliding"])
        else:
            full, slides = driven("mujoco", name, given, robot, 1)
        planar, _ = driven("planar", name, given, robot, 1)
        entry = {"scenario": name, "robot": robot, "controllers": given.controller}
        entry |= {"full": full.tolist(), "planar": planar.tolist(), "sliding": slides.tolist()}
        differs = 100 * (np.median(planar, 1) / np.median(full, 1) - 1)
        cells = [
            f"{100 * rms:9.3f} {percent:+6.2f} %" for rms, percent in zip(np.median(full, 1), differs, strict=True)
        ]
        if given.substeps:
            finer, _ = driven("mujoco", name, given, robot, given.substeps)
            entry["finer"] = finer.tolist()
            own = 100 * (np.median(finer, 1) / np.median(full, 1) - 1)
            cells = [f"{cell} ({percent:+.2f})" for cell, percent in zip(cells, own, strict=True)]
        print(f"{name:16s}{robot:16s} {slides.mean():7.3f}", *(f"{cell:>24s}" for cell in cells), flush=True)
        for swap in swaps(full, planar, given.controller):
            print(f"    other places: {swap}", flush=True)
        found.append(entry)
        if given.out:
            given.out.write_text(json.dumps(found, indent=1))
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenario", nargs="+", default=list(builtin_scenarios()))
    parser.add_argument("--robot", nargs="+", default=list(builtin_robots()))
    parser.add_argument("--controller", nargs="+", default=list(CONTROLLERS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--substeps", type=int, default=0)
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--full", type=Path, nargs="+", default=[])
    report(parser.parse_args())

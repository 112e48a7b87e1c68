"""How far the plant planar agrees with the full one: errors of controllers on the same scenarios, robots and noise.

    python tests/bench_planar.py [--scenario rect ...] [--robot tigers-v2016 ...] [--controller
    comp-flc ...]
                                 [--seeds 20] [--finer] [--set SECTION.FIELD=VALUE ...] [--out
                                 FILE.jsonl] [--known]

By default all scenarios and robots, which takes an hour with JAX. Prints the table of docs/explanation/planar-plant.md. What
is compared is the rms of a robot's distance from its reference over a run. Both plants are given the same noise, so
that a seed's two errors are a pair: a difference is the mean of the logarithms of their ratios, as per cent, with half
its 95 % interval. Seeds are added five by five until it is known on which side of its bar a difference is, or there are
`--seeds`. The bar is 1 %; where wheels slide 5 %, or with `--finer` what the full plant itself moves by with four
substeps, of the first five seeds, which follows in brackets. Differences beyond their bar are bold. Then it is said how
many are, and which pairs of controllers are in another order on planar.

A run is a line of `--out`, and is not run again; `--known` prints what is there, and runs nothing. Runs on a plant that
has changed since are to be taken out of it.
"""

import argparse
import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config import scenario
from omni_mj.config.robot_files import find_builtin_robots as builtin_robots
from omni_mj.config.toml_files import find_builtin_scenarios as builtin_scenarios
from omni_mj.results.metrics import row_metrics
from omni_mj.results.statistics import confidence_interval
from omni_mj.simulation.simulation import Simulation

CONTROLLERS = "comp-flc", "adaptive-comp-flc", "lqr"
# At a time; with three controllers fewer robots than those for which the full plant takes several
# threads
SEEDS = 5
SLIDES = 0.01  # share of the frames in which a wheel slides, from which on a run is said to
HOLDING, SLIDING = 1.0, 5.0  # per cent by which plants may differ
FULL, PLANAR, FINER = "mujoco", "planar", "mujoco, four substeps"
Cell = tuple[str, str]  # scenario and robot
Run = tuple[str, str, str, str, int]  # and plant, controller, seed


@dataclass
class Runs:
    """What is known of runs: distance, rms in m, infinite for a robot that failed, and the share in which it slides.

    Args:
        overrides: of settings, in all of them.
        file: where they are kept.
    """

    overrides: Sequence[str]
    file: Path | None
    found: dict[Run, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.file and self.file.exists():
            for line in self.file.read_text("utf-8").splitlines():
                overrides, run, numbers = json.loads(line)
                if overrides == self.overrides:
                    self.found[tuple(run)] = tuple(numbers)

    def run(self, cell: Cell, plant: str, controllers: Iterable[str], seeds: Iterable[int]) -> None:
        """Run what is not known yet."""
        wanted = [
            (name, seed)
            for name in controllers
            for seed in seeds
            if (*cell, plant, name, seed) not in self.found
        ]
        if not wanted:
            return
        name, robot = cell
        substeps = ["physics.substeps=4"] if plant == FINER else []
        head = {"plant": PLANAR if plant == PLANAR else FULL, "robot": robot}
        chosen = scenario.load_with_overrides(name, [*self.overrides, *substeps], head)
        names, numbers = (list(dict.fromkeys(each)) for each in zip(*wanted, strict=True))
        simulation = Simulation(chosen, names, numbers)
        measured = row_metrics(simulation.run(), simulation.failures)
        for failure in simulation.failures:
            print(f"    {plant}: {failure}", flush=True)
        for row, distance, slides in zip(
            simulation.rows, measured["position_rms_m"], measured["sliding_fraction"], strict=True
        ):
            run, values = (*cell, plant, row.controller, row.seed), (float(distance), float(slides))
            self.found[run] = values
            if self.file:
                with self.file.open("a", encoding="utf-8") as out:
                    out.write(json.dumps([self.overrides, run, values]) + "\n")

    def seeds(self, cell: Cell, controller: str, *plants: str) -> list[int]:
        """Those known of all of these plants."""
        known = (
            {run[4] for run in self.found if run[:4] == (*cell, plant, controller)}
            for plant in plants
        )
        return sorted(set.intersection(*known))

    def values(self, cell: Cell, plant: str, controller: str, seeds: Iterable[int]) -> Array:
        """Distances, m, and shares of sliding, (2, seeds)."""
        return (
            np.array([self.found[(*cell, plant, controller, seed)] for seed in seeds])
            .reshape(-1, 2)
            .T
        )


@dataclass(frozen=True)
class Agreement:
    """Of a controller's errors with a robot in a scenario.

    Attributes:
        errors: on the full plant and on planar, m, (2, seeds).
        slides: share of the frames in which a wheel does on the full plant, mean over seeds.
        differs: by how many per cent planar's errors do, and half the interval of that.
        own: by how many the full plant's do with four substeps; not a number where none are known.
        failed: seeds with which one plant failed and the other did not.
    """

    errors: Array
    slides: float
    differs: tuple[float, float]
    own: tuple[float, float]
    failed: int

    @classmethod
    def of(cls, runs: Runs, cell: Cell, controller: str) -> "Agreement":
        """By what is known."""
        seeds = runs.seeds(cell, controller, FULL, PLANAR)
        (full, slides), (planar, _) = (
            runs.values(cell, plant, controller, seeds) for plant in (FULL, PLANAR)
        )
        both = np.isfinite(full) & np.isfinite(planar)
        again = runs.seeds(cell, controller, FULL, FINER)
        before, finer = (runs.values(cell, plant, controller, again)[0] for plant in (FULL, FINER))
        return cls(
            np.stack([full, planar])[:, both],
            float(np.nanmean(slides)),
            ratio(planar[both], full[both]),
            ratio(finer, before) if again else (np.nan, np.nan),
            int((np.isfinite(full) != np.isfinite(planar)).sum()),
        )

    @property
    def sliding(self) -> bool:
        """Whether wheels do."""
        return self.slides >= SLIDES

    @property
    def bar(self) -> float:
        """Per cent within which plants shall agree."""
        return max(SLIDING, abs(np.nan_to_num(self.own[0]))) if self.sliding else HOLDING

    @property
    def decided(self) -> bool:
        """Whether all of the difference's interval is on one side of its bar."""
        difference, half = self.differs
        return bool(abs(abs(difference) - self.bar) > half)

    def __str__(self) -> str:
        said = f"{100 * np.median(self.errors[0]):.3f}, {_said(self.differs)} %"
        if self.sliding and np.isfinite(self.own[0]):
            said += f" ({_said(self.own)})"
        if self.failed:
            said += f", {self.failed} fail on one plant"
        return f"**{said}**" if abs(self.differs[0]) > self.bar else said


def _said(difference: tuple[float, float]) -> str:
    """Per cent, with half the interval where there is one."""
    mean, half = difference
    return f"{round(mean, 1) + 0.0:+.1f}" + (f" ± {half:.1f}" if np.isfinite(half) else "")


def ratio(one: Array, other: Array) -> tuple[float, float]:
    """By how many per cent one is larger than the other, by the mean of logarithms, and half the interval of that."""
    mean, half = confidence_interval(np.log(one / other))
    return float(100 * np.expm1(mean)), float(100 * np.expm1(half))


def study(
    runs: Runs, cells: Sequence[Cell], controllers: Sequence[str], most: int, finer: bool
) -> None:
    """Run both plants: all cells with the first seeds, then those again of which more must be known."""
    for first, cell in itertools.product(range(0, most, SEEDS), cells):
        seeds = range(first, min(first + SEEDS, most))
        left = [
            name for name in controllers if not first or not Agreement.of(runs, cell, name).decided
        ]
        for plant in (FULL, PLANAR):
            runs.run(cell, plant, left, seeds)
        if finer and not first:
            runs.run(
                cell,
                FINER,
                [name for name in left if Agreement.of(runs, cell, name).sliding],
                seeds,
            )


def table(found: dict[Cell, dict[str, Agreement]], controllers: Sequence[str]) -> Iterator[str]:
    """Lines of markdown."""
    yield f"| robot | scenario | seeds | sliding | {' | '.join(f'`{name}`' for name in controllers)} |"
    yield "|---" * (4 + len(controllers)) + "|"
    for (name, robot), own in found.items():
        seeds = dict.fromkeys(str(each.errors.shape[1]) for each in own.values())
        slides = dict.fromkeys(f"{each.slides:.2f}" for each in own.values() if each.sliding)
        said = (str(own.get(each, "")) for each in controllers)
        yield f"| `{robot}` | `{name}` | {', '.join(seeds)} | {', '.join(slides)} | {' | '.join(said)} |"


def verdicts(runs: Runs, found: dict[Cell, dict[str, Agreement]]) -> Iterator[str]:
    """How many differences are within their bars, and which controllers are in another order."""
    for sliding, where in (False, "nothing slides"), (True, "wheels slide"):
        own = [each for of in found.values() for each in of.values() if each.sliding == sliding]
        beyond = [each for each in own if abs(each.differs[0]) > each.bar]
        within, sure = len(own) - len(beyond), sum(each.decided for each in beyond)
        yield f"Where {where}, {within} of {len(own)} differences are within; {sure} are beyond by no chance."
    pairs = [(cell, pair) for cell, of in found.items() for pair in itertools.combinations(of, 2)]
    orders = {
        (cell, pair): [_apart(runs, cell, pair, plant) for plant in (FULL, PLANAR)]
        for cell, pair in pairs
    }
    swapped = {
        pair: (full, planar) for pair, (full, planar) in orders.items() if full[0] * planar[0] < 0
    }
    yield f"Of {len(pairs)} pairs of controllers {len(swapped)} are in another order."
    for ((scene, robot), (one, other)), apart in swapped.items():
        said = " and ".join(f"{_said(difference)} %" for difference in apart)
        yield f"{scene}, {robot}: {one} against {other} {said}"


def _apart(runs: Runs, cell: Cell, pair: tuple[str, str], plant: str) -> tuple[float, float]:
    """By how many per cent one controller's error is larger than another's on a plant, with what both have known."""
    seeds = set.intersection(*(set(runs.seeds(cell, name, FULL, PLANAR)) for name in pair))
    one, other = (runs.values(cell, plant, name, sorted(seeds))[0] for name in pair)
    return ratio(one, other)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenario", nargs="+", default=list(builtin_scenarios()))
    parser.add_argument("--robot", nargs="+", default=list(builtin_robots()))
    parser.add_argument("--controller", nargs="+", default=list(CONTROLLERS))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--finer", action="store_true")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--known", action="store_true")
    given = parser.parse_args()
    runs = Runs(given.set, given.out)
    cells = [(name, robot) for robot in given.robot for name in given.scenario]
    if not given.known:
        study(runs, cells, given.controller, given.seeds, given.finer)
    found: dict[Cell, dict[str, Agreement]] = {}
    for cell, name in itertools.product(cells, given.controller):
        if runs.seeds(cell, name, FULL, PLANAR):
            found.setdefault(cell, {})[name] = Agreement.of(runs, cell, name)
    for line in (*table(found, given.controller), "", *verdicts(runs, found)):
        print(line)


if __name__ == "__main__":
    main()

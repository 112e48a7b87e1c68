"""Agreement of the plant planar with mujoco: errors of controllers in the same scenarios.

    python tests/bench_planar.py [--scenario rect ...] [--robot tigers-v2016 ...]
        [--controller comp-flc ...] [--seeds 20] [--finer] [--set SECTION.FIELD=VALUE ...]
        [--out FILE.jsonl] [--known]

The default is all scenarios and robots, which takes an hour with JAX. The output is the table of
docs/explanation/planar-plant.md. The compared error is the rms distance of a robot from its
reference over a run. Both plants have the same noise, so the two errors of a seed are a pair: a
difference is the mean of the logarithms of their ratios, in per cent, with half its 95 % interval.
Five seeds are added at a time, until the interval is on one side of the tolerance, or `--seeds`
have run. The tolerance is 1 %. Where wheels slide it is 5 %, or with `--finer` the change of the
plant mujoco with four substeps for the first five seeds, which is printed in brackets. Differences
beyond their tolerance are bold. Their number follows, and pairs of controllers whose order differs.

A run is a line of `--out`, and is not repeated; `--known` prints these lines, and runs nothing.
Delete the lines of a plant that has changed since.
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
from omni_mj.config.toml_files import find_builtin_files
from omni_mj.results.metrics import row_metrics
from omni_mj.results.seed_statistics import mean_confidence_interval
from omni_mj.simulation.simulation import Simulation

CONTROLLERS = "comp-flc", "adaptive-comp-flc", "lqr"
# Seeds at a time. With three controllers these are too few robots for several threads of mujoco.
SEED_BATCH = 5
MIN_SLIDING_FRACTION = 0.01  # fraction of frames with sliding wheels, from which a run slides
TOLERANCE, SLIDING_TOLERANCE = 1.0, 5.0  # per cent
FULL, PLANAR, FINER = "mujoco", "planar", "mujoco, four substeps"
Case = tuple[str, str]  # scenario and robot
Run = tuple[str, str, str, str, int]  # and plant, controller, seed


@dataclass
class Runs:
    """Results of runs: rms distance, m, inf for failed robots, and fraction of sliding frames.

    Args:
        overrides: Settings of all runs.
        file: File that stores them.
    """

    overrides: Sequence[str]
    file: Path | None
    results: dict[Run, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.file and self.file.exists():
            for line in self.file.read_text("utf-8").splitlines():
                overrides, run, values = json.loads(line)
                if overrides == self.overrides:
                    self.results[tuple(run)] = tuple(values)

    def run(self, case: Case, plant: str, controllers: Iterable[str], seeds: Iterable[int]) -> None:
        """Run controllers and seeds that have no result yet."""
        new_runs = [
            (name, seed)
            for name in controllers
            for seed in seeds
            if (*case, plant, name, seed) not in self.results
        ]
        if not new_runs:
            return
        name, robot = case
        substeps = ["physics.substeps=4"] if plant == FINER else []
        head = {"plant": PLANAR if plant == PLANAR else FULL, "robot": robot}
        chosen = scenario.load_with_overrides(name, [*self.overrides, *substeps], head)
        names, seeds = (list(dict.fromkeys(column)) for column in zip(*new_runs, strict=True))
        simulation = Simulation(chosen, names, seeds)
        measured = row_metrics(simulation.run(), simulation.failures)
        for failure in simulation.failures:
            print(f"    {plant}: {failure}", flush=True)
        for row, distance, slides in zip(
            simulation.rows, measured["position_rms_m"], measured["sliding_fraction"], strict=True
        ):
            run, values = (*case, plant, row.controller, row.seed), (float(distance), float(slides))
            self.results[run] = values
            if self.file:
                with self.file.open("a", encoding="utf-8") as out:
                    out.write(json.dumps([self.overrides, run, values]) + "\n")

    def seeds(self, case: Case, controller: str, *plants: str) -> list[int]:
        """Return the seeds with results of all of these plants."""
        known = (
            {run[4] for run in self.results if run[:4] == (*case, plant, controller)}
            for plant in plants
        )
        return sorted(set.intersection(*known))

    def values(self, case: Case, plant: str, controller: str, seeds: Iterable[int]) -> Array:
        """Return rms distances, m, and fractions of sliding frames, (2, seeds)."""
        return (
            np.array([self.results[(*case, plant, controller, seed)] for seed in seeds])
            .reshape(-1, 2)
            .T
        )


@dataclass(frozen=True)
class Agreement:
    """Agreement of a controller's errors with a robot in a scenario.

    Attributes:
        errors: On mujoco and planar, m, (2, seeds).
        sliding_fraction: Fraction of frames with sliding wheels on mujoco, mean over seeds.
        difference: Of planar's errors, per cent, and half its interval.
        finer_change: Of mujoco's errors with four substeps, as `difference`; NaN without results.
        n_failed: Seeds with which only one plant failed.
    """

    errors: Array
    sliding_fraction: float
    difference: tuple[float, float]
    finer_change: tuple[float, float]
    n_failed: int

    @classmethod
    def from_runs(cls, runs: Runs, case: Case, controller: str) -> "Agreement":
        """Return the agreement by the results so far."""
        seeds = runs.seeds(case, controller, FULL, PLANAR)
        (full, slides), (planar, _) = (
            runs.values(case, plant, controller, seeds) for plant in (FULL, PLANAR)
        )
        is_finite = np.isfinite(full) & np.isfinite(planar)
        finer_seeds = runs.seeds(case, controller, FULL, FINER)
        coarse, finer = (
            runs.values(case, plant, controller, finer_seeds)[0] for plant in (FULL, FINER)
        )
        return cls(
            np.stack([full, planar])[:, is_finite],
            float(np.nanmean(slides)),
            compare(planar[is_finite], full[is_finite]),
            compare(finer, coarse) if finer_seeds else (np.nan, np.nan),
            int((np.isfinite(full) != np.isfinite(planar)).sum()),
        )

    @property
    def slides(self) -> bool:
        """Whether wheels slide."""
        return self.sliding_fraction >= MIN_SLIDING_FRACTION

    @property
    def tolerance(self) -> float:
        """Tolerance of the difference, per cent."""
        return (
            max(SLIDING_TOLERANCE, abs(np.nan_to_num(self.finer_change[0])))
            if self.slides
            else TOLERANCE
        )

    @property
    def is_significant(self) -> bool:
        """Whether the interval of the difference is on one side of the tolerance."""
        mean, half = self.difference
        return bool(abs(abs(mean) - self.tolerance) > half)

    def __str__(self) -> str:
        text = f"{100 * np.median(self.errors[0]):.3f}, {_format(self.difference)} %"
        if self.slides and np.isfinite(self.finer_change[0]):
            text += f" ({_format(self.finer_change)})"
        if self.n_failed:
            text += f", {self.n_failed} fail on one plant"
        return f"**{text}**" if abs(self.difference[0]) > self.tolerance else text


Agreements = dict[Case, dict[str, Agreement]]  # by scenario and robot, then by controller


def _format(difference: tuple[float, float]) -> str:
    """Return a difference as text, with half its interval if there is one."""
    mean, half = difference
    return f"{round(mean, 1) + 0.0:+.1f}" + (f" ± {half:.1f}" if np.isfinite(half) else "")


def compare(errors: Array, reference: Array) -> tuple[float, float]:
    """Return the mean difference of errors by their logarithms, per cent, and half its interval."""
    mean, half = mean_confidence_interval(np.log(errors / reference))
    return float(100 * np.expm1(mean)), float(100 * np.expm1(half))


def study(
    runs: Runs, cases: Sequence[Case], controllers: Sequence[str], max_seeds: int, finer: bool
) -> None:
    """Run both plants: all cases with five seeds, then those without a significant result."""
    for seed, case in itertools.product(range(0, max_seeds, SEED_BATCH), cases):
        seeds = range(seed, min(seed + SEED_BATCH, max_seeds))
        open_names = [
            name
            for name in controllers
            if not seed or not Agreement.from_runs(runs, case, name).is_significant
        ]
        for plant in (FULL, PLANAR):
            runs.run(case, plant, open_names, seeds)
        if finer and not seed:
            sliding = [n for n in open_names if Agreement.from_runs(runs, case, n).slides]
            runs.run(case, FINER, sliding, seeds)


def format_table(agreements: Agreements, controllers: Sequence[str]) -> Iterator[str]:
    """Return the lines of a table in markdown."""
    names = " | ".join(f"`{name}`" for name in controllers)
    yield f"| robot | scenario | seeds | sliding | {names} |"
    yield "|---" * (4 + len(controllers)) + "|"
    for (name, robot), by_controller in agreements.items():
        values = by_controller.values()
        seeds = ", ".join(dict.fromkeys(str(a.errors.shape[1]) for a in values))
        sliding = dict.fromkeys(f"{a.sliding_fraction:.2f}" for a in values if a.slides)
        texts = " | ".join(str(by_controller.get(controller, "")) for controller in controllers)
        yield f"| `{robot}` | `{name}` | {seeds} | {', '.join(sliding)} | {texts} |"


def summarize(runs: Runs, agreements: Agreements) -> Iterator[str]:
    """Return lines on differences beyond the tolerance, and on the order of controllers."""
    for slides, condition in (False, "nothing slides"), (True, "wheels slide"):
        by_case = (by_controller.values() for by_controller in agreements.values())
        chosen = [a for a in itertools.chain(*by_case) if a.slides == slides]
        beyond = [a for a in chosen if abs(a.difference[0]) > a.tolerance]
        significant = sum(a.is_significant for a in beyond)
        n_within = len(chosen) - len(beyond)
        yield (
            f"Where {condition}, {n_within} of {len(chosen)} differences are within the "
            f"tolerance; {significant} are significantly beyond."
        )
    pairs = [
        (case, pair)
        for case, by_controller in agreements.items()
        for pair in itertools.combinations(by_controller, 2)
    ]
    orders = {
        (case, pair): [_compare_controllers(runs, case, pair, plant) for plant in (FULL, PLANAR)]
        for case, pair in pairs
    }
    swapped = {
        pair: (full, planar) for pair, (full, planar) in orders.items() if full[0] * planar[0] < 0
    }
    yield f"Of {len(pairs)} pairs of controllers {len(swapped)} are in another order."
    for ((name, robot), (a, b)), differences in swapped.items():
        text = " and ".join(f"{_format(difference)} %" for difference in differences)
        yield f"{name}, {robot}: {a} against {b} {text}"


def _compare_controllers(
    runs: Runs, case: Case, pair: tuple[str, str], plant: str
) -> tuple[float, float]:
    """Return the difference of two controllers' errors on a plant, for their common seeds."""
    seeds = set.intersection(*(set(runs.seeds(case, name, FULL, PLANAR)) for name in pair))
    errors, reference = (runs.values(case, plant, name, sorted(seeds))[0] for name in pair)
    return compare(errors, reference)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenario", nargs="+", default=list(find_builtin_files("scenarios")))
    parser.add_argument("--robot", nargs="+", default=list(find_builtin_files("robots")))
    parser.add_argument("--controller", nargs="+", default=list(CONTROLLERS))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--finer", action="store_true")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--known", action="store_true")
    options = parser.parse_args()
    runs = Runs(options.set, options.out)
    cases = [(name, robot) for robot in options.robot for name in options.scenario]
    if not options.known:
        study(runs, cases, options.controller, options.seeds, options.finer)
    agreements: Agreements = {}
    for case, name in itertools.product(cases, options.controller):
        if runs.seeds(case, name, FULL, PLANAR):
            agreements.setdefault(case, {})[name] = Agreement.from_runs(runs, case, name)
    for line in (*format_table(agreements, options.controller), "", *summarize(runs, agreements)):
        print(line)


if __name__ == "__main__":
    main()

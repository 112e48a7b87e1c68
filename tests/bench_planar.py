"""Agreement of the plant planar with mujoco: errors of controllers in the same scenarios.

    python tests/bench_planar.py [--scenario rect ...] [--robot tigers-v2016 ...]
        [--controller comp-flc ...] [--seeds 5]

The default is all scenarios and robots, which takes an hour with JAX. The output is
docs/data/planar-agreement.csv. The compared error is the rms distance of a robot from its reference
over a run. Both plants have the same noise, so the two errors of a seed are a pair: a difference is
the mean of the logarithms of their ratios, in per cent, with half its 95 % interval. Differences
beyond 1 % are bold, and where wheels slide those beyond 5 %.
"""

import argparse
import csv
import sys

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.scenario import load_scenario
from omni_mj.config.toml_files import find_builtin_files
from omni_mj.results.metrics import row_metrics
from omni_mj.results.seed_statistics import mean_confidence_interval
from omni_mj.simulation.simulation import Simulation

CONTROLLERS = ["comp-flc", "adaptive-comp-flc", "lqr"]
MIN_SLIDING_FRACTION = 0.01  # fraction of frames with sliding wheels, from which a run slides
TOLERANCE, SLIDING_TOLERANCE = 1.0, 5.0  # per cent


def measure(scenario: str, robot: str, plant: str, controllers: list[str], seeds: int) -> Array:
    """Return rms distances, m, inf for failed robots, and fractions of sliding frames.

    Returns:
        Array of shape (2, controllers, seeds).
    """
    chosen = load_scenario(scenario, robot=robot, plant=plant)
    simulation = Simulation(chosen, controllers, range(seeds))
    metrics = row_metrics(simulation.run(), simulation.failures)
    for failure in simulation.failures:
        print(f"{scenario}, {robot}, {plant}: {failure}", file=sys.stderr)
    # Rows are ordered by controller, seed and slot; the last robot of a world counts.
    values = np.array([metrics["position_rms_m"], metrics["sliding_fraction"]])
    return values.reshape(2, len(controllers), seeds, -1)[..., -1]


def format_agreement(full: Array, planar: Array, tolerance: float) -> str:
    """Return the median error on mujoco, cm, and planar's difference from it as text."""
    n_failed = (np.isfinite(full) != np.isfinite(planar)).sum()
    is_finite = np.isfinite(full) & np.isfinite(planar)
    interval = mean_confidence_interval(np.log(planar[is_finite] / full[is_finite]))
    difference, half = 100 * np.expm1(interval)
    text = f"{100 * np.median(full[is_finite]):.3f}, {round(difference, 1) + 0.0:+.1f}"
    text += f" ± {half:.1f} %" if np.isfinite(half) else " %"
    if n_failed:
        text += f", {n_failed} fail on one plant"
    return f"**{text}**" if abs(difference) > tolerance else text


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenario", nargs="+", default=list(find_builtin_files("scenarios")))
    parser.add_argument("--robot", nargs="+", default=list(find_builtin_files("robots")))
    parser.add_argument("--controller", nargs="+", default=CONTROLLERS)
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args()
    writer = csv.writer(sys.stdout, lineterminator="\n")
    names = [f"`{name}`" for name in options.controller]
    writer.writerow(["robot", "scenario", "seeds", "sliding", *names])
    for robot in options.robot:
        for scenario in options.scenario:
            (full, sliding_fraction), (planar, _) = (
                measure(scenario, robot, plant, options.controller, options.seeds)
                for plant in ("mujoco", "planar")
            )
            fractions = np.nanmean(sliding_fraction, axis=1)
            slides = fractions >= MIN_SLIDING_FRACTION
            tolerances = np.where(slides, SLIDING_TOLERANCE, TOLERANCE)
            cells = map(format_agreement, full, planar, tolerances)
            sliding = dict.fromkeys(f"{fraction:.2f}" for fraction in fractions[slides])
            start = [f"`{robot}`", f"`{scenario}`", options.seeds, ", ".join(sliding)]
            writer.writerow([*start, *cells])
            sys.stdout.flush()


if __name__ == "__main__":
    main()

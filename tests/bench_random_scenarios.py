"""Compare the adaptive controller with others in random scenarios, to find where it is worse.

    python tests/bench_random_scenarios.py [--scenarios 100] [--seed 0] [--seeds 4] [--plant mujoco]

A scenario has a built-in robot, a route, friction, noise, dead time and an error of the assumed
dead time. Some have a weak wheel, a biased gyro, or pushes. References use 70 to 85 % of the
friction, in one scenario of five 100 to 120 %. The output is docs/data/random-scenarios.csv: ratios
of position errors, means over seeds, of the adaptive controller over those of the others.
"""

import argparse
import csv
import itertools
import sys
from math import pi
from typing import Any

import numpy as np

import omni_mj as om
from omni_mj.config.toml_files import find_builtin_files

SUBJECT = "adaptive-comp-flc"
CONTROLLERS = (SUBJECT, "comp-flc", "comp-flc-lag")
ROUTES = ("league", "league-smooth", "figure-eight", "circle", "sprint", "rect-spin")
BEYOND_FRICTION, TRAITS = 0.2, {"weak": 0.3, "biased": 0.3, "pushed": 0.3}  # shares of scenarios
STATISTICS = {"max": "maximum", "mean": "mean"}
COLUMNS = [
    "compared with, error",
    "better",
    "worse",
    "smallest ratio",
    "median ratio",
    "90th percentile",
    "largest ratio",
]


def draw_scenario(seed: int, number: int, plant: str) -> om.Scenario:
    """Return a random scenario."""
    rng = np.random.default_rng([seed, number])
    robot, friction = str(rng.choice(list(find_builtin_files("robots")))), rng.uniform(0.45, 0.95)
    base, reference = _route(rng)
    beyond = rng.random() < BEYOND_FRICTION
    delay = int(rng.integers(2, 11))
    noise = rng.uniform(1, 3)
    reference |= {
        "max_speed_m_s": rng.uniform(0.8, 3.0),
        "max_acceleration_m_s2": rng.uniform(2.0, 5.0) if beyond else rng.uniform(0.5, 3.0),
        "max_sideways_acceleration_m_s2": 0.0,
        "max_jerk_m_s3": rng.uniform(7, 40) if rng.random() < 0.5 else 0.0,
        "assumed_friction": friction * (rng.uniform(1.0, 1.2) if beyond else 1.0),
        "wheel_utilization": 1.0 if beyond else rng.uniform(0.7, 0.85),
    }
    weak = {
        "kind": "motor-demagnetized",
        "start_s": 0.0,
        "wheel": int(rng.integers(1, 5)),
        "factor": rng.uniform(0.6, 0.9),
    }
    pushes = [_push(rng), _push(rng)]
    has = {"beyond": beyond} | {
        trait: rng.random() < fraction for trait, fraction in TRAITS.items()
    }
    return om.load_scenario(
        base,
        plant=plant,
        robot=robot,
        name=f"drawn-{seed}-{number}",
        description=", ".join([base, *(trait for trait, is_present in has.items() if is_present)]),
        reference=reference,
        world={"start_poses": [[0.0, 0.0, rng.uniform(-pi, pi)]]},
        carpet={"friction": friction},
        radio={"delay_frames": delay},
        control={"delay_error_frames": int(rng.integers(-2, 3))},
        vision={"position_noise_m": 0.0013 * noise, "heading_noise_rad": 0.01 * noise},
        sensors={"gyro_bias_rad_s": 0.05 if has["biased"] else 0.01},
        fault=[weak] * has["weak"] + pushes * has["pushed"],
    )


def _route(rng: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """Return a built-in scenario, and the reference that replaces its route."""
    kind = rng.integers(3)
    if kind == 0:
        return str(rng.choice(ROUTES)), {}
    length, width = rng.uniform(1, 5), rng.uniform(1, 3)
    if kind == 1:
        size = {"length_m": length, "width_m": width}
        return "random-waypoints", size | {
            "waypoint_count": int(rng.integers(4, 9)),
            "seed": int(rng.integers(1_000_000)),
        }
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * (length / 2, width / 2)
    turns = rng.uniform(-pi, pi, len(corners)) * (rng.random() < 0.5)
    points = np.column_stack([corners[:: int(rng.choice([-1, 1]))], turns])
    return "rect", {"waypoints": points.tolist()}


def _push(rng: np.random.Generator) -> dict[str, Any]:
    """Return a push up to the strongest crash that the rules allow (`fault-push`)."""
    duration, direction = rng.uniform(0.05, 0.3), rng.uniform(-180, 180)
    fault = {"kind": "push", "start_s": rng.uniform(0.5, 5), "duration_s": duration}
    return fault | {
        "force_n": min(rng.uniform(0.5, 2) / duration, 20.0),
        "direction_deg": direction,
    }


def compare_errors(entries: dict[str, Any], baseline: str, statistic: str) -> list[object]:
    """Return how often the subject has less error than a baseline, and quantiles of the ratio."""
    ratios = [
        entry["verdict"]["errors"][statistic]["against"][baseline]["ratio"]
        for entry in entries.values()
    ]
    ratio = np.array([np.inf if value is None else value for value in ratios])
    n_better = (ratio < 1).sum()
    quantiles = np.quantile(ratio, [0, 0.5, 0.9, 1], method="higher")
    return [n_better, len(ratio) - n_better, *(f"{x:.2f}" for x in quantiles)]


def main() -> None:
    """Draw, drive, and print the tables."""
    parser = argparse.ArgumentParser(description="Does the adaptive controller do harm anywhere?")
    parser.add_argument("--scenarios", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="From which scenarios are drawn.")
    parser.add_argument("--seeds", type=int, default=4, help="Of the noise of each.")
    parser.add_argument("--plant", choices=["mujoco", "planar"], default="mujoco")
    options = parser.parse_args()
    scenarios = [
        draw_scenario(options.seed, number, options.plant) for number in range(options.scenarios)
    ]
    result = om.compare(scenarios, CONTROLLERS, options.seeds, subject=SUBJECT)
    entries = result.summary()["scenarios"]
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(COLUMNS)
    for baseline, (statistic, name) in itertools.product(CONTROLLERS[1:], STATISTICS.items()):
        row = compare_errors(entries, baseline, statistic)
        writer.writerow([f"{baseline}, {name}", *row])


if __name__ == "__main__":
    main()

"""Compare the adaptive controller with others in random scenarios, to find where it is worse.

    python tests/bench_random_scenarios.py [--scenarios 100] [--seed 0] [--seeds 4] [--plant mujoco]
                                [--out FOLDER]

A scenario has a built-in robot, a route, friction, noise, dead time and an error of the assumed
dead time. Some have a weak wheel, a biased gyro, or pushes. References use 70 to 85 % of the
friction, in one scenario of five 100 to 120 %. `om.compare` runs them and tests the differences.
"""

import argparse
from collections.abc import Iterator
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

import omni_mj as om
from omni_mj.config.toml_files import find_builtin_files
from omni_mj.results.text_table import Table, format_table

SUBJECT = "adaptive-comp-flc"
CONTROLLERS = (SUBJECT, "comp-flc", "comp-flc-lag")
ROUTES = ("league", "league-smooth", "figure-eight", "circle", "sprint", "rect-spin")
BEYOND_FRICTION, TRAITS = 0.2, {"weak": 0.3, "biased": 0.3, "pushed": 0.3}  # shares of scenarios
HEADING_DEG = 3.0  # limit of heading errors where traction allows it
MAX_SLIDING = 0.01  # fraction of frames in which the wheels of a holding robot may slide


def draw_scenario(seed: int, number: int, plant: str) -> om.Scenario:
    """Return a random scenario."""
    rng = np.random.default_rng([seed, number])
    robot, friction = str(rng.choice(list(find_builtin_files("robots")))), rng.uniform(0.45, 0.95)
    base, reference = _route(rng)
    beyond, delay, noise = (
        rng.random() < BEYOND_FRICTION,
        int(rng.integers(2, 11)),
        rng.uniform(1, 3),
    )
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


def compare_errors(entries: dict[str, Any]) -> Iterator[list[str]]:
    """Yield how often the subject has less error than each baseline, by statistic."""
    for baseline in CONTROLLERS[1:]:
        for statistic in ("max", "mean"):
            pairs = [
                entry["verdict"]["errors"][statistic]["against"][baseline]
                for entry in entries.values()
            ]
            ratio = np.array([np.inf if pair["ratio"] is None else pair["ratio"] for pair in pairs])
            is_significant = np.array([bool(pair["significant"]) for pair in pairs])
            counts = [
                (side & subset).sum()
                for side in (ratio < 1, ratio >= 1)
                for subset in (True, is_significant)
            ]
            quantiles = np.quantile(ratio, [0, 0.5, 0.9, 1], method="higher")
            yield [f"{baseline}, {statistic}", *map(str, counts), *(f"{x:.2f}" for x in quantiles)]


def compare_headings(entries: dict[str, Any]) -> Iterator[list[str]]:
    """Yield heading errors, grouped by whether the reference or the subject exceeds friction."""
    groups = dict[str, list[list[float]]]()
    for entry in entries.values():
        results = entry["results"]
        slides = results[SUBJECT]["saturation"]["sliding_fraction"]["max"] > MAX_SLIDING
        group = (
            "beyond friction"
            if "beyond" in entry["description"]
            else f"wheels {'slide' if slides else 'hold'}"
        )
        worst = [
            np.degrees(results[label]["error_rad"]["heading"]["max"]["max"])
            for label in CONTROLLERS
        ]
        groups.setdefault(group, []).append(worst)
    for group, rows in sorted(groups.items()):
        n_large, medians = (np.array(rows) > HEADING_DEG).sum(0), np.median(rows, axis=0)
        yield [
            group,
            str(len(rows)),
            *(f"{n}, {x:.1f}" for n, x in zip(n_large, medians, strict=True)),
        ]


def main() -> None:
    """Draw, drive, and print the tables."""
    parser = argparse.ArgumentParser(description="Does the adaptive controller do harm anywhere?")
    parser.add_argument("--scenarios", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="From which scenarios are drawn.")
    parser.add_argument("--seeds", type=int, default=4, help="Of the noise of each.")
    parser.add_argument("--plant", choices=["mujoco", "planar"], default="mujoco")
    parser.add_argument("--out", type=Path, help="Where results are stored. [nowhere]")
    options = parser.parse_args()
    scenarios = [
        draw_scenario(options.seed, number, options.plant) for number in range(options.scenarios)
    ]
    result = om.compare(scenarios, CONTROLLERS, options.seeds, subject=SUBJECT)
    if options.out:
        result.save(options.out)
    entries = result.summary()["scenarios"]
    columns = [
        "",
        "ahead",
        "beyond chance",
        "behind",
        "beyond chance",
        "least ratio",
        "median",
        "9 in 10",
        "most",
    ]
    print(
        format_table(
            Table(
                f"{SUBJECT}, means over seeds, over those of",
                columns,
                list(compare_errors(entries)),
                1,
            )
        )
    )
    title = f"headings beyond {HEADING_DEG:g} degrees in a seed, and median of the greatest"
    print(
        format_table(
            Table(title, ["", "scenarios", *CONTROLLERS], list(compare_headings(entries)), 1)
        )
    )


if __name__ == "__main__":
    main()

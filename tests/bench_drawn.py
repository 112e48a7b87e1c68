"""Does the adaptive controller do harm anywhere? Drive it and comp-flc in scenarios drawn at random.

    python tests/bench_drawn.py [--scenarios 100] [--seed 0] [--seeds 4] [--plant mujoco] [--out
    FOLDER]

A scenario has a robot of the catalogue, a route, friction, dead time and an error of the dead time, noise, and some
have a weak wheel, a biased gyro, or pushes. References ask for 70 to 85 % of the friction, in one scenario of five for
100 to 120 %. `om.compare` drives them and tests the differences; --out stores its results.
"""

import argparse
from collections.abc import Iterator
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

import omni_mj as om
from omni_mj.config.robot_files import find_builtin_robots as robots
from omni_mj.results.result_tables import Table, format_table

SUBJECT = "adaptive-comp-flc"
CONTROLLERS = (SUBJECT, "comp-flc", "comp-flc-lag")
ROUTES = ("league", "league-smooth", "figure-eight", "circle", "sprint", "rect-spin")
BEYOND, TRAITS = 0.2, {"weak": 0.3, "biased": 0.3, "pushed": 0.3}  # shares of scenarios
HEADING_DEG = 3.0  # limit of heading errors where traction allows it
SLIDES = 0.01  # share of frames in which wheels slide, up to which they hold


def drawn(seed: int, number: int, plant: str) -> om.Scenario:
    """Return a scenario of a study."""
    rng = np.random.default_rng([seed, number])
    robot, friction = str(rng.choice(list(robots()))), rng.uniform(0.45, 0.95)
    base, reference = _route(rng)
    beyond, delay, noise = rng.random() < BEYOND, int(rng.integers(2, 11)), rng.uniform(1, 3)
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
    has = {"beyond": beyond} | {trait: rng.random() < share for trait, share in TRAITS.items()}
    return om.load_scenario(
        base,
        plant=plant,
        robot=robot,
        name=f"drawn-{seed}-{number}",
        description=", ".join([base, *(trait for trait, there in has.items() if there)]),
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
    """Return a scenario of the package, and the reference that replaces its route."""
    kind = rng.integers(3)
    if kind == 0:
        return str(rng.choice(ROUTES)), {}
    length, width = rng.uniform(1, 5), rng.uniform(1, 3)
    if kind == 1:
        size = {"length_m": length, "width_m": width}
        return "waypoints", size | {
            "waypoint_count": int(rng.integers(4, 9)),
            "seed": int(rng.integers(1_000_000)),
        }
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * (length / 2, width / 2)
    turns = rng.uniform(-pi, pi, len(corners)) * (rng.random() < 0.5)
    points = np.column_stack([corners[:: int(rng.choice([-1, 1]))], turns])
    return "rect", {"waypoints": points.tolist()}


def _push(rng: np.random.Generator) -> dict[str, Any]:
    """Return a push as strong as a crash that the rules allow, or weaker (`fault-push`)."""
    lasts, bearing = rng.uniform(0.05, 0.3), rng.uniform(-180, 180)
    push = {"kind": "push", "start_s": rng.uniform(0.5, 5), "duration_s": lasts}
    return push | {"force_n": min(rng.uniform(0.5, 2) / lasts, 20.0), "direction_deg": bearing}


def ahead(entries: dict[str, Any]) -> Iterator[list[str]]:
    """Yield how often the subject is ahead of each rival, by each statistic."""
    for rival in CONTROLLERS[1:]:
        for statistic in ("max", "mean"):
            pairs = [
                entry["verdict"]["errors"][statistic]["against"][rival]
                for entry in entries.values()
            ]
            ratio = np.array([np.inf if pair["ratio"] is None else pair["ratio"] for pair in pairs])
            sure = np.array([bool(pair["significant"]) for pair in pairs])
            counts = [
                (side & certain).sum()
                for side in (ratio < 1, ratio >= 1)
                for certain in (True, sure)
            ]
            quantiles = np.quantile(ratio, [0, 0.5, 0.9, 1], method="higher")
            yield [f"{rival}, {statistic}", *map(str, counts), *(f"{x:.2f}" for x in quantiles)]


def headings(entries: dict[str, Any]) -> Iterator[list[str]]:
    """Yield heading errors by whether wheels can follow the reference, and whether the subject's hold."""
    parts = dict[str, list[list[float]]]()
    for entry in entries.values():
        results = entry["results"]
        slides = results[SUBJECT]["saturation"]["sliding_fraction"]["max"] > SLIDES
        part = (
            "beyond friction"
            if "beyond" in entry["description"]
            else f"wheels {'slide' if slides else 'hold'}"
        )
        worst = [
            np.degrees(results[label]["error_rad"]["heading"]["max"]["max"])
            for label in CONTROLLERS
        ]
        parts.setdefault(part, []).append(worst)
    for part, rows in sorted(parts.items()):
        off, medians = (np.array(rows) > HEADING_DEG).sum(0), np.median(rows, axis=0)
        yield [part, str(len(rows)), *(f"{n}, {x:.1f}" for n, x in zip(off, medians, strict=True))]


def main() -> None:
    """Draw, drive, and print the tables."""
    parser = argparse.ArgumentParser(description="Does the adaptive controller do harm anywhere?")
    parser.add_argument("--scenarios", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="From which scenarios are drawn.")
    parser.add_argument("--seeds", type=int, default=4, help="Of the noise of each.")
    parser.add_argument("--plant", choices=["mujoco", "planar"], default="mujoco")
    parser.add_argument("--out", type=Path, help="Where results are stored. [nowhere]")
    options = parser.parse_args()
    scenarios = [drawn(options.seed, number, options.plant) for number in range(options.scenarios)]
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
            Table(f"{SUBJECT}, means over seeds, over those of", columns, list(ahead(entries)), 1)
        )
    )
    title = f"headings beyond {HEADING_DEG:g} degrees in a seed, and median of the greatest"
    print(format_table(Table(title, ["", "scenarios", *CONTROLLERS], list(headings(entries)), 1)))


if __name__ == "__main__":
    main()

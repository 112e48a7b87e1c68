"""Does the adaptive controller do harm anywhere: scenarios drawn at random, which it and comp-flc drive side by side.

    python tests/bench_drawn.py [--scenarios 100] [--seed 0] [--seeds 4] [--only 3 17 ...] [--plant mujoco]
                                [--kernel numpy] [--folder DIR]

Each draws a robot of the catalogue, a route, friction, dead time and by how much it is told wrong, noise, and some of
them a weak wheel, a biased gyro, or pushes. References ask for 70 to 85 % of what friction lets wheels do, in one
scenario of five for 100 to 120 %. Differences are tested as `omni-mj compare` tests them: seed by seed, and by Holm's
method over all. What robots are taken for where traction ends, and how soon they are back: `bench_drawn_traction`. With
--folder each scenario is written there as a file that `omni-mj` takes, and what came of it as a line, so that a study
can be broken off and gone on with.
"""

import argparse
import itertools
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import degrees, pi
from pathlib import Path
from typing import Any

import numpy as np
from bench_drawn_traction import back, returns, taken, taken_for

from omni_control.kinematics import Array
from omni_mj.measure.errors import errors
from omni_mj.measure.metrics import row_metrics
from omni_mj.measure.statistics import CONFIDENCE, holm, paired, spread
from omni_mj.measure.table import Table, text
from omni_mj.robots import builtin as robots
from omni_mj.scenarios.references import timed
from omni_mj.scenarios.rows import Row, table
from omni_mj.scenarios.scenario import Scenario, scenario
from omni_mj.simulate.simulation import Simulation

SUBJECT = "adaptive-comp-flc"
CONTROLLERS = (SUBJECT, "comp-flc", "comp-flc-lag")
ROUTES = ("league", "league-smooth", "eight", "circle", "sprint", "square-spin")
BEYOND, TRAITS = 0.2, {"weak": 0.3, "biased": 0.3, "pushed": 0.3}  # shares of scenarios
AT_ONCE = 8  # scenarios of one robot that are simulated together
HEADING_DEG = 3.0  # within which headings shall be where traction allows it
SLIDES = 0.01  # share of frames in which wheels slide, up to which it does
MEASURED = ("distance_max_m", "distance_mean_m", "heading_max_rad", "sliding_share")
Found = dict[str, Any]


def drawn(seed: int, number: int) -> Scenario:
    """A scenario of a study."""
    rng = np.random.default_rng([seed, number])
    robot, friction = str(rng.choice(list(robots()))), rng.uniform(0.45, 0.95)
    base, reference = _route(rng)
    beyond, delay, noise = rng.random() < BEYOND, int(rng.integers(2, 11)), rng.uniform(1, 3)
    reference |= {
        "max_speed_m_s": rng.uniform(0.8, 3.0),
        "max_acceleration_m_s2": rng.uniform(2.0, 5.0) if beyond else rng.uniform(0.5, 3.0),
        "max_side_acceleration_m_s2": 0.0,
        "max_jerk_m_s3": rng.uniform(7, 40) if rng.random() < 0.5 else 0.0,
        "friction": friction * (rng.uniform(1.0, 1.2) if beyond else 1.0),
        "wheel_share": 1.0 if beyond else rng.uniform(0.7, 0.85),
    }
    weak = {"kind": "motor-weak", "at": 0.0, "wheel": int(rng.integers(1, 5)), "to": rng.uniform(0.6, 0.9)}
    pushes = [_push(rng), _push(rng)]
    has = {"beyond": beyond} | {trait: rng.random() < share for trait, share in TRAITS.items()}
    return scenario(
        base,
        robot=robot,
        controllers=CONTROLLERS,
        name=f"drawn-{seed}-{number}",
        description=", ".join([base, *(trait for trait, there in has.items() if there)]),
        reference=reference,
        world={"places": [[0.0, 0.0, rng.uniform(-pi, pi)]]},
        carpet={"friction": friction},
        radio={"delay_frames": delay},
        control={"delay_error_frames": int(rng.integers(-2, 3))},
        vision={"position_noise_m": 0.0013 * noise, "heading_noise_rad": 0.01 * noise},
        sensors={"gyro_bias_rad_s": 0.05 if has["biased"] else 0.01},
        fault=[weak] * has["weak"] + pushes * has["pushed"],
    )


def _route(rng: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """A scenario that comes with the package, and what is driven in place of its route."""
    kind = rng.integers(3)
    if kind == 0:
        return str(rng.choice(ROUTES)), {}
    length, width = rng.uniform(1, 5), rng.uniform(1, 3)
    if kind == 1:
        size = {"length_m": length, "width_m": width}
        return "waypoints", size | {"count": int(rng.integers(4, 9)), "seed": int(rng.integers(1_000_000))}
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * (length / 2, width / 2)
    turns = rng.uniform(-pi, pi, len(corners)) * (rng.random() < 0.5)
    points = np.column_stack([corners[:: int(rng.choice([-1, 1]))], turns])
    return "rect", {"waypoints": points.tolist()}


def _push(rng: np.random.Generator) -> dict[str, Any]:
    """Up to what a crash that the rules allow is (`fault-push`)."""
    lasts, bearing = rng.uniform(0.05, 0.3), rng.uniform(-180, 180)
    push = {"kind": "push", "at": rng.uniform(0.5, 5), "for": lasts}
    return push | {"force_n": min(rng.uniform(0.5, 2) / lasts, 20.0), "direction_deg": bearing}


def driven(scenarios: Sequence[Scenario], seeds: int) -> Iterator[Found]:
    """What comes of scenarios of one robot, simulated together."""
    rows: list[Row] = []
    for each in scenarios:
        for row in table(each.labels, range(seeds), each.settings_of, each.robot):
            rows.append(replace(row, world=len(rows)))
    simulation = Simulation(scenarios[0], rows=rows)
    log = simulation.run()
    measured, distance = row_metrics(log, simulation.failures), errors(log)["distance"]
    own = np.arange(len(rows)).reshape(len(scenarios), -1, seeds)
    for each, of_labels in zip(scenarios, own, strict=True):
        results = {
            label: {name: measured[name][of].tolist() for name in MEASURED}
            for label, of in zip(each.labels, of_labels, strict=True)
        }
        for label, of in zip(each.labels, of_labels, strict=True):
            results[label]["spells"] = [returns(log, row, distance[:, row]) for row in of]
        results[SUBJECT]["taken_for"] = [taken_for(log, row) for row in of_labels[each.labels.index(SUBJECT)]]
        yield {"name": each.name, "robot": each.robot, "description": each.description, "results": results}


def study(scenarios: Sequence[Scenario], seeds: int, folder: Path | None) -> list[Found]:
    """Results of scenarios, in their order; those that are in the folder are not run again."""
    kept = folder / f"{scenarios[0].plant}-{seeds}-seeds.jsonl" if folder else None
    known = [json.loads(line) for line in kept.read_text("utf-8").splitlines()] if kept and kept.exists() else []
    found = {each["name"]: each for each in known}
    left = [each for each in scenarios if each.name not in found]
    for robot in robots():
        own = sorted((each for each in left if each.robot == robot), key=lambda each: timed(each.settings).frames)
        for first in range(0, len(own), AT_ONCE):
            for each in driven(own[first : first + AT_ONCE], seeds):
                found[each["name"]] = each
                if kept:
                    with kept.open("a", encoding="utf-8") as out:
                        out.write(json.dumps(each) + "\n")
    return [found[each.name] for each in scenarios]


def compared(found: Sequence[Found]) -> list[dict[str, Any]]:
    """The subject against each rival in each scenario, by maximum and mean error in the plane."""
    pairs = []
    for each in found:
        for rival, name in itertools.product(CONTROLLERS[1:], ("max", "mean")):
            errors = (np.array(each["results"][label][f"distance_{name}_m"]) for label in (SUBJECT, rival))
            ours, theirs = (spread(values) for values in errors)
            means = [np.inf if one["mean"] is None else one["mean"] for one in (ours, theirs)]
            pairs.append({"of": each, "rival": rival, "error": name, "means": means, "p": paired(ours, theirs)[2]})
    tested = [pair for pair in pairs if pair["p"] is not None]
    for pair, adjusted in zip(tested, holm(np.array([pair["p"] for pair in tested])), strict=True):
        pair["beyond_chance"] = bool(adjusted <= 1 - CONFIDENCE)
    return pairs


def verdicts(pairs: Sequence[dict[str, Any]]) -> Iterator[Table]:
    """How often the subject is ahead of each rival, and where it is not."""
    rows = []
    for rival, error in itertools.product(CONTROLLERS[1:], ("max", "mean")):
        own = [pair for pair in pairs if (pair["rival"], pair["error"]) == (rival, error)]
        ratio = np.array([pair["means"][0] / pair["means"][1] for pair in own])
        sure = np.array([pair.get("beyond_chance", False) for pair in own])
        counts = (ratio < 1).sum(), (sure & (ratio < 1)).sum(), (ratio >= 1).sum(), (sure & (ratio >= 1)).sum()
        quantiles = (f"{value:.2f}" for value in np.quantile(ratio, [0, 0.5, 0.9, 1]))
        rows.append([f"{rival}, {error}", *map(str, counts), *quantiles])
    counted = ["ahead", "beyond chance", "behind", "beyond chance"]
    title = f"{SUBJECT}, means over seeds, over those of"
    yield Table(title, ["", *counted, "least ratio", "median", "9 in 10", "most"], rows, 1)
    rows = []
    for pair in pairs:
        if pair["means"][0] >= pair["means"][1]:
            numbers = [f"{100 * mean:.2f}" for mean in pair["means"]]
            numbers.append("" if pair["p"] is None else f"{pair['p']:.2g}")
            rows.append([*_names(pair["of"]), f"{pair['rival']}, {pair['error']}", *numbers])
    yield Table("behind", ["scenario", "robot", "", "against", "cm", "its", "p, not adjusted"], rows, 4)


def of_traction(found: Sequence[Found]) -> dict[str, list[Found]]:
    """Results by whether wheels can do what is asked of them, and whether the subject's do it without sliding."""
    parts: dict[str, list[Found]] = {"wheels hold": [], "wheels slide": [], "beyond friction": []}
    for each in found:
        slides = max(each["results"][SUBJECT]["sliding_share"]) > SLIDES
        within = "wheels slide" if slides else "wheels hold"
        parts["beyond friction" if "beyond" in each["description"] else within].append(each)
    return parts


def headings(found: Sequence[Found]) -> Iterator[Table]:
    """How often headings stray too far in the worst of the seeds, and where the subject's does."""
    worst = np.array(
        [[degrees(max(each["results"][label]["heading_max_rad"])) for label in CONTROLLERS] for each in found]
    )
    slides = np.array([max(each["results"][SUBJECT]["sliding_share"]) for each in found])
    asked = np.array(["beyond" in each["description"] for each in found])
    parts = {
        "within, wheels slide in less than 1 % of the frames": ~asked & (slides <= SLIDES),
        "within, wheels slide": ~asked & (slides > SLIDES),
        **{f"within, {trait}": ~asked & [trait in each["description"] for each in found] for trait in TRAITS},
        "beyond what friction lets wheels do": asked,
    }
    rows = [
        [
            name,
            str(part.sum()),
            *map(str, (worst[part] > HEADING_DEG).sum(0)),
            *(f"{x:.1f}" for x in _medians(worst[part])),
        ]
        for name, part in parts.items()
    ]
    columns = ["scenarios", *CONTROLLERS, *(f"{label}, median" for label in CONTROLLERS)]
    yield Table(f"headings beyond {HEADING_DEG:g} degrees in a seed", ["", *columns], rows, 1)
    rows = [
        [*_names(each), *(f"{angle:.1f}" for angle in angles), f"{100 * share:.1f}"]
        for each, angles, share in zip(found, worst, slides, strict=True)
        if angles[0] > HEADING_DEG
    ]
    columns = ["scenario", "robot", "", *CONTROLLERS, "wheels slide, % of frames"]
    yield Table(f"{SUBJECT}'s heading beyond {HEADING_DEG:g} degrees", columns, rows, 3)


def _names(found: Found) -> list[str]:
    return [found["name"], found["robot"], found["description"]]


def _medians(angles: Array) -> Array:
    return np.median(angles, axis=0) if len(angles) else np.full(len(CONTROLLERS), np.nan)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="Does the adaptive controller do harm anywhere?")
    parser.add_argument("--scenarios", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="From which scenarios are drawn.")
    parser.add_argument("--seeds", type=int, default=4, help="Of the noise of each.")
    parser.add_argument("--only", type=int, nargs="+", help="Numbers of scenarios. [all]")
    parser.add_argument("--plant", choices=["mujoco", "planar"], default="mujoco")
    parser.add_argument("--kernel", choices=["numpy", "jax"], default="numpy")
    parser.add_argument("--folder", type=Path, help="Where scenarios and results stay. [nowhere]")
    given = parser.parse_args()
    scenarios = [
        each.replace(plant=given.plant, settings=each.settings.replace(physics={"kernel": given.kernel}))
        for each in (drawn(given.seed, number) for number in given.only or range(given.scenarios))
    ]
    if given.folder:
        given.folder.mkdir(parents=True, exist_ok=True)
        for each in scenarios:
            (given.folder / f"{each.name}.toml").write_text(each.to_toml(), "utf-8")
    found = study(scenarios, given.seeds, given.folder)
    parts = of_traction(found)
    for said in (*verdicts(compared(found)), *headings(found), back(parts, CONTROLLERS), taken(parts, SUBJECT)):
        print(text(said), flush=True)


if __name__ == "__main__":
    main()

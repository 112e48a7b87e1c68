"""Does the adaptive controller do harm anywhere? Drive it and comp-flc in scenarios drawn at random.

    python tests/bench_drawn.py [--scenarios 100] [--seed 0] [--seeds 4] [--only 3 17 ...] [--plant mujoco]
                                [--kernel numpy] [--folder DIR]

A scenario has a robot of the catalogue, a route, friction, dead time and an error of the dead time, noise, and some
have a weak wheel, a biased gyro, or pushes. References ask for 70 to 85 % of the friction, in one scenario of five for
100 to 120 %. Differences are tested as `omni-mj compare` tests them. --folder stores each scenario as a file.

Two more tables say what happens when traction ends. A spell lasts from the first frame in which a wheel slides or
somebody pushes to the last that no other follows within a second. A robot is back when its error in the plane is that
before the spell, or 2 cm. An estimate is sane within `SANE`. The latency is that beyond the dead time: the nominal one
is wrong by 2 frames at most, and a frame is in doubt. Published robots have an alpha of 0.79 to 1, hot robots with
an empty battery 0.7 (docs/results.md); fits of windows that brake show up to 1.08. Creep is half to twice that of the
robot in closed form; four published robots differ by a factor of 1.9. Lag and dry friction are at most twice those in
closed form.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.measure import causes
from omni_mj.measure.metrics import NEAR_M, errors, row_metrics
from omni_mj.measure.statistics import spread, verdicts
from omni_mj.measure.table import Table, text
from omni_mj.scenarios.faults import span
from omni_mj.scenarios.references import timed
from omni_mj.scenarios.robots import builtin as robots
from omni_mj.scenarios.rows import Row, table
from omni_mj.scenarios.scenario import Scenario, scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ, PERIOD_S
from omni_mj.scenarios.told import creep as creep_law
from omni_mj.scenarios.told import drag, lag
from omni_mj.simulate.log import Log
from omni_mj.simulate.simulation import Simulation

SUBJECT = "adaptive-comp-flc"
CONTROLLERS = (SUBJECT, "comp-flc", "comp-flc-lag")
ROUTES = ("league", "league-smooth", "eight", "circle", "sprint", "square-spin")
BEYOND, TRAITS = 0.2, {"weak": 0.3, "biased": 0.3, "pushed": 0.3}  # shares of scenarios
AT_ONCE = 8  # scenarios of one robot that are simulated together
HEADING_DEG = 3.0  # limit of heading errors where traction allows it
SLIDES = 0.01  # share of frames in which wheels slide, up to which they hold
WITHIN_S = 1.0  # in which a robot shall be back after a spell
SANE = {
    "latency": (-3.0, 3.0), "alpha ahead": (0.7, 1.1), "alpha aside": (0.7, 1.1), "alpha turning": (0.7, 1.1),
    "creep": (0.5, 2.0), "dry friction": (0.0, 2.0), "lag": (0.0, 2.0),
}  # fmt: skip
ROUNDING = 1e-9  # of estimates at an edge


@dataclass(frozen=True)
class Drive:
    """What came of a scenario: each array by controller (3,) and seed.

    Attributes:
        scenario: As it was driven.
        max_m, mean_m: Errors in the plane, (3, seeds).
        heading_deg: Greatest heading errors, (3, seeds).
        part: Whether wheels can follow the reference, and whether the subject's do so without sliding.
        returns: By controller, of each spell the error at its end, the error before, m, and the time until it is back
            there, s, infinite for never.
        estimates: Least and greatest of each estimate of `SANE`, and the share of frames not sane, (seeds, 7, 3).
    """

    scenario: Scenario
    max_m: Array
    mean_m: Array
    heading_deg: Array
    part: str
    returns: list[list[tuple[float, float, float]]]
    estimates: Array


def drawn(seed: int, number: int) -> Scenario:
    """Return a scenario of a study."""
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
    """Return a scenario of the package, and the reference that replaces its route."""
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
    """Return a push as strong as a crash that the rules allow, or weaker (`fault-push`)."""
    lasts, bearing = rng.uniform(0.05, 0.3), rng.uniform(-180, 180)
    push = {"kind": "push", "at": rng.uniform(0.5, 5), "for": lasts}
    return push | {"force_n": min(rng.uniform(0.5, 2) / lasts, 20.0), "direction_deg": bearing}


def drives(scenarios: Sequence[Scenario], seeds: int) -> Iterator[Drive]:
    """Yield what comes of scenarios of one robot, simulated together."""
    rows: list[Row] = []
    for chosen in scenarios:
        for row in table(chosen.labels, range(seeds), chosen.settings_of, chosen.robot):
            rows.append(replace(row, world=len(rows)))
    simulation = Simulation(scenarios[0], rows=rows)
    log = simulation.run()
    measured, distance = row_metrics(log, simulation.failures), errors(log)["distance"]
    numbers = np.arange(len(rows)).reshape(len(scenarios), len(CONTROLLERS), seeds)
    for chosen, of_scenario in zip(scenarios, numbers, strict=True):
        slides = measured["sliding_share"][of_scenario[0]].max() > SLIDES
        part = "wheels slide" if slides else "wheels hold"
        yield Drive(
            chosen,
            measured["distance_max_m"][of_scenario],
            measured["distance_mean_m"][of_scenario],
            np.degrees(measured["heading_max_rad"][of_scenario]),
            "beyond friction" if "beyond" in chosen.description else part,
            [[back for row in of_label for back in returns(log, row, distance[:, row])] for of_label in of_scenario],
            np.array([estimates(log, row) for row in of_scenario[0]]),
        )


def estimates(log: Log, row: int) -> Array:
    """Return the least and greatest of each estimate of `SANE`, and the share of frames not sane, (7, 3)."""
    settings, frames = log.rows[row].settings, slice(log.lengths[row])
    names = "latency_hat", "alpha_hat", "own_lag", "own_creep", "own_friction"
    latency, alpha, lags, creep, friction = (log.channel(name)[frames, row].T for name in names)
    values = np.stack([
        latency[0] - lags[0] / PERIOD_S - settings.radio.delay_frames,
        *alpha,
        creep[0] / creep_law(settings).time[0],
        friction[0] / drag(settings)[0],
        lags[0] / lag(settings)[0],
    ])  # fmt: skip
    least, greatest = np.array(list(SANE.values())).T[..., None]
    outside = (values < least - ROUNDING) | (values > greatest + ROUNDING)
    return np.stack([values.min(1), values.max(1), outside.mean(1)], axis=1)


def returns(log: Log, row: int, distance: Array) -> Iterator[tuple[float, float, float]]:
    """Yield of each spell that a second of grip follows what `Drive.returns` holds."""
    ends = causes.of_row(log, row)[causes.SLIDING].copy()
    for fault in log.rows[row].faults:
        if fault.kind == "push":
            start, stop = span(fault)
            ends[start : int(min(stop, len(ends)))] = True
    frames = np.flatnonzero(ends)
    spells = np.split(frames, np.flatnonzero(np.diff(frames) > FRAME_RATE_HZ) + 1) if frames.size else []
    for spell in spells:
        after = int(spell[-1]) + 1
        if after + FRAME_RATE_HZ <= len(ends):
            level = max(NEAR_M, float(distance[max(spell[0] - 1, 0)]))
            back = np.flatnonzero(distance[after : log.lengths[row]] <= level)
            yield float(distance[after]), level, float(back[0]) * PERIOD_S if back.size else np.inf


def compared(found: Sequence[Drive]) -> Iterator[str]:
    """Yield how often the subject is ahead of each rival, and where it is not."""
    entries: dict[str, Any] = {}
    for drive in found:
        results = {}
        for i, label in enumerate(CONTROLLERS):
            distance = {"max": spread(drive.max_m[i]), "mean": spread(drive.mean_m[i])}
            failed = int(np.isinf(drive.max_m[i]).sum())
            results[label] = {"error_m": {"distance": distance}, "failed": failed}
        entries[drive.scenario.name] = {"results": results, "status": "done"}
    judged = {name: verdict for name, verdict in verdicts(entries, [], SUBJECT).items() if verdict}
    rows = []
    for rival in CONTROLLERS[1:]:
        for statistic in ("max", "mean"):
            errors_of = [verdict["errors"][statistic] for verdict in judged.values()]
            ahead = np.array([rival in error["beats"] for error in errors_of])
            pairs = [error["against"][rival] for error in errors_of]
            sure = np.array([bool(pair["beyond_chance"]) for pair in pairs])
            counts = ahead.sum(), (sure & ahead).sum(), (~ahead).sum(), (sure & ~ahead).sum()
            ratios = [np.inf if pair["ratio"] is None else pair["ratio"] for pair in pairs]
            quantiles = np.quantile(ratios, [0, 0.5, 0.9, 1], method="higher")
            rows.append([f"{rival}, {statistic}", *map(str, counts), *(f"{x:.2f}" for x in quantiles)])
    headings = ["", "ahead", "beyond chance", "behind", "beyond chance", "least ratio", "median", "9 in 10", "most"]
    yield text(Table(f"{SUBJECT}, means over seeds, over those of", headings, rows, 1))
    for drive in found:
        for statistic, error in judged[drive.scenario.name]["errors"].items():
            for rival in error["loses_to"]:
                words = f"{drive.scenario.name} ({drive.scenario.robot}, {drive.scenario.description})"
                yield f"{words}: {statistic} error {error['against'][rival]['ratio']} times that of {rival}"


def traction(parts: dict[str, list[Drive]]) -> Iterator[Table]:
    """Yield headings, returns after spells, and estimates, by whether wheels can follow the reference."""
    rows = []
    for part, found in parts.items():
        worst = np.array([drive.heading_deg.max(1) for drive in found])
        off, medians = (worst > HEADING_DEG).sum(0), np.median(worst, axis=0)
        rows.append([part, str(len(found)), *(f"{n}, {x:.1f}" for n, x in zip(off, medians, strict=True))])
    title = f"headings beyond {HEADING_DEG:g} degrees in a seed, and median of the greatest"
    yield Table(title, ["", "scenarios", *CONTROLLERS], rows, 1)
    rows = []
    for part, found in parts.items():
        for i, label in enumerate(CONTROLLERS):
            spells = [spell for drive in found for spell in drive.returns[i]]
            times = np.array([when for off, level, when in spells if off > level])
            quantiles = np.quantile(times, [0.5, 0.95, 1], method="higher") if times.size else np.full(3, np.nan)
            counts = len(spells), len(times), (times <= WITHIN_S).sum()
            rows.append([part, label, *map(str, counts), *(f"{x:.2f}" for x in quantiles)])
    headings = ["", "", "spells", "robots off", f"back within {WITHIN_S:g} s", "median, s", "19 in 20", "longest"]
    yield Table("after traction has ended", headings, rows, 2)
    rows = [[name, f"{least:g} to {most:g}"] for name, (least, most) in SANE.items()]
    for found in parts.values():
        runs = np.concatenate([drive.estimates for drive in found])
        ranges = zip(runs[..., 0].min(0), runs[..., 1].max(0), 100 * runs[..., 2].mean(0), strict=True)
        for row, (least, most, share) in zip(rows, ranges, strict=True):
            row.append(f"{least:.2f} to {most:.2f}, {share:.2f} %")
    title = f"estimates of {SUBJECT}, and mean share of frames not sane"
    yield Table(title, ["", "sane", *parts], rows, 1)


def main() -> None:
    """Draw, drive, and print the tables."""
    parser = argparse.ArgumentParser(description="Does the adaptive controller do harm anywhere?")
    parser.add_argument("--scenarios", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="From which scenarios are drawn.")
    parser.add_argument("--seeds", type=int, default=4, help="Of the noise of each.")
    parser.add_argument("--only", type=int, nargs="+", help="Numbers of scenarios. [all]")
    parser.add_argument("--plant", choices=["mujoco", "planar"], default="mujoco")
    parser.add_argument("--kernel", choices=["numpy", "jax"], default="numpy")
    parser.add_argument("--folder", type=Path, help="Where scenarios are stored. [nowhere]")
    options = parser.parse_args()
    scenarios = []
    for number in options.only or range(options.scenarios):
        chosen = drawn(options.seed, number)
        settings = chosen.settings.replace(physics={"kernel": options.kernel})
        scenarios.append(chosen.replace(plant=options.plant, settings=settings))
    if options.folder:
        options.folder.mkdir(parents=True, exist_ok=True)
        for chosen in scenarios:
            (options.folder / f"{chosen.name}.toml").write_text(chosen.to_toml(), "utf-8")
    found = dict[str, Drive]()
    for robot in robots():
        of_robot = [chosen for chosen in scenarios if chosen.robot == robot]
        of_robot.sort(key=lambda chosen: timed(chosen.settings).frames)
        for first in range(0, len(of_robot), AT_ONCE):
            batch = drives(of_robot[first : first + AT_ONCE], options.seeds)
            found |= {drive.scenario.name: drive for drive in batch}
    in_order = [found[chosen.name] for chosen in scenarios]
    parts = dict[str, list[Drive]]()
    for part in ("wheels hold", "wheels slide", "beyond friction"):
        if members := [drive for drive in in_order if drive.part == part]:
            parts[part] = members
    print("\n".join([*compared(in_order), *map(text, traction(parts))]))


if __name__ == "__main__":
    main()

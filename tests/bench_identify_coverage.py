"""How often intervals of `omni-mj identify` hold the truth: logs of drawn robots on our plant, from wrong starts.

    python tests/bench_identify_coverage.py [--logs 100] [--first 0] [--folder DIR]

Each log draws a robot of `ROBOTS` with creep, drag, loops and latency of its own, half of the plan's moves in another
order and direction, 20 s, and noise; and the file it is identified from: another creep, drag, mass and latency, and a
radius as well known as the program believes. With --folder, logs that were identified before are not again, so that a
run can be broken off. A log takes seconds to drive, and five to be identified, with OMP_NUM_THREADS=1. Errors of the
law in `omni_mj.studies.identify` are of --first 3000 --logs 40 and --first 1000 --logs 20, not of these logs.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from omni_mj.measure.table import Table, text
from omni_mj.scenarios import robots
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import CYCLE_RATE_HZ, PERIOD_S, Settings
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies import run
from omni_mj.studies.identify.logs import Log, read
from omni_mj.studies.identify.motion import RADIUS_SHARE, ROLLS
from omni_mj.studies.identify.plan import LENGTHS_M, plan
from omni_mj.studies.identify.study import of_logs, started
from omni_mj.studies.outcome import drive
from omni_mj.studies.slip.law import expected

ROBOTS = ("tigers-v2016", "tigers-v2020", "ssl-a-team", "robojackets", "roboteam-twente")
WRONG_DELAY_FRAMES = 3
Found = dict[str, dict[str, Any]]  # number -> value, noise, error, low, high, truth


def generator(number: int, what: int) -> np.random.Generator:
    """Random numbers of a log: of the robot (0), of the file that it is identified from (1)."""
    return np.random.default_rng([number, what])


def drawn(base: Settings, number: int) -> Settings:
    """The robot of a log, and what it drives."""
    rng = generator(number, 0)
    drive_, firmware, route = base.drive, base.firmware, [list(p) for p in base.reference.waypoints]
    factors = np.exp(rng.uniform(-0.35, 0.35, 4))
    there = np.array(route[1::2]).reshape(len(LENGTHS_M), -1, 3)  # by length and direction
    half = len(LENGTHS_M) // 2
    chosen = [there[k, way] for way in range(there.shape[1]) for k in (rng.integers(half), half + rng.integers(half))]
    turn = rng.uniform(-np.pi, np.pi)
    points = [np.array([0.0, 0.0, turn])]
    for i in rng.permutation(len(chosen)):
        x, y, heading = chosen[i] * rng.uniform(0.8, 1.15)
        way = (x + 1j * y) * np.exp(1j * turn)
        points += [np.array([way.real, way.imag, turn + heading]), points[0]]
    return base.replace(
        drive={
            "creep_stiffness": drive_.creep_stiffness * factors[0],
            "roller_friction": drive_.roller_friction * factors[1],
        },
        carpet={"pile": base.carpet.pile * factors[2]},
        firmware={"kp": firmware.kp * factors[3]},
        radio={"delay_frames": int(rng.integers(2, 9))},
        vision={"position_noise_m": rng.uniform(0.5e-3, 2e-3), "heading_noise_rad": rng.uniform(0.003, 0.01)},
        reference={
            "waypoints": [[round(float(x), 4) for x in point] for point in points],
            "max_acceleration_m_s2": rng.uniform(1.6, 2.2),
        },
    )


def start_file(settings: Settings, robot: str, number: int, folder: Path) -> str:
    """Path of the robot's file as its team believes it: wrong in creep, drag, mass, latency and, a little, radius."""
    rng = generator(number, 1)
    factors = np.exp(rng.uniform(-0.4, 0.4, 3))
    wrong = {
        ("drive", "creep_stiffness"): settings.drive.creep_stiffness * factors[0],
        ("drive", "roller_friction"): settings.drive.roller_friction * factors[1],
        ("carpet", "pile"): settings.carpet.pile * factors[2],
        ("body", "mass_kg"): settings.body.mass_kg * rng.uniform(0.93, 1.1),
        ("wheels", "radius_m"): settings.wheels.radius_m * (1 + RADIUS_SHARE * rng.normal()),
    }
    lines, section = [], ""
    for line in robots.robot_path(robot).read_text("utf-8").splitlines():
        section = line.strip()[1:-1] if line.startswith("[") else section
        key = line.split("=")[0].strip()
        if (section, key) in wrong:
            line = f"{key} = {wrong[section, key]:.6g}"
        if not line.startswith("#:schema"):
            lines.append(line)
    path = folder / f"start-{number}.toml"
    path.write_text("\n".join([*lines, "[radio]", f"delay_frames = {WRONG_DELAY_FRAMES}", ""]), "utf-8")
    return str(path)


def truths(settings: Settings) -> dict[str, float]:
    """Numbers of the plant, as far as they are told.

    Its steps are semi-implicit, so that bodies are half a step ahead of what forces make of them.
    """
    law, mass, half = expected(settings), settings.body.mass_kg, 0.5 / CYCLE_RATE_HZ / settings.physics.substeps
    wheels = {
        "creep_stiffness": settings.drive.creep_stiffness,
        "pile": settings.carpet.pile,
        "roller_friction": settings.drive.roller_friction,
        "radius_m": ROLLS * settings.wheels.radius_m,
        "arm_m": settings.wheels.arm_m,
        **dict.fromkeys(("clock_s", "drift", "slope_x_rad", "slope_y_rad"), 0.0),
    }
    for i, axis in enumerate(("forward", "sideways")):
        wheels[f"gain_{axis}"], wheels[f"creep_{axis}_s2_m"] = ROLLS * float(law.gain[i]), float(law.time[i])
        wheels[f"drag_{axis}_m_s2"] = float(law.drag[i]) / mass
    late = {"commands.latency_s": settings.radio.delay_frames * PERIOD_S - half}
    return {f"wheels.{name}": value for name, value in wheels.items()} | late


def driven(robot: str, numbers: Sequence[int], folder: Path) -> tuple[Path, list[Settings]]:
    """Drive logs of one robot, as one batch, unless the folder has them: file and settings."""
    base = plan(robot).scenario
    base = base.replace(settings=base.settings.replace(wheels={"model": "two-rollers"}))
    settings = [drawn(base.settings, number) for number in numbers]
    (label,) = base.controllers
    file = folder / "trajectory.parquet"
    if not file.exists():
        rows = [Row(i, 0, label, n, s, robot) for i, (n, s) in enumerate(zip(numbers, settings, strict=True))]
        simulation = Simulation(base, rows=rows)
        run.of(simulation, drive(simulation)).save(folder)
    return file, settings


def identified(log: Log, settings: Settings, start: str) -> tuple[Found, list[str]]:
    """What a log tells of each number whose truth is known; and misfits."""
    result, truth = of_logs([log], started(start)), truths(settings)
    found = {}
    for e in result.estimates:
        name = f"{e.source}.{e.name}"
        if e.told and name in truth:
            numbers = {"value": e.value, "noise": e.noise, "error": e.error, "low": e.low, "high": e.high}
            found[name] = numbers | {"truth": truth[name]}
    return found, result.misfits


def study(logs: int, first: int, folder: Path) -> Iterator[dict[str, Any]]:
    """Drive and identify; results of each log, kept in the folder as they come."""
    kept = folder / "coverage.jsonl"
    done = [json.loads(line) for line in kept.read_text("utf-8").splitlines()] if kept.exists() else []
    known = {each["number"]: each for each in done}
    yield from (known[n] for n in range(first, first + logs) if n in known)
    for k, robot in enumerate(ROBOTS):
        numbers = [n for n in range(first, first + logs) if n % len(ROBOTS) == k and n not in known]
        if not numbers:
            continue
        file, settings = driven(robot, numbers, folder / f"{robot}-{numbers[0]}-{len(numbers)}")
        for number, log, each in zip(numbers, read(file), settings, strict=True):
            found, misfits = identified(log, each, start_file(each, robot, number, folder))
            result = {"number": number, "robot": robot, "misfits": misfits, "found": found}
            with kept.open("a", encoding="utf-8") as out:
                out.write(json.dumps(result) + "\n")
            yield result


def table(results: Sequence[dict[str, Any]]) -> Table:
    """Of each number relative or absolute errors, what noise and the interval say, and how many hold.

    The last but two columns are root mean squares of errors over what the interval says, which should be 1; and of the
    law's error l what makes errors most likely, were they normal of the variance noise^2 + l^2.
    """
    rows = []
    for name in dict.fromkeys(name for each in results for name in each["found"]):
        told = [each["found"][name] for each in results if name in each["found"]]
        value, noise, error, low, high, truth = (
            np.array([one[key] for one in told]) for key in ("value", "noise", "error", "low", "high", "truth")
        )
        unit = np.where(truth == 0, 1.0, np.abs(truth))
        off, scatter = (value - truth) / unit, noise / unit
        over = np.sqrt((((value - truth) / error) ** 2).mean())
        numbers = off.mean(), off.std(), *(np.sqrt((x**2).mean()) for x in (scatter, error / unit)), over
        inside = f"{100 * np.mean((low <= truth) & (truth <= high)):.0f} %"
        rows.append([name, *(f"{x:.2g}" for x in (*numbers, law_error(off, scatter))), inside, str(len(told))])
    said = ", ".join(
        f"{sum(any(what in line for line in each['misfits']) for each in results)} by {what}"
        for what in ("wheels: ", "commands: ")
    )
    headings = ["", "mean off", "spread", "noise", "std. error", "over it", "law", "intervals with the truth", "told"]
    title = f"{len(results)} logs, misfits {said}; over the truth where that is not 0"
    return Table(title, headings, rows, 1)


def law_error(off: np.ndarray, noise: np.ndarray) -> float:
    """The likeliest standard deviation of what noise does not explain of errors."""

    def unlikely(law: float) -> float:
        variance = noise**2 + law**2
        return float((np.log(variance) + off**2 / variance).sum())

    found = minimize_scalar(unlikely, bounds=(0.0, float(np.abs(off).max()) + 1e-9), method="bounded")
    return float(found.x)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="How often intervals of omni-mj identify hold the truth.")
    parser.add_argument("--logs", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="Number of the first log.")
    parser.add_argument("--folder", type=Path, help="Where results stay. [nowhere]")
    given = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = given.folder or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        print(text(table(list(study(given.logs, given.first, folder)))))


if __name__ == "__main__":
    main()

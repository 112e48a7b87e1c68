"""How often intervals of `omni-mj identify` hold the truth: logs of drawn robots on our plant, from wrong starts.

    python tests/bench_identify_coverage.py [--logs 100] [--first 0] [--folder DIR]

Each log draws a robot of `ROBOTS` with creep, drag, loops and latency of its own, half of the plan's moves in another
order and direction, 20 s, and noise; and the file it is identified from: another creep, drag, mass and latency, and a
radius as well known as the program believes. With --folder, what was driven before is not again. A log takes seconds
to drive, and one to be identified, with OMP_NUM_THREADS=1.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from omni_mj.measure.table import Table, text
from omni_mj.scenarios import robots
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import CYCLE_RATE_HZ, PERIOD_S, Settings
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies import run
from omni_mj.studies.identify import robot_file
from omni_mj.studies.identify.logs import Log, read
from omni_mj.studies.identify.motion import RADIUS_SHARE, ROLLS
from omni_mj.studies.identify.plan import LENGTHS_M, plan
from omni_mj.studies.identify.study import of_logs, started
from omni_mj.studies.outcome import drive
from omni_mj.studies.slip.law import expected

ROBOTS = ("tigers-v2016", "tigers-v2020", "ssl-a-team", "robojackets", "roboteam-twente")
WRONG_DELAY_FRAMES = 3
Found = dict[str, tuple[float, ...]]  # number -> value, noise, error, low, high, truth


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
    made = {place: f"{value:.6g} # a guess" for place, value in wrong.items()}
    made["radio", "delay_frames"] = f"{WRONG_DELAY_FRAMES} # a guess"
    path = folder / f"start-{number}.toml"
    path.write_text(robot_file.written(robots.robot_path(robot).read_text("utf-8"), made, ["a wrong guess"]), "utf-8")
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
    """What a log tells of each number whose truth is known: value, noise, error, low, high, truth; and misfits."""
    result, truth = of_logs([log], started(start)), truths(settings)
    told = {f"{e.source}.{e.name}": e for e in result.estimates if e.told}
    found = {name: (e.value, e.noise, e.error, e.low, e.high, truth[name]) for name, e in told.items() if name in truth}
    return found, result.misfits


def study(logs: int, first: int, folder: Path) -> Iterator[tuple[Found, list[str]]]:
    """Drive and identify."""
    for k, robot in enumerate(ROBOTS):
        numbers = [n for n in range(first, first + logs) if n % len(ROBOTS) == k]
        if not numbers:
            continue
        file, settings = driven(robot, numbers, folder / f"{robot}-{first}-{logs}")
        for number, log, each in zip(numbers, read(file), settings, strict=True):
            yield identified(log, each, start_file(each, robot, number, folder))


def table(results: Sequence[tuple[Found, list[str]]]) -> Table:
    """Of each number relative or absolute errors, what noise and the interval say, and how many hold the truth.

    "Over it" is the root mean square of errors over what the interval says, which should be 1.
    """
    rows = []
    for name in dict.fromkeys(name for found, _ in results for name in found):
        told = np.array([found[name] for found, _ in results if name in found])
        value, noise, error, low, high, truth = told.T
        unit = np.where(truth == 0, 1.0, np.abs(truth))
        off = (value - truth) / unit
        numbers = off.mean(), off.std(), *(_rms(x) for x in (noise / unit, error / unit, (value - truth) / error))
        inside = f"{100 * np.mean((low <= truth) & (truth <= high)):.0f} %"
        rows.append([name, *(f"{x:.2g}" for x in numbers), inside, str(len(told))])
    said = ", ".join(
        f"{sum(any(source in line for line in misfits) for _, misfits in results)} by {source}"
        for source in ("wheels", "commands")
    )
    headings = ["", "mean off", "spread", "noise", "std. error", "over it", "hold the truth", "told"]
    return Table(f"{len(results)} logs, misfits {said}; over the truth where that is not 0", headings, rows, 1)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="How often intervals of omni-mj identify hold the truth.")
    parser.add_argument("--logs", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="Number of the first log.")
    parser.add_argument("--folder", type=Path, help="Where drives stay. [nowhere]")
    given = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = given.folder or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        print(text(table(list(study(given.logs, given.first, folder)))))


if __name__ == "__main__":
    main()

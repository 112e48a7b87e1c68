"""How often intervals hold the truth: many logs of our plant, each identified from a start robot that is wrong.

    python -m omni_mj.studies.identify.coverage [--logs 100] [--robot NAME|FILE.toml] [--laps 1]

The start has another creep, drag, mass and latency than the robot that drove; noise differs from log to log. 100 logs
take a quarter of an hour on two cores.
"""

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from omni_mj.measure.table import Table, text
from omni_mj.scenarios import robots
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.studies.identify.logs import read
from omni_mj.studies.identify.plan import plan
from omni_mj.studies.identify.study import of_logs
from omni_mj.studies.run import run
from omni_mj.studies.slip.law import expected

WRONG = {  # section and field -> factor, or the value
    ("drive", "creep_stiffness"): 1.5,
    ("drive", "roller_friction"): 0.6,
    ("carpet", "pile"): 0.7,
    ("body", "mass_kg"): 1.1,
}
WRONG_DELAY_FRAMES = 3


def truths(settings: Settings) -> dict[str, float]:
    """Numbers of the plant, as far as they are told.

    Args:
        settings: of the robot that drives.
    """
    closed = expected(settings)
    return {
        "wheels.creep_stiffness": settings.drive.creep_stiffness,
        "wheels.creep_forward_s2_m": float(closed.time[0]),
        "wheels.creep_sideways_s2_m": float(closed.time[1]),
        "wheels.drag_forward_m_s2": float(closed.drag[0]) / settings.body.mass_kg,
        "wheels.drag_sideways_m_s2": float(closed.drag[1]) / settings.body.mass_kg,
        "wheels.arm_m": settings.wheels.arm_m,
        "wheels.clock_s": 0.0,
        "commands.latency_s": settings.radio.delay_frames * PERIOD_S,
        "motors.constant_nm_a": settings.motor.constant_nm_a,
        "motors.resistance_ohm": settings.motor.resistance_ohm,
        "motors.mass_kg": settings.body.mass_kg,
    }


def wrong(settings: Settings, robot: str, folder: Path) -> str:
    """Path of a robot's file that is wrong in creep, drag, mass and latency."""
    lines, section = [], ""
    for line in robots.robot_path(robot).read_text("utf-8").splitlines():
        section = line.strip()[1:-1] if line.startswith("[") else section
        key = line.split("=")[0].strip()
        if (section, key) in WRONG:
            value = getattr(getattr(settings, section), key) * WRONG[section, key]
            line = f"{key} = {value:.5g}"
        if not line.startswith("#:schema"):
            lines.append(line)
    path = folder / "wrong.toml"
    path.write_text("\n".join([*lines, "[radio]", f"delay_frames = {WRONG_DELAY_FRAMES}", ""]), "utf-8")
    return str(path)


def found(number: int, file: Path, start: str) -> tuple[dict[str, tuple[float, float, float, float]], bool]:
    """Value, standard error and ends of the interval of what one log of a file tells; and whether it is a misfit."""
    result = of_logs([read(file)[number]], start)
    told = {f"{e.source}.{e.name}": (e.value, e.error, e.low, e.high) for e in result.estimates if e.told}
    return told, bool(result.misfits)


def study(robot: str = robots.DEFAULT, logs: int = 100, laps: int = 1, workers: int = 2) -> Table:
    """A table: of each number truth, mean, spread and mean standard error, and the share of intervals that hold it.

    Args:
        robot: name or file.
        logs: how many.
        laps: of the plan, that each drives.
        workers: processes.
    """
    chosen = plan(robot).scenario
    chosen = chosen.replace(
        settings=chosen.settings.replace(wheels={"model": "two-rollers"}, reference={"laps": laps}), seeds=logs
    )
    with TemporaryDirectory() as name:
        folder = Path(name)
        run(chosen).save(folder / "run")
        start, file = wrong(chosen.settings, robot, folder), folder / "run" / "trajectory.parquet"
        with ProcessPoolExecutor(workers) as pool:
            results = list(pool.map(partial(found, file=file, start=start), range(logs)))
    rows = []
    for key, truth in truths(chosen.settings).items():
        told = np.array([r[key] for r, _ in results if key in r])
        if not len(told):
            rows.append([key, f"{truth:.4g}", "not told", "", "", "", "0"])
            continue
        value, error, low, high = told.T
        spread = f"{value.std(ddof=1):.2g}" if len(value) > 1 else ""
        inside = f"{100 * np.mean((low <= truth) & (truth <= high)):.0f} %"
        rows.append(
            [key, f"{truth:.4g}", f"{value.mean():.4g}", spread, f"{error.mean():.2g}", inside, str(len(value))]
        )
    misfits = sum(misfit for _, misfit in results)
    title = f"{robot}: {logs} logs, {misfits} said to be misfits"
    return Table(title, ["", "truth", "mean", "spread", "std. error", "intervals with the truth", "told"], rows, 1)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="How often intervals of omni-mj identify hold the truth.")
    parser.add_argument("--logs", type=int, default=100)
    parser.add_argument("--robot", default=robots.DEFAULT)
    parser.add_argument("--laps", type=int, default=1)
    given = parser.parse_args(arguments)
    print(text(study(given.robot, given.logs, given.laps)))


if __name__ == "__main__":
    main()

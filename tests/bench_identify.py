"""Check `omni-mj identify` on robots with known numbers.

    python tests/bench_identify.py coverage [--logs 100] [--folder DIR]
    python tests/bench_identify.py measured FOLDER
    python tests/bench_identify.py robocin [--out FILE]

`coverage` counts how often 95 % intervals contain the true value. Each log has a robot of `ROBOTS`
with random creep, drag, loop gain and dead time, and half of the moves of the scenario identify
(20 s). The start robot's file differs in creep, drag, mass and dead time; its radius is as accurate
as the program assumes. Logs in --folder are reused.

`measured` identifies the robot omni3 of sousarbarb/optiodom (MIT; R. B. Sousa et al., J. Intell.
Robot. Syst. 105, 39, 2022). The rows of its CSV files are time, true pose (m, m, rad) and encoder
counts of three wheels.

`robocin` identifies a robot of RobôCIn from tests/data/robocin, and writes its file.
"""

import argparse
import re
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from support.robocin_logs import LOG_NAMES, write_robocin_log

from omni_control.errors import OmniError
from omni_mj.config import CYCLE_RATE_HZ, PERIOD_S, robot_files
from omni_mj.config.nominal_model import compute_creep_law
from omni_mj.config.rows import Row
from omni_mj.config.scenario import load_scenario
from omni_mj.config.settings import Settings
from omni_mj.results.text_table import DASH, Table, format_table
from omni_mj.simulation.simulation import Simulation
from omni_mj.studies import run_scenario
from omni_mj.studies.identify import robot_file_writer
from omni_mj.studies.identify.derived_parameters import Estimate
from omni_mj.studies.identify.identify_study import (
    RADIUS_ERROR,
    ROLLING_RADIUS,
    IdentificationResult,
    identify,
    identify_logs,
)
from omni_mj.studies.identify.robot_logs import read_logs
from omni_mj.studies.run_scenario import run_simulation

ROBOTS = ("tigers-v2016", "tigers-v2020", "ssl-a-team", "robojackets", "roboteam-twente")
# Omni3's encoder and gear; its wheels turn the other way than ours
COUNTS_PER_RAD = -1024 * 12 / (2 * np.pi)
# Mass, inertias, height and rollers are guesses.
OMNI3 = """
body.mass_kg = 10.0
body.com_x_m = 0.0
body.com_height_m = 0.1
body.yaw_inertia_kg_m2 = 0.25
body.tilt_inertia_kg_m2 = 0.2
wheels.azimuths_deg = [300, 60, 180]
wheels.arm_m = 0.195
wheels.radius_m = 0.051
wheels.rollers = 18
wheels.roller_radius_m = 0.005
carpet.rolling_resistance = 0.1
"""
ROBOCIN_COLUMNS = (
    "gain_forward",
    "gain_sideways",
    "creep_forward_s2_m",
    "creep_sideways_s2_m",
    "creep_stiffness",
)
ROBOCIN_DESCRIPTION = (
    'description = "RobôCIn: creep and drag from logs, all other numbers of tigers-v2016"'
)
ROBOCIN_HEADER = """# A robot of RobôCIn: creep and drag that explain its two logs (README.md).
# All other numbers are those of tigers-v2016, and say nothing of RobôCIn. The logs do not tell:
# radius (K is relative to that of their odometry), arm, latency, and the parts of the drag.
"""
LENGTHS = 4  # of the moves of scenario identify
COLUMNS = {  # number -> unit in the table
    "radius_m": 2e3, "gain_forward": 102, "gain_sideways": 102, "arm_m": 1e3, "clock_offset_s": 1e3,
    "creep_stiffness": 1,
}  # fmt: skip


def write_robot(path: Path, robot: str, changes: Mapping[str, object]) -> str:
    """Write a robot's file with other values and return its path."""
    values = {field: f"{value} # a guess" for field, value in changes.items()}
    path.write_text(
        robot_file_writer.apply_changes(
            robot_files.find_robot_file(robot).read_text("utf-8"), values, ["a guess"]
        ),
        "utf-8",
    )
    return str(path)


def draw_robot(base: Settings, number: int) -> Settings:
    """Return random settings for log `number`, with its moves."""
    rng = np.random.default_rng([number, 0])
    creep, rollers, pile, gain = np.exp(rng.uniform(-0.35, 0.35, 4))
    moves = np.array(base.reference.waypoints[1::2]).reshape(
        LENGTHS, -1, 3
    )  # by length and direction
    half = LENGTHS // 2
    chosen = [
        moves[k, i]
        for i in range(moves.shape[1])
        for k in (rng.integers(half), half + rng.integers(half))
    ]
    turn = rng.uniform(-np.pi, np.pi)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    points = [[0.0, 0.0, turn]]
    for i in rng.permutation(len(chosen)):
        *position, heading = chosen[i] * rng.uniform(0.8, 1.15)
        points += [[*np.round(rotation @ position, 4).tolist(), turn + heading], points[0]]
    return base.replace(
        drivetrain={
            "creep_stiffness": base.drivetrain.creep_stiffness * creep,
            "roller_friction": base.drivetrain.roller_friction * rollers,
        },
        carpet={"rolling_resistance": base.carpet.rolling_resistance * pile},
        firmware={"kp": base.firmware.kp * gain},
        radio={"delay_frames": int(rng.integers(2, 9))},
        vision={
            "position_noise_m": rng.uniform(0.5e-3, 2e-3),
            "heading_noise_rad": rng.uniform(0.003, 0.01),
        },
        reference={"waypoints": points, "max_acceleration_m_s2": rng.uniform(1.6, 2.2)},
    )


def write_start_file(settings: Settings, robot: str, number: int, folder: Path) -> str:
    """Write the robot's file from which log `number` is identified."""
    rng = np.random.default_rng([number, 1])
    creep, rollers, pile = np.exp(rng.uniform(-0.4, 0.4, 3))
    changes = {
        "drivetrain.creep_stiffness": settings.drivetrain.creep_stiffness * creep,
        "drivetrain.roller_friction": settings.drivetrain.roller_friction * rollers,
        "carpet.rolling_resistance": settings.carpet.rolling_resistance * pile,
        "body.mass_kg": settings.body.mass_kg * rng.uniform(0.93, 1.1),
        "wheels.radius_m": settings.wheels.radius_m * (1 + RADIUS_ERROR * rng.normal()),
        "radio.delay_frames": 3,
    }
    return write_robot(folder / f"start-{number}.toml", robot, changes)


def true_numbers(settings: Settings) -> dict[str, float]:
    """Return the plant's parameters by the names of estimates.

    The plant's integrator is semi-implicit: bodies are half a step ahead of their forces.
    """
    slip, half_step = compute_creep_law(settings), 0.5 / CYCLE_RATE_HZ / settings.physics.substeps
    parameters = {
        "wheels.creep_stiffness": settings.drivetrain.creep_stiffness,
        "wheels.rolling_resistance": settings.carpet.rolling_resistance,
        "wheels.roller_friction": settings.drivetrain.roller_friction,
        "wheels.radius_m": ROLLING_RADIUS * settings.wheels.radius_m,
        "wheels.arm_m": settings.wheels.arm_m,
        "commands.dead_time_s": settings.radio.delay_frames * PERIOD_S - half_step,
    }
    parameters |= dict.fromkeys(
        ("wheels.clock_offset_s", "wheels.slope_x_rad", "wheels.slope_y_rad"), 0.0
    )
    for i, axis in enumerate(("forward", "sideways")):
        parameters[f"wheels.gain_{axis}"] = ROLLING_RADIUS * float(slip.gain[i])
        parameters[f"wheels.creep_{axis}_s2_m"] = float(slip.coefficient[i])
        parameters[f"wheels.drag_{axis}_m_s2"] = float(slip.drag[i]) / settings.body.mass_kg
    return parameters


def identify_drawn(
    robot: str, log_numbers: range, folder: Path
) -> list[tuple[IdentificationResult, dict[str, float]]]:
    """Identify random robots from logs that are driven in one batch, unless the folder has them."""
    base = load_scenario("identify", robot=robot)
    base = base.replace(settings=base.settings.replace(wheels={"model": "two-rollers"}))
    settings = [draw_robot(base.settings, number) for number in log_numbers]
    run_folder = folder / f"{robot}-{log_numbers}"
    if not (run_folder / "trajectory.parquet").exists():
        rows = [
            Row(i, 0, base.controllers[0], number, settings_i, robot)
            for i, (number, settings_i) in enumerate(zip(log_numbers, settings, strict=True))
        ]
        simulation = Simulation(base, rows=rows)
        run_scenario.build_result(run_simulation(simulation)).save(run_folder)
    logs = read_logs(run_folder / "trajectory.parquet")
    results = []
    for number, log, settings_i in zip(log_numbers, logs, settings, strict=True):
        start_file = write_start_file(settings_i, robot, number, folder)
        result = identify_logs([log], load_scenario("rect", robot=start_file))
        results.append((result, true_numbers(settings_i)))
    return results


def coverage(logs: int, folder: Path) -> Table:
    """Return relative errors of each parameter and the fraction of intervals with the true value.

    "error / std." is the root mean square of errors over standard errors, which should be 1.
    """
    step = len(ROBOTS)
    results = [
        result
        for k, robot in enumerate(ROBOTS)
        if k < logs
        for result in identify_drawn(robot, range(k, logs, step), folder)
    ]
    rows = []
    for name in results[0][1]:
        estimates = [
            (identified_estimates(result)[name], truth[name])
            for result, truth in results
            if name in identified_estimates(result)
        ]
        if estimates:
            value, error, low, high, truth = np.array(
                [[e.value, e.standard_error, e.low, e.high, t] for e, t in estimates]
            ).T
            unit = np.where(truth == 0, 1.0, np.abs(truth))
            deviation, ratio = (value - truth) / unit, (value - truth) / error
            figures = (
                deviation.mean(),
                deviation.std(),
                (error / unit).mean(),
                np.sqrt((ratio**2).mean()),
            )
            within = f"{100 * np.mean((low <= truth) & (truth <= high)):.0f} %"
            rows.append([name, *(f"{x:.2g}" for x in figures), within, str(len(estimates))])
    misfits = sum(bool(result.misfits) for result, _ in results)
    headings = ["", "mean error", "spread", "std. error", "error / std.", "coverage", "identified"]
    return Table(
        f"{logs} logs, {misfits} misfits; over the truth where that is not 0", headings, rows, 1
    )


def measured(runs: Path, folder: Path) -> Table:
    """Return the estimates of each run of omni3."""
    changes = dict(line.split(" = ") for line in OMNI3.strip().splitlines())
    robot = write_robot(folder / "omni3.toml", robot_files.DEFAULT_ROBOT, changes)
    rows = []
    for path in sorted(runs.glob("*_run-*.csv")):
        data = np.loadtxt(path, delimiter=",")
        columns = np.column_stack([data[:, :4], np.cumsum(data[:, 4:], axis=0) / COUNTS_PER_RAD])
        header = "time_s,x_m,y_m,heading_rad,wheel_1_rad,wheel_2_rad,wheel_3_rad"
        np.savetxt(
            folder / path.name, columns, fmt="%.9g", delimiter=",", header=header, comments=""
        )
        try:
            result = identify([folder / path.name], robot)
        except OmniError as error:
            rows.append([path.stem, str(error), *[""] * len(COLUMNS)])
            continue
        formatted = [
            format_estimate(identified_estimates(result).get(f"wheels.{name}"), unit)
            for name, unit in COLUMNS.items()
        ]
        persistent = result.fits["wheels"].residuals["positions"].persistent
        rows.append([path.stem, *formatted, f"{1e3 * persistent:.2g}"])
    headings = [
        "run",
        "wheel, mm",
        "K fwd",
        "K side",
        "arm, mm",
        "clock, ms",
        "creep",
        "persistent, mm",
    ]
    return Table("omni3, by wheels and true poses; K times 102 mm", headings, rows, 1)


def robocin(folder: Path, out: Path | None) -> Table:
    """Return the estimates by each log of RobôCIn and by both, and write the robot's file."""
    geometry = load_scenario("rect").settings.wheels.kinematics
    logs = [write_robocin_log(name, folder, geometry) for name in LOG_NAMES]
    rows = []
    for chosen in (*([log] for log in logs), logs):
        result = identify(chosen)
        prediction = result.predictions["wheels"]
        assert prediction is not None
        estimates = [result.estimates[f"wheels.{name}"] for name in ROBOCIN_COLUMNS]
        formatted = [format_estimate(e if e.is_identified else None, 1.0) for e in estimates]
        errors = [f"{1e3 * e:.1f}" for e in (prediction.fitted_m, prediction.start_m)]
        rows.append([", ".join(log.stem for log in chosen), *formatted, *errors])
    if out:
        result.save(folder)
        text = (folder / "robot.toml").read_text("utf-8")
        text = re.sub("(?m)^description = .*$", ROBOCIN_DESCRIPTION, text)
        out.write_text(ROBOCIN_HEADER + text, "utf-8")
    headings = ["log", "K forward", "K sideways", "T forward, s^2/m", "T sideways, s^2/m"]
    headings += ["C", "predicted within, mm", "by the start robot, mm"]
    return Table("a robot of RobôCIn, by odometry and SSL-Vision", headings, rows, 1)


def identified_estimates(result: IdentificationResult) -> dict[str, Estimate]:
    """Return the estimates that the data identify, without weak ones, by name."""
    return {
        name: estimate
        for name, estimate in result.estimates.items()
        if estimate.is_identified and not estimate.is_weak
    }


def format_estimate(estimate: Estimate | None, unit: float) -> str:
    """Return value and standard error as text."""
    return (
        f"{unit * estimate.value:.4g} +- {unit * estimate.standard_error:.2g}" if estimate else DASH
    )


def main() -> None:
    """Run the program."""
    parser = argparse.ArgumentParser(
        description="Check omni-mj identify on robots with known numbers."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    drawn = commands.add_parser("coverage")
    drawn.add_argument("--logs", type=int, default=100)
    drawn.add_argument("--folder", type=Path)
    commands.add_parser("measured").add_argument("runs", type=Path)
    commands.add_parser("robocin").add_argument("--out", type=Path)
    options = parser.parse_args()
    with TemporaryDirectory() as name:
        if options.command == "measured":
            result = measured(options.runs, Path(name))
        elif options.command == "robocin":
            result = robocin(Path(name), options.out)
        else:
            result = coverage(options.logs, options.folder or Path(name))
    print(format_table(result))


if __name__ == "__main__":
    main()

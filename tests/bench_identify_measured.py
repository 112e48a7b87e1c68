"""What `omni-mj identify` makes of a robot that was measured: three omni wheels in a laboratory.

    python tests/bench_identify_measured.py FOLDER

FOLDER is that of the robot omni3 in the data of sousarbarb/optiodom (MIT; R. B. Sousa et al., J. Intell. Robot. Syst.
105, 39, 2022): runs of time, ground truth (m, m, rad) and ticks of three wheels per cycle of 40 ms, which are no part
of this project. Each is written as a log, identified by wheels, and told in a row (docs/identify.md).
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from omni_control.errors import OmniError
from omni_mj.measure.table import DASH, Table, text
from omni_mj.scenarios import robots
from omni_mj.studies.identify import Estimate, identify

TICKS = -1024 * 12 / (2 * np.pi)  # counts and gear of omni3; its wheels turn the other way than ours
OWN = {  # what the data set says of omni3, and guesses of what it does not: mass, inertia, height, rollers
    "mass_kg": "10.0",
    "centre_x_m": "0.0",
    "centre_height_m": "0.1",
    "yaw_inertia_kg_m2": "0.25",
    "tilt_inertia_kg_m2": "0.2",
    "azimuths_deg": "[300, 60, 180]",
    "arm_m": "0.195",
    "radius_m": "0.051",
    "rollers": "18",
    "roller_radius_m": "0.005",
    "pile": "0.1",
}
WHEELS = ("wheels.radius_m", "wheels.gain_forward", "wheels.gain_sideways")
COLUMNS = ("wheel, mm", "as", "arm, mm", "later by, ms", "more so, %", "creep", "lasts, mm")


def robot_file(folder: Path) -> Path:
    """omni3 as a robot's file: the default robot's with `OWN` numbers."""
    lines = []
    for line in robots.robot_path(robots.DEFAULT).read_text("utf-8").splitlines():
        key = line.split("=")[0].strip()
        lines.append(f"{key} = {OWN[key]}" if key in OWN else line)
    path = folder / "omni3.toml"
    path.write_text("\n".join(line for line in lines if not line.startswith("#:schema")), "utf-8")
    return path


def log_file(run: Path, folder: Path) -> Path:
    """A run as a log of ours: times, poses, and angles of wheels."""
    data = np.loadtxt(run, delimiter=",")
    columns = np.column_stack([data[:, :4], np.cumsum(data[:, 4:], axis=0) / TICKS])
    path = folder / run.name
    header = "time_s,x_m,y_m,heading_rad,wheel_1_rad,wheel_2_rad,wheel_3_rad"
    np.savetxt(path, columns, fmt="%.9g", delimiter=",", header=header, comments="")
    return path


def row(run: Path, robot: Path, folder: Path) -> list[str]:
    """What a run tells."""
    try:
        result = identify([log_file(run, folder)], str(robot))
    except OmniError as error:
        return [run.stem, str(error), *[DASH] * (len(COLUMNS) - 1)]
    told = {f"{e.source}.{e.name}": e for e in result.estimates if e.told}
    name = next((each for each in WHEELS if each in told), None)

    def cell(estimate: Estimate | None, unit: float) -> str:
        return f"{unit * estimate.value:.4g} +- {unit * estimate.error:.2g}" if estimate else DASH

    wheel = told[name] if name else None
    scale = 2e3 if name == WHEELS[0] else 102.0  # of a gain, that of wheels of 102 mm
    lasts = result.parts[0].fitted.position.lasting
    return [
        run.stem,
        cell(wheel, scale),
        name.split(".")[1].replace("gain_", "K ") if name else DASH,
        cell(told.get("wheels.arm_m"), 1e3),
        cell(told.get("wheels.clock_s"), 1e3),
        cell(told.get("wheels.drift"), 100),
        cell(told.get("wheels.creep_stiffness"), 1),
        f"{1e3 * lasts:.2g}",
    ]


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="What omni-mj identify makes of a robot that was measured.")
    parser.add_argument("folder", type=Path, help="Folder of the runs of omni3.")
    given = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        robot = robot_file(folder)
        rows = [row(run, robot, folder) for run in sorted(given.folder.glob("*_run-*.csv"))]
    print(text(Table("omni3, by wheels and ground truth", ["run", *COLUMNS], rows, 1)))


if __name__ == "__main__":
    main()

"""Measure CPU time and memory of sweeps over `rect`, and extrapolate to a million runs.

    python tests/bench_sweep.py [--plant kinematic planar mujoco] [--runs 1000 10000]
                                [--controller comp-flc] [--batch-size 512]
                                [--set SECTION.FIELD=VALUE ...]

Each sweep is a process of its own. The dead time has ten values.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

POINTS = 10


def measure_sweep(plant: str, runs: int, options: argparse.Namespace) -> tuple[float, float, float]:
    """Return CPU time in s, peak memory in GB, and bytes per run of the table of a sweep."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "sweep"
        sets = [word for setting in options.set for word in ("--set", setting)]
        command = [
            sys.executable, "-m", "omni_mj.cli.main", "sweep", "--quiet",
            "--scenario", "rect", "--plant", plant,
            "--controller", options.controller,
            "--vary", f"radio.delay_frames=0:{POINTS - 1}:{POINTS}",
            "--seeds", str(runs // POINTS), "--batch-size", str(options.batch_size),
            "--out", str(out), *sets,
        ]  # fmt: skip
        _, status, used = os.wait4(subprocess.Popen(command).pid, 0)
        assert status == 0, "the sweep failed"
        size = (out / "rows.parquet").stat().st_size / runs
        return used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6, size


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plant", nargs="+", default=["kinematic", "planar"])
    parser.add_argument("--runs", type=int, nargs="+", default=[1000, 10_000])
    parser.add_argument("--controller", default="comp-flc")
    parser.add_argument("--batch-size", type=int, default=512)
    parser.add_argument("--set", action="append", default=[])
    options = parser.parse_args()
    print("plant          runs    CPU-s  highest GB  bytes a run  CPU-hours of a million")
    for plant in options.plant:
        for runs in options.runs:
            cpu, memory, size = measure_sweep(plant, runs, options)
            hours = cpu / runs * 1e6 / 3600
            print(
                f"{plant:10s} {runs:8d} {cpu:8.1f} {memory:11.2f} {size:12.0f} {hours:23.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()

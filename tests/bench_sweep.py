"""What sweeps cost: CPU time and memory of so many runs of `rect` under one controller, and what a million take.

    python tests/bench_sweep.py [--plant kinematic planar mujoco] [--runs 1000 10000] [--controller
    comp-flc]
                                [--batch-size 512] [--set SECTION.FIELD=VALUE ...]

Each sweep is a process of its own, whose highest memory is told. The dead time is varied over ten values.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

POINTS = 10


def measured(plant: str, runs: int, given: argparse.Namespace) -> tuple[float, float, float]:
    """CPU time of a sweep in s, its highest memory in GB, and the size of its table in bytes a run."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "sweep"
        sets = [word for each in given.set for word in ("--set", each)]
        command = [
            sys.executable, "-m", "omni_mj.cli.main", "sweep", "--quiet", "--scenario", "rect", "--plant", plant,
            "--controller", given.controller, "--vary", f"radio.delay_frames=0:{POINTS - 1}:1",
            "--seeds", str(runs // POINTS), "--batch-size", str(given.batch_size), "--out", str(out), *sets,
        ]  # fmt: skip
        _, status, used = os.wait4(subprocess.Popen(command).pid, 0)
        assert status == 0, "the sweep failed"
        size = (out / "rows.parquet").stat().st_size / runs
        return used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6, size


def main() -> None:
    """Measure and print."""
    given = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    given.add_argument("--plant", nargs="+", default=["kinematic", "planar"])
    given.add_argument("--runs", type=int, nargs="+", default=[1000, 10_000])
    given.add_argument("--controller", default="comp-flc")
    given.add_argument("--batch-size", type=int, default=512)
    given.add_argument("--set", action="append", default=[])
    chosen = given.parse_args()
    print("plant          runs    CPU-s  highest GB  bytes a run  CPU-hours of a million")
    for plant in chosen.plant:
        for runs in chosen.runs:
            cpu, memory, size = measured(plant, runs, chosen)
            hours = cpu / runs * 1e6 / 3600
            print(
                f"{plant:10s} {runs:8d} {cpu:8.1f} {memory:11.2f} {size:12.0f} {hours:23.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
